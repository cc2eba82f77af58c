"""`rooms`: the names that each package of `palpate` offers and no page of the reference has, with their docstrings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from inspect import isclass, isfunction
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx

import palpate

PAGES = Path(__file__).resolve().parents[1] / "api"
WRITTEN = re.compile(r":: (palpate\w*(?:\.\w+)+)")


def left(pages: Path = PAGES) -> Iterator[tuple[str, list[str]]]:
    """Each package with the names in its `__all__` that no page has, under this or another name."""
    written = [name for page in pages.glob("*.md") for name in WRITTEN.findall(page.read_text(encoding="utf-8"))]
    known = {id(_named(name)) for name in written}
    for room in ("palpate", *(each.name for each in walk_packages(palpate.__path__, "palpate.") if each.ispkg)):
        module = import_module(room)
        names = [name for name in getattr(module, "__all__", ()) if id(getattr(module, name)) not in known]
        known |= {id(getattr(module, name)) for name in names}
        if names and "._" not in room:
            yield room, names


def _named(name: str) -> Any:
    room, _, last = name.rpartition(".")
    try:
        return getattr(import_module(room), last, None)
    except ModuleNotFoundError:
        return None


class Rooms(Directive):
    """A paragraph and the entries of each room."""

    def run(self) -> list[nodes.Node]:
        """As if they had been typed."""
        lines: list[str] = []
        for room, names in left():
            lines += [f"**{room}**", "", "```{eval-rst}"]
            lines += [line for name in names for line in _entry(room, name)]
            lines += ["```", ""]
        node = nodes.container()
        self.state.nested_parse(StringList(lines, source=__file__), 0, node)
        return node.children


def _entry(room: str, name: str) -> list[str]:
    thing = getattr(import_module(room), name)
    if isfunction(thing):
        return [f".. autofunction:: {room}.{name}"]
    if isclass(thing) and thing.__name__ == name:
        return [f".. autoclass:: {room}.{name}()"]
    about = (thing.__doc__ or "").partition("\n")[0] if isclass(thing) else ""
    value = f"   :value: {thing!r}" if isinstance(thing, str | dict) else ""
    return [f".. py:data:: {room}.{name}", value, "", f"   {about}", ""]


def setup(app: Sphinx) -> dict[str, bool]:
    """The directive."""
    app.add_directive("rooms", Rooms)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
