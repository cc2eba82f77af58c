"""Laws of the pages: pictures are small and made by a function; commands exist; links hold where they are read."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import palpate
from palpate.cli.app import COMMANDS, _options
from palpate.cli.spelling import command_of, unknown_command, unknown_option

ROOT = Path(__file__).resolve().parents[1]
DOCS, PICTURES = ROOT / "docs", ROOT / "docs/pictures"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
LINKED = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
FENCED = re.compile(r"^```(?:sh|text)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(palpate [a-z][^`\n]*)`")
GROUPS = {name: tuple(getattr(entry, "commands", ())) for name, entry in COMMANDS.items()}
LARGEST = 80_000  # bytes of a picture: a clone takes all of them
GALLERY = 10


def _read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def _shown() -> set[str]:
    """Each picture that a page or the README shows."""
    return {Path(name).name for page in (ROOT / "README.md", *PAGES) for name in SHOWN.findall(_read(page))}


def test_every_picture_is_shown_small_and_made_by_the_function_of_its_name() -> None:
    there = {file.stem: file for file in PICTURES.glob("*.png")}
    trees = [ast.parse(_read(file)) for file in PICTURES.glob("*.py")]
    listed = {node.attr for node in ast.walk(ast.parse(_read(PICTURES / "make.py"))) if isinstance(node, ast.Attribute)}
    makers = {node.name for tree in trees for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert {Path(name).stem for name in _shown()} == set(there) <= makers & listed
    assert {name: size for name, file in there.items() if (size := file.stat().st_size) > LARGEST} == {}


def test_the_gallery_says_how_each_of_its_pictures_is_made() -> None:
    text = _read(DOCS / "gallery.md")
    assert len(SHOWN.findall(text)) >= GALLERY
    after = re.findall(r"^!\[.*\n\n(.*)$", text, re.MULTILINE)
    assert len(after) == len(SHOWN.findall(text))
    assert [line for line in after if not line.startswith("`")] == []


def test_every_page_is_in_the_menu() -> None:
    """Sphinx warns of a page that is nowhere; here of one that is there twice, or by a grab-bag."""
    menu = " ".join(re.findall(r"```{toctree}\n(.*?)```", _read(DOCS / "index.md"), re.DOTALL)).split()
    named = [line for line in menu if (DOCS / f"{line}.md").exists()]
    assert len(named) == len(set(named))
    assert "*" not in menu
    top = {page.stem for page in DOCS.glob("*.md")} | {f"how_to/{page.stem}" for page in DOCS.glob("how_to/*.md")}
    assert top - set(named) == {"index"}


def test_the_reference_has_every_name_of_the_front_door() -> None:
    text = "".join(_read(page) for page in DOCS.glob("api/*.md"))
    assert [name for name in palpate.__all__ if not re.search(rf":: palpate\.{name}(\(\))?\n", text)] == []


def _calls(text: str) -> Iterator[list[str]]:
    """Each call of a command, its comment left out; lines that end in a backslash go on."""
    lines = [line for block in FENCED.findall(text) for line in block.replace("\\\n", " ").splitlines()]
    for line in (*lines, *INLINE.findall(text)):
        words = re.split(r"\s#|\s&&|\s\|", line.removeprefix("$ "))[0].split()
        if words[:1] == ["palpate"] and len(words) > 1 and re.fullmatch(r"[a-z-]+", words[1]):
            yield words[1:]


@cache
def _known(command: tuple[str, ...]) -> set[str]:
    return _options(list(command))


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_on_a_page_exists_with_its_options(page: Path) -> None:
    wrong = [
        said
        for words in _calls(_read(page))
        if not words[0].startswith("-")
        and (said := unknown_command(words, GROUPS) or unknown_option(words, command_of(words, GROUPS), _of(words)))
    ]
    assert wrong == []


def _of(words: list[str]) -> set[str]:
    command = command_of(words, GROUPS)
    return _known(command) if words[-1] != command[-1] else set()


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_outside_the_site_lead_somewhere(page: str) -> None:
    """Sphinx checks those of its pages; these are read beside the code."""
    text = _read(ROOT / page)
    local = [name.partition("#") for name in (*LINKED.findall(text), *SHOWN.findall(text)) if "://" not in name]
    assert [path for path, _, _ in local if path and not (ROOT / path).exists()] == []
    assert [f"{path}#{part}" for path, _, part in local if part and part not in _anchors(ROOT / (path or page))] == []


def _anchors(page: Path) -> set[str]:
    """Of headings, as GitHub and MyST make them."""
    titles = re.findall(r"^#{1,3} (.+)$", _read(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}
