"""The project's docstrings, plain text with names in backticks, as the reST that autodoc reads; types as written.

A name in backticks becomes a link where the reference has it, and is code where not. `|torque|`, `(*batch, 3)` and the
like are text: reST would take them for marks of its own. `Float[np.ndarray, "n 3"]` is shown as `Float["n 3"]`.
"""

from __future__ import annotations

import inspect
import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

CODE = re.compile(r"(``.+?``|`[^`\n]+`)")
NAME = re.compile(r"[A-Za-z_][\w.]*$")
EMPHASIS = re.compile(r"(?<![\w(\[*`])\*(\w+)\*(?![\w*])")
ARRAY = re.compile(r"\b(Float|Int|Int8|Bool|UInt8)\[(?:np\.ndarray|Any), (['\"])\s*(.*?)\2\]")
SHAPES = {"Float", "Int", "Int8", "Bool", "UInt8", "ArrayLike"}  # explained on the first page of the reference
ALONE = {"class", "exception", "function", "type"}  # found by their bare name wherever it is written
FIELD = re.compile(r"^:(?:ivar|param) [^:]+:")
FENCE = "```"
SECTIONS = ("Returns:", "Yields:", "Args:", "Attributes:", "Raises:")
COLON = "\ue000"  # stands for a colon that napoleon would take for the end of a type


def as_rest(line: str) -> str:
    """One line of a docstring, its marks turned into reST's."""
    return "".join(_code(part) if number % 2 else _plain(part) for number, part in enumerate(CODE.split(line)))


def _code(span: str) -> str:
    name = span.strip("`")
    return f":py:obj:`{name}`" if NAME.match(name) and not span.startswith("``") else f"``{name}``"


def _plain(text: str) -> str:
    text = text.replace("\\", "\\\\").replace("|", "\\|")
    kept = EMPHASIS.sub("\0\\1\0", text).replace("*", "\\*").replace("\0", "*")
    return re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", kept)


def _before(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = _blocks(lines)
    if what in ("property", "attribute", "data") and lines:
        lines[0] = lines[0].replace(":", COLON)


def _blocks(lines: list[str]) -> list[str]:
    """Code between fences and what is set in as it stands, the rest as reST.

    And after `Returns:` no colon, which napoleon would take for the end of a type.
    """
    made: list[str] = []
    head, code, inset = "", False, False
    for before, line in zip(["", *lines], lines, strict=False):
        if line.startswith(FENCE):
            code = not code
            made += [".. code-block:: python", ""] if code else [""]
            continue
        if line and not line.startswith(" "):
            head, inset = line, False
        elif line and not before and head not in SECTIONS and not inset:
            made, inset = [*made, "::", ""], True
        if code or inset:
            made.append(f"    {line}")
        else:
            text = as_rest(line)
            made.append(text.replace(": ", COLON + " ") if head in SECTIONS[:2] and line.startswith(" ") else text)
    return made


def _after(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """What napoleon made: several names of one line stay together (a blank would end a type)."""
    lines[:] = [FIELD.sub(lambda names: names[0].replace(", ", ","), line.replace(COLON, ":")) for line in lines]


def _signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """With the types as the source has them: evaluated, `ArrayLike` would be nine lines of unions."""
    if signature is None or what == "exception" or (what == "class" and signature == "()"):  # as the page says
        return signature, returns
    try:
        whole = inspect.signature(thing)
    except (TypeError, ValueError):
        return signature, returns
    kept = [each for each in whole.parameters.values() if each.name not in ("self", "cls")]
    shown = [each.replace(annotation=_written(each.annotation), default=_default(each.default)) for each in kept]
    result = None if what == "class" else _written(whole.return_annotation)
    return str(whole.replace(parameters=shown, return_annotation=whole.empty)), result or None


class _Text:
    """Printed as it is, where `inspect` would print a `repr`."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def _written(annotation: Any) -> Any:
    if annotation is inspect.Parameter.empty or not isinstance(annotation, str):
        return annotation
    return _Text(ARRAY.sub(r'\1["\3"]', annotation))


def _default(value: Any) -> Any:
    plain = value is inspect.Parameter.empty or isinstance(value, str | int | float | bool | tuple | None)
    return value if plain else _Text("...")


def _found(app: Sphinx, env: BuildEnvironment, node: pending_xref, inside: nodes.Element) -> nodes.Element | None:
    """A name as it is written where it is used: by its last part, or within its own class."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"]
    if name in SHAPES:
        return make_refnode(app.builder, node["refdoc"], "api/index", "reading-shapes", inside)
    objects = env.domains["py"].data["objects"]
    ends = f".{name.rpartition('.')[2]}" if name.startswith("palpate.") else f".{name}"
    own = f"{node.get('py:class') or ''}{ends}"
    near = [each for each in objects if each.endswith(ends) and (objects[each].objtype in ALONE or "." in name)]
    near = [each for each in objects if node.get("py:class") and each.endswith(own)] or near
    if len(near) != 1:
        return inside if node["reftype"] == "obj" else None
    entry = objects[near[0]]
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, inside, near[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Text before napoleon reads it, links after all pages were read."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", _before, priority=100)
    app.connect("autodoc-process-docstring", _after, priority=900)
    app.connect("autodoc-process-signature", _signature)
    app.connect("missing-reference", _found)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
