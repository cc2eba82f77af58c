"""Laws of the pages: pictures are small and made by a function; commands exist; links hold where they are read."""

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

import palpate
from palpate.cli.app import COMMANDS, _options, command_of, join_others
from palpate.cli.spelling import unknown_command, unknown_option
from tests.support import blocks
from tests.support.blocks import ROOT

join_others()

DOCS, PICTURES = ROOT / "docs", ROOT / "docs/pictures"
PAGES = (*blocks.PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md")
SITE = [page for page in PAGES if page.is_relative_to(DOCS)]
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
LINKED = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"^```(?:(?!{)|{index}).*?^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(palpate [a-z][^`\n]*)`")
GROUPS = {name: tuple(getattr(entry, "commands", ())) for name, entry in COMMANDS.items()}
LARGEST = {".png": 80_000, ".webp": 1_500_000}  # bytes of a picture, and of one that moves: a clone takes all of them
GALLERY = 12


def _id(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def _read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def _shown() -> set[str]:
    """Each picture that a page shows."""
    return {Path(name).name for page in PAGES for name in SHOWN.findall(_read(page))}


def test_every_picture_is_shown_small_and_made_by_the_function_of_its_name() -> None:
    there = {file.stem: file for file in PICTURES.iterdir() if file.suffix in LARGEST}
    trees = [ast.parse(_read(file)) for file in PICTURES.glob("*.py")]
    listed = {node.attr for node in ast.walk(ast.parse(_read(PICTURES / "make.py"))) if isinstance(node, ast.Attribute)}
    makers = {node.name for tree in trees for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert {Path(name).stem for name in _shown()} == set(there)
    assert set(there) == makers & listed
    assert [file.name for file in there.values() if file.stat().st_size > LARGEST[file.suffix]] == []


def test_the_gallery_says_how_each_of_its_pictures_is_made() -> None:
    text = _read(DOCS / "gallery.md")
    assert len(SHOWN.findall(text)) >= GALLERY
    after = re.findall(r"^!\[.*\n\n(.*)$", text, re.MULTILINE)
    assert len(after) == len(SHOWN.findall(text))
    assert [line for line in after if not line.startswith("`")] == []


def test_first_pages_are_short() -> None:
    most = {ROOT / "README.md": 700} | dict.fromkeys((DOCS / "from").glob("*.md"), 220)
    assert {_id(page): count for page in most if (count := len(_read(page).split())) > most[page]} == {}


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("location [mm] 0.039 2.226 4,639", "location [mm] 0.039 7.645 4,639"),
        ("cells 4, noise (1.9, 2.0) mN", "cells 5, noise (1.9, 2.0) mN"),
        ("peak ... 1.486 ...", "peak 3 1.54 7"),
        ("samples 4,644", "samples 4,646"),
    ],
)
def test_a_shown_number_must_be_the_printed_one(shown: str, printed: str) -> None:
    assert blocks.unseen(shown, [printed]) == [shown]
    assert blocks.unseen(printed, [printed]) == []


def test_rounding_agrees() -> None:
    assert blocks.unseen("offset 30.03 +- 0.04 ms of 5,907", ["offset 30.034 +- 0.043 ms of 5,906"]) == []


def test_an_excerpt_may_not_leave_out_coverage() -> None:
    other = ["force 1", "95 % ellipses hold the truth in 12.0 % of 3"]
    output = ["location 2", "95 % ellipses hold the truth in 92.0 % of 573", "mean 3"]
    assert blocks.uncovered("location 2", [other, output]) == [output[1]]
    assert blocks.uncovered("location 2\n" + output[1], [other, output]) == []


def test_every_page_is_in_the_menu() -> None:
    """Sphinx warns of a page that is nowhere; here of one that is there twice, or by a grab-bag."""
    menu = " ".join(re.findall(r"```{toctree}\n(.*?)```", _read(DOCS / "index.md"), re.DOTALL)).split()
    named = [line for line in menu if (DOCS / f"{line}.md").exists()]
    assert len(named) == len(set(named))
    assert "*" not in menu
    inside = ("api/", "tutorials/")  # their first pages have the others
    own = {name for page in SITE if not (name := page.relative_to(DOCS).with_suffix("").as_posix()).startswith(inside)}
    assert own - set(named) == {"index"}


def test_the_reference_has_every_name_of_the_front_door() -> None:
    text = "".join(_read(page) for page in DOCS.glob("api/*.md"))
    assert [name for name in palpate.__all__ if not re.search(rf":: palpate\.{name}(\(\))?\n", text)] == []


def test_the_reference_has_every_name_that_a_room_offers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that no page has are on the page of the rooms; without any page that is all of them."""
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    rooms = import_module("rooms")
    offered = {
        name
        for file in (ROOT / "src/palpate").rglob("__init__.py")
        for node in ast.parse(_read(file)).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for name in ast.literal_eval(node.value)
    }
    assert {name for _, names in rooms.left(tmp_path) for name in names} == offered
    assert "{rooms}" in _read(DOCS / "api/rooms.md")


@cache
def _known(command: tuple[str, ...]) -> set[str]:
    return _options(command)


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_command_that_a_sentence_names_exists_with_its_options(page: Path) -> None:
    """Those in blocks are followed by tests/conformance/test_front_door.py."""
    calls = [line.split()[1:] for line in INLINE.findall(_read(page))]
    wrong = [unknown_command(words, command_of(words, GROUPS), GROUPS) or _unknown_option(words) for words in calls]
    assert [said for said in wrong if said] == []


def _unknown_option(words: list[str]) -> str | None:
    command = command_of(words, GROUPS)
    return unknown_option(words, command, _known(command)) if len(words) > len(command) else None


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_link_and_anchor_of_a_page_holds(page: Path) -> None:
    """Of the README and its like beside the code, of the others on the site, which has nothing outside of docs."""
    text = CODE.sub("", _read(page))
    local = [name.partition("#") for name in (*LINKED.findall(text), *SHOWN.findall(text)) if "://" not in name]
    there = {name: (page.parent / name).resolve() if name else page for name, _, _ in local}
    assert [name for name, file in there.items() if not file.exists()] == []
    assert [name for name, file in there.items() if page.is_relative_to(DOCS) and not file.is_relative_to(DOCS)] == []
    anchors = [(name, part) for name, _, part in local if part]
    assert [f"{name}#{part}" for name, part in anchors if part not in _anchors(there[name])] == []


@cache
def _anchors(page: Path) -> set[str]:
    """Of headings, as GitHub and MyST make them, and those that MyST is given."""
    text = CODE.sub("", _read(page))
    titles = re.findall(r"^#{1,3} (.+)$", text, re.MULTILINE)
    return set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE)) | {
        re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles
    }
