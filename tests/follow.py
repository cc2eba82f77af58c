"""Pages followed word by word, as a newcomer would: every block, in order, in a fresh folder, by a shell of its own.

Run: `python -m tests.follow [PAGE...]`, or `make follow`; README.md and the tutorials without a word. Minutes; what fails
is listed at the end, and the exit code is 1. `pip install` and `make` are not typed again: the environment is the one that
this runs in, and of `make demo` the command that it stands for. What serves until Ctrl-C is interrupted once it serves.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.blocks import PAGES, ROOT, Block, blocks

SERVES = re.compile(r"palpate (view|replay)\b|palpate live\b.*--view")
PATIENCE = 300.0  # s, of a page that is to be served
STANDS_FOR = {"make demo": "python examples/demo.py --no-view", ". .venv/bin/activate": "true"}
BESIDE = ("examples",)  # what a clone has, and pages name


def main() -> int:
    """Each page, and what of it failed."""
    asked = [Path(word).resolve() for word in sys.argv[1:]]
    pages = asked or [page for page in PAGES if page.name == "README.md" or page.parent.name == "tutorials"]
    failed = [wrong for page in pages for wrong in _follow(page)]
    _say(f"\n{len(failed)} blocks failed" + "".join(f"\n  {wrong}" for wrong in failed))
    return bool(failed)


@dataclass
class _Shell:
    """Where the reader is, and what was typed there."""

    folder: Path
    snippets: list[str] = field(default_factory=list[str])

    def type(self, line: str, wanted: int) -> str | None:
        """What went wrong with a line; None where nothing did."""
        if line.startswith("cd "):
            self.folder = (self.folder / line[3:].strip()).resolve()
            return None if self.folder.is_dir() else "there is no such folder"
        if SERVES.match(line):
            return self._served(line)
        line = STANDS_FOR.get(line, line)
        if line.startswith("palpate demo") and "--no-view" not in line:
            line += " --no-view"
        if line.startswith("pip install"):
            return None
        done = subprocess.run(["bash", "-c", line], cwd=self.folder, env=_environment(), capture_output=True, text=True)
        _say(done.stdout)
        return None if done.returncode == wanted else f"exit code {done.returncode}: {done.stderr.strip()[-500:]}"

    def _served(self, line: str) -> str | None:
        """It says where it serves, and ends at Ctrl-C."""
        out = self.folder / ".served"
        with out.open("w") as file:
            running = subprocess.Popen(
                ["bash", "-c", f"exec {line}"], cwd=self.folder, env=_environment(), stdout=file, stderr=file
            )
        until = time.monotonic() + PATIENCE
        while running.poll() is None and "127.0.0.1" not in out.read_text() and time.monotonic() < until:
            time.sleep(0.5)
        if running.poll() is not None:
            return f"ended by itself: {out.read_text()[-500:]}"
        running.send_signal(signal.SIGINT)
        running.wait(60)
        return None if "127.0.0.1" in out.read_text() else "nothing was served"

    def snippet(self, code: str) -> str | None:
        """Snippets of a page belong together: each runs behind those before it."""
        self.snippets.append(code)
        done = subprocess.run(
            [sys.executable, "-c", "\n".join(self.snippets)],
            cwd=self.folder,
            env=_environment(),
            capture_output=True,
            text=True,
        )
        _say(done.stdout)
        return None if done.returncode == 0 else done.stderr.strip()[-500:]


def _follow(page: Path) -> list[str]:
    _say(f"\n=== {page.relative_to(ROOT)}")
    failed: list[str] = []
    with tempfile.TemporaryDirectory(prefix="follow_") as made:
        for name in BESIDE:
            (Path(made) / name).symlink_to(ROOT / name)
        shell = _Shell(Path(made))
        for block in blocks(page):
            if block.mark != "not run" and block.kind in ("sh", "python"):
                failed += _block(shell, block)
    return failed


def _block(shell: _Shell, block: Block) -> list[str]:
    if block.kind == "python":
        _say(f"--- {block}: python")
        wrong = shell.snippet(block.code)
        return [] if wrong is None else [f"{block}: {wrong}"]
    failed: list[str] = []
    for line, wanted in block.lines():
        _say(f"--- {block}: $ {line}")
        wrong = shell.type(line, wanted)
        failed += [] if wrong is None else [f"{block}: {line}: {wrong}"]
    return failed


def _environment() -> dict[str, str]:
    """This environment's programs first, and the package of this tree."""
    return os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT / "src"),
    }


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n" if text and not text.endswith("\n") else text)
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
