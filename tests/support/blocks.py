"""The code in pages, README and all: found, read as calls, and run in order as somebody who follows the page would.

A fenced block of `sh` or `python` runs, unless a comment on the line above it says why not: `<!-- not run: a robot -->`
never, `<!-- by hand: minutes -->` only by `python -m tests.follow`. The calls of a block of `text` are templates. Every
call of `palpate`, in whatever block, is one that the command line takes.
"""

import contextlib
import functools
import importlib
import io
import re
import runpy
import shlex
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import tyro

from palpate.cli import main
from palpate.cli.app import COMMANDS, join_others

join_others()

ROOT = Path(__file__).resolve().parents[2]
PAGES = tuple(
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if "_build" not in page.relative_to(ROOT).parts
)
_FENCED = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_MARK = re.compile(r"<!-- (not run|by hand): .+ -->\s*$")
_ELSEWHERE = re.compile(r"pip install |\. \.venv/bin/activate$|python examples/(?!made_logs)")  # have own tests
_MADE_LOG = re.compile(r"python (examples/made_logs\.py) (\w+)")
_DEMO = re.compile(r"make demo\b|palpate demo\b(?:.* -o (?P<folder>\S+))?")
_CODE = re.compile(r"#.*exit code (\d+)")  # a comment on a call that is to leave so
_COVERAGE = re.compile(r"95 % .*(hold|inside|truth)")
_NUMBER = re.compile(r"-?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?")
_THOUSAND = 1000.0  # counts of samples from here on differ by one between machines


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
        elif made := _MADE_LOG.match(line):
            with contextlib.chdir(self.folder):
                runpy.run_path(str(ROOT / made[1]))["MAKERS"][made[2]]()
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
        assert code == wanted, f"{block}: {line}: exit code {code}: {err.getvalue()}{out.getvalue()}"


def unseen(shown: str, printed: Iterable[str]) -> list[str]:
    """The lines of what a page shows that are not among what was printed: the same words, and numbers that agree."""
    lines = [line for line in shown.splitlines() if line.strip()]
    known = list(printed)
    return [line for line in lines if not any(_alike(line, other) for other in known)]


def uncovered(shown: str, outputs: Sequence[Sequence[str]]) -> list[str]:
    """The lines on coverage that a page leaves out of the outputs that it shows; a line is of the last that has it."""
    lines = [line for line in shown.splitlines() if line.strip()]
    from_these = {
        max((k for k, output in enumerate(outputs) if any(_alike(line, each) for each in output)), default=-1)
        for line in lines
    }
    due = [each for k in from_these if k >= 0 for each in outputs[k] if _COVERAGE.search(each)]
    return [each for each in due if not any(_alike(line, each) for line in lines)]


def _alike(line: str, other: str) -> bool:
    """Whether a line says what another does: the same words, and numbers that agree; what `...` stands for is free."""
    words, others = line.split(), other.split()
    if "..." in words:
        rest = iter(others)
        return all(any(_agree(word, each) for each in rest) for word in words if word != "...")
    return len(words) == len(others) and all(map(_agree, words, others))


def _agree(one: str, other: str) -> bool:
    """Whether two words are equal but for one unit of the last digit that the page shows of fractions and thousands."""
    if one == other:
        return True
    if _NUMBER.sub("", one) != _NUMBER.sub("", other):
        return False
    return all(_close(a, b) for a, b in zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True))


def _close(shown: str, printed: str) -> bool:
    a, b = (float(text.replace(",", "")) for text in (shown, printed))
    digits, _, power = shown.partition("e")
    decimals = len(digits.partition(".")[2])
    unit = 10.0 ** (int(power or 0) - decimals) if decimals or abs(a) >= _THOUSAND else 0.0
    return abs(a - b) <= (1 + 1e-6) * unit


@contextlib.contextmanager
def unserved() -> Iterator[list[object]]:
    """What `palpate view` would have served: all that is called serve... in its module gives its scene here."""
    module = importlib.import_module("palpate.cli.view")
    scenes: list[object] = []
    with contextlib.ExitStack() as stack:
        for name in [name for name in vars(module) if name.startswith("serve")]:
            stack.enter_context(mock.patch.object(module, name, lambda scene, *_, **__: scenes.append(scene)))
        yield scenes
