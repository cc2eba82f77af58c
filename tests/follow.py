"""Pages followed word by word, as a newcomer would: every block, in order, in a fresh folder, by a shell of its own.

Run: `python -m tests.follow [--clone] [today | PAGE...]`, or `make follow`; without a word the README, the quick start,
the tutorials and the pages of docs/from, `today` the one of these whose turn it is. Minutes; what fails is listed at
the end, and the exit code is 1. What a page shows of the output is looked for in what was printed, numbers to the last
digit that it shows; where an output has coverage, the page must show it. What serves until Ctrl-C is interrupted once
it serves.

A line that prints nothing for more than two seconds fails, too; its stderr is a terminal. On a machine that has more to
do than processors, and of the page of today, that is shown and fails nothing.

`pip install` and `make` are not typed again: the environment is the one that this runs in, and of `make demo` the
command that it stands for. With `--clone` they are: in a clone of the last commit and a new environment, from the
registry.
"""

import errno
import os
import pty
import re
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from tests.support.blocks import PAGES, ROOT, Block, blocks, uncovered, unseen

SERVES = re.compile(r"palpate (view|replay)\b|palpate live\b.*--view")
ACTIVATE = ". .venv/bin/activate"
PATIENCE = 300.0  # s, of a page that is to be served
SILENT = 2.0  # s without a word that a line may take
STANDS_FOR = {"make demo": "python examples/demo.py --no-view", ACTIVATE: "true"}
CHAOTIC = "touch_navigation"  # another processor's last bits lead the robot elsewhere
BESIDE = ("examples",)  # what a clone has, and pages name


def main() -> int:
    """Each page, and what of it failed."""
    words = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # started in the background, it is ignored, here and below
    cloned = "--clone" in words
    usual, named = _usual(), [word for word in words if word not in ("--clone", "today")]
    if "today" in words:
        turns = [page for page in usual if blocks(page) and page.stem != CHAOTIC]
        usual = [turns[time.localtime().tm_yday % len(turns)]]
    pages, timed = [Path(word).resolve() for word in named] or usual, "today" not in words
    failed = [wrong for page in pages for wrong in _follow(page, cloned, timed)]
    _say(f"\n{len(failed)} failed" + "".join(f"\n  {wrong}" for wrong in failed))
    return bool(failed)


def _usual() -> list[Path]:
    return [p for p in PAGES if p.name in ("README.md", "quickstart.md") or p.parent.name in ("tutorials", "from")]


@dataclass
class _Shell:
    """Where the reader is, what was typed there, and what was printed.

    Attributes:
        folder: where the next line runs.
        environment: of what runs.
        cloned: lines are typed as they stand, in a clone.
        timed: silence fails a line.
    """

    folder: Path
    environment: dict[str, str]
    cloned: bool
    timed: bool
    snippets: list[str] = field(default_factory=list[str])
    printed: list[list[str]] = field(default_factory=list[list[str]])  # lines of each output
    silent: float = 0.0  # s, the longest while of the last line in which it printed nothing

    def type(self, line: str, wanted: int) -> str | None:
        """What went wrong with a line; None where nothing did."""
        if line.startswith("cd "):
            self.folder = (self.folder / line[3:].strip()).resolve()
            return None if self.folder.is_dir() else "there is no such folder"
        if SERVES.match(line):
            return self._served(line)
        if not self.cloned:
            line = "true" if line.startswith("pip install") else STANDS_FOR.get(line, line)
        elif line.startswith(ACTIVATE):
            self.environment = _first(self.folder / ".venv/bin", self.environment)
        if line.startswith("palpate demo") and "--no-view" not in line:
            line += " --no-view"
        done = self._run(["bash", "-c", line])
        if self.timed and self.silent > SILENT and os.getloadavg()[0] <= (os.cpu_count() or 1):
            return f"printed nothing for {self.silent:.1f} s"
        code = done.returncode if done.returncode >= 0 else 128 - done.returncode  # as a shell says that it was killed
        return None if code == wanted else f"exit code {code}: {done.stderr.strip()[-500:]}"

    def snippet(self, code: str) -> str | None:
        """Snippets of a page belong together: each runs behind those before it."""
        self.snippets.append(code)
        done = self._run(["python", "-c", "\n".join(self.snippets)])
        return None if done.returncode == 0 else done.stderr.strip()[-500:]

    def _run(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        done, self.silent = heard(words, self.folder, self.environment)
        self._heard(done.stdout, done.stderr)
        return done

    def _heard(self, *said: str) -> None:
        self.printed.append([line for text in said for line in text.splitlines()])
        _say(said[0])

    def _served(self, line: str) -> str | None:
        """It says where it serves, and ends at Ctrl-C."""
        out = self.folder / ".served"
        with out.open("w") as file:
            running = subprocess.Popen(
                ["bash", "-c", f"exec {line}"], cwd=self.folder, env=self.environment, stdout=file, stderr=file
            )
        until = time.monotonic() + PATIENCE
        while running.poll() is None and "127.0.0.1" not in out.read_text() and time.monotonic() < until:
            time.sleep(0.5)
        if running.poll() is not None:
            return f"ended by itself: {out.read_text()[-500:]}"
        running.send_signal(signal.SIGINT)
        running.wait(60)
        said = out.read_text()
        self._heard(said)
        return None if "127.0.0.1" in said else "nothing was served"


def _follow(page: Path, cloned: bool, timed: bool) -> list[str]:
    _say(f"\n=== {page.relative_to(ROOT)}")
    failed: list[str] = []
    with tempfile.TemporaryDirectory(prefix="follow_") as made:
        shell = _cloned(Path(made), timed) if cloned else _here(Path(made), timed)
        for block in blocks(page):
            if block.mark != "not run":
                failed += _block(shell, block)
    return failed


def _here(folder: Path, timed: bool) -> _Shell:
    """A new folder, this environment's programs, and the package of this tree."""
    for name in BESIDE:
        (folder / name).symlink_to(ROOT / name)
    environment = _first(Path(sys.executable).parent, dict(os.environ))
    return _Shell(folder, environment | {"PYTHONPATH": str(ROOT / "src")}, cloned=False, timed=timed)


def _cloned(folder: Path, timed: bool) -> _Shell:
    """A clone, and an environment that has pip and nothing else."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder / "palpate")], check=True)
    base = Path(sys.base_prefix) / "bin" / f"python3.{sys.version_info.minor}"
    subprocess.run([str(base), "-m", "venv", str(folder / "environment")], check=True)
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return _Shell(folder / "palpate", _first(folder / "environment/bin", environment), cloned=True, timed=timed)


def _block(shell: _Shell, block: Block) -> list[str]:
    if block.kind == "python":
        _say(f"--- {block}: python")
        wrong = shell.snippet(block.code)
        return [] if wrong is None else [f"{block}: {wrong}"]
    if block.kind == "text" and not block.calls():
        stale = [f"{block}: nothing printed this: {line}" for line in unseen(block.code, chain(*shell.printed))]
        return stale + [f"{block}: leaves out: {line}" for line in uncovered(block.code, shell.printed)]
    failed: list[str] = []
    for line, wanted in block.lines() if block.kind == "sh" else ():
        _say(f"--- {block}: $ {line}")
        start, used, shell.silent = time.monotonic(), _used(), 0.0
        wrong = shell.type(line, wanted)
        took = f"{time.monotonic() - start:.1f} s, {_used() - used:.1f} s of CPU, silent for {shell.silent:.1f} s"
        _say(f"    ({took}, load {os.getloadavg()[0]:.1f})")
        failed += [] if wrong is None else [f"{block}: {line}: {wrong}"]
    return failed


def heard(
    words: Sequence[str], folder: Path, environment: Mapping[str, str]
) -> tuple[subprocess.CompletedProcess[str], float]:
    """What a program printed, with a terminal as its stderr, and the longest while [s] in which it printed nothing."""
    master, terminal = pty.openpty()
    surroundings = {**environment, "PYTHONUNBUFFERED": "1"}
    texts, longest, last = {"stdout": bytearray(), "stderr": bytearray()}, 0.0, time.monotonic()
    with (
        open(master, "rb", buffering=0) as screen,
        subprocess.Popen(words, cwd=folder, env=surroundings, stdout=subprocess.PIPE, stderr=terminal) as running,
        selectors.DefaultSelector() as waited,
    ):
        os.close(terminal)
        assert running.stdout is not None
        waited.register(running.stdout, selectors.EVENT_READ, "stdout")
        waited.register(screen, selectors.EVENT_READ, "stderr")
        while waited.get_map():
            for key, _ in waited.select():
                try:
                    piece = os.read(key.fd, 1 << 16)
                except OSError as problem:
                    if problem.errno != errno.EIO:  # a terminal that nobody writes to any more
                        raise
                    piece = b""
                now = time.monotonic()
                longest, last = max(longest, now - last), now
                texts[key.data] += piece
                if not piece:
                    waited.unregister(key.fileobj)
    shown = {name: text.decode(errors="replace").replace("\r\n", "\n") for name, text in texts.items()}
    return subprocess.CompletedProcess(list(words), running.returncode, **shown), longest


def _used() -> float:
    """[s] of CPU, of what was started here and has ended."""
    times = os.times()
    return times.children_user + times.children_system


def _first(programs: Path, environment: dict[str, str]) -> dict[str, str]:
    return environment | {"PATH": f"{programs}{os.pathsep}{environment['PATH']}"}


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n" if text and not text.endswith("\n") else text)
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
