"""The code in pages, README and all: found, read as calls, and run in order as somebody who follows the page would.

A fenced block of `sh` or `python` runs, unless a comment on the line above it says why not: `<!-- not run: a robot -->`
never, `<!-- by hand: minutes -->` only by `python -m tests.follow`. The calls of a block of `text` are templates. Every
call of `palpate`, in whatever block, is one that the command line takes.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import math
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import tyro

from palpate.cli import main
from palpate.cli.app import COMMANDS, join_others

join_others()

__all__ = ["PAGES", "ROOT", "Block", "Follower", "blocks", "refusal", "unseen", "unserved"]

ROOT = Path(__file__).resolve().parents[2]
PAGES = tuple(
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if "_build" not in page.relative_to(ROOT).parts
)
_FENCED = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_MARK = re.compile(r"<!-- (not run|by hand): .+ -->\s*$")
_ELSEWHERE = re.compile(r"pip install |\. \.venv/bin/activate$|python examples/")  # have tests of their own
_DEMO = re.compile(r"make demo\b|palpate demo\b(?:.* -o (?P<folder>\S+))?")
_CODE = re.compile(r"#.*exit code (\d+)")  # a comment on a call that is to leave so
_AGREE = 0.05  # of a number: machines differ in its last digits, and it is rounded
_ROUNDED = 0.06  # the same, of numbers that are small


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes:
        page: that it stands on; line: of its fence, counted from 1.
        kind: sh, python, text, toml, ...
        code: as it stands there.
        mark: "not run", "by hand", or nothing.
    """

    page: Path
    line: int
    kind: str
    code: str
    mark: str

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"

    def lines(self) -> list[tuple[str, int]]:
        """Of a shell, each with the exit code that it is to leave with; without comments, what is continued joined."""
        if "<<" in self.code:
            return [(self.code, 0)]  # a here-document is one whole
        whole = self.code.replace("\\\n", " ").splitlines()
        split = [(re.sub(r"(^|\s)#\s.*$", "", each).strip(), _CODE.search(each)) for each in whole]
        return [(line, 0 if said is None else int(said[1])) for line, said in split if line]

    def calls(self) -> list[list[str]]:
        """The words behind `palpate` of each call in it, where it goes aside."""
        if self.kind not in ("sh", "text"):
            return []
        called = (line.partition(" > ")[0] for line, _ in self.lines() if line.startswith("palpate "))
        return [shlex.split(line)[1:] for line in called if "..." not in line]


def blocks(page: Path) -> list[Block]:
    """Every fenced block of a page, in order."""
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    for match in _FENCED.finditer(text):
        before = text[: match.start()]
        mark = _MARK.search(before)
        found.append(Block(page, before.count("\n") + 1, match[1], match[2], "" if mark is None else mark[1]))
    return found


def refusal(words: list[str]) -> str | None:
    """Why the command line would not take a call; None where it would. Nothing runs, and no file need be there."""
    given = [word for word in words if word not in ("--quiet", "--json")]
    if given == ["--version"] or given[:1] == ["--tyro-write-completion"]:
        return None
    command: Any = COMMANDS.get(given[0])
    rest = given[1:]
    if hasattr(command, "commands"):
        command, rest = command.commands.get(rest[0]) if rest else None, rest[1:]
    if command is None:
        return f"there is no command `palpate {' '.join(given[:2])}`"
    command = command.load()

    @functools.wraps(command)
    def nothing(*_: object, **__: object) -> None:
        """Only what the parser makes of the words is asked."""

    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            tyro.cli(command if isinstance(command, type) else nothing, args=rest)  # a class is only its arguments
    except SystemExit as leaving:
        return said.getvalue() if leaving.code else None
    return None


@dataclass
class Follower:
    """Runs blocks one after the other, commands in this process, in a folder that `cd` changes.

    Attributes:
        folder: where the next line runs.
        demo: what the demo leaves; copied where a page makes it.
        names: of the snippets, which belong together.
    """

    folder: Path
    demo: Path
    names: dict[str, object] = field(default_factory=dict[str, object])

    def run(self, block: Block) -> None:
        """What the block does.

        Raises:
            AssertionError: a command failed.
        """
        if block.kind == "python":
            with contextlib.chdir(self.folder), contextlib.redirect_stdout(io.StringIO()):
                exec(compile("\n" * block.line + block.code, str(block.page), "exec"), self.names)
        elif block.kind == "sh":
            for line, code in block.lines():
                self._line(line, code, block)

    def _line(self, line: str, code: int, block: Block) -> None:
        if line.startswith("cd "):
            self.folder = (self.folder / line[3:].strip()).resolve()
            assert self.folder.is_dir(), f"{block}: {line}: there is no such folder"
        elif made := _DEMO.match(line):
            name = "demo" if line.startswith("make") else made["folder"] or "palpate_demo"
            shutil.copytree(self.demo, self.folder / name)
        elif line.startswith("palpate "):
            self._call(line, code, block)
        elif not _ELSEWHERE.match(line):
            done = subprocess.run(["bash", "-c", line], cwd=self.folder, capture_output=True, text=True)
            assert done.returncode == 0, f"{block}: {line}: {done.stderr}"

    def _call(self, line: str, wanted: int, block: Block) -> None:
        words, _, file = line.partition(" > ")
        out, err = io.StringIO(), io.StringIO()
        with (
            contextlib.chdir(self.folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            unserved(),
        ):
            code = main(shlex.split(words)[1:])
        if file:
            (self.folder / file.strip()).write_text(out.getvalue(), encoding="utf-8")
        assert code == wanted, f"{block}: {line}: exit code {code}: {err.getvalue()}"


def unseen(shown: str, printed: list[str]) -> list[str]:
    """The lines of what a page shows that are not among what was printed: the same words, and numbers that agree."""
    lines = [line for line in shown.splitlines() if line.strip()]
    return [line for line in lines if not any(_alike(line, other) for other in printed)]


def _alike(line: str, other: str) -> bool:
    """Whether a line says what another does: the same words, and numbers that agree; what `...` stands for is free."""
    words, others = line.split(), other.split()
    if "..." in words:
        rest = iter(others)
        return all(any(_agree(word, each) for each in rest) for word in words if word != "...")
    return len(words) == len(others) and all(map(_agree, words, others))


def _agree(one: str, other: str) -> bool:
    a, b = (re.sub(r"[^\d.e-]", "", word) for word in (one, other))
    try:
        return math.isclose(float(a), float(b), rel_tol=_AGREE, abs_tol=_ROUNDED)
    except ValueError:
        return one == other


@contextlib.contextmanager
def unserved() -> Iterator[list[object]]:
    """What `palpate view` would have served: all that is called serve... in its module gives its scene here."""
    module = importlib.import_module("palpate.cli.view")
    scenes: list[object] = []
    with contextlib.ExitStack() as stack:
        for name in [name for name in vars(module) if name.startswith("serve")]:
            stack.enter_context(mock.patch.object(module, name, lambda scene, *_, **__: scenes.append(scene)))
        yield scenes
