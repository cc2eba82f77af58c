"""`python -m tests.way COMMAND ...`: the way of a rig from a command to the estimator of its sensor.

Run the command twice and watch the second run, with everything imported: which files are called between command and
estimator, which of them call a file on a floor above their own, and how many Python frames lie between the command and
the first answer.
"""

import sys
import tomllib
from contextlib import redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import palpate
from palpate.cli import main
from palpate.contact.estimator import ContactEstimator

ROOT = Path(palpate.__file__).parent
FUNCTION = 0x1  # flag of code that is a function's, not a class body's
DECORATORS = ("calls.py", "spatial/arguments.py", "interrupts.py", "surfaces/_jit.py")  # they call what they wrap


def floors() -> dict[str, int]:
    """Return the floor of each room, the lowest 0, as import-linter has them."""
    stated = tomllib.loads((ROOT.parents[1] / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in stated if "layers" in each)
    rooms = [[name.strip(" ()").removeprefix("palpate.") for name in layer.split("|")] for layer in reversed(layers)]
    return {room: floor for floor, layer in enumerate(rooms) for room in layer}


class Watch:
    """Watch the calls of one run."""

    def __init__(self) -> None:
        self.calls, self.built, self.depth = list[tuple[str, str]](), False, 0

    def __call__(self, frame: FrameType, event: str, arg: Any) -> None:
        """See a call."""
        if event != "call" or self.depth or not _ours(frame.f_code):
            return
        above = _caller(frame)
        if not self.built:
            self.calls.append(("" if above is None else _file(above.f_code), _file(frame.f_code)))
            self.built = _is_of_estimator(frame, "__init__")
        elif _is_of_estimator(frame, "answer"):
            while above is not None:
                above, self.depth = _caller(above), self.depth + 1


def _ours(code: CodeType) -> bool:
    return bool(code.co_flags & FUNCTION) and code.co_filename.startswith(str(ROOT)) and _file(code) not in DECORATORS


def _file(code: CodeType) -> str:
    return str(Path(code.co_filename).relative_to(ROOT))


def _caller(frame: FrameType) -> FrameType | None:
    above = frame.f_back
    while above is not None and not _ours(above.f_code):
        above = above.f_back
    return above


def _is_of_estimator(frame: FrameType, name: str) -> bool:
    made = frame.f_locals.get("self")
    return (
        frame.f_code.co_name == name
        and isinstance(made, ContactEstimator)
        and _file(frame.f_code) != "contact/estimator.py"
    )


def _run(arguments: list[str]) -> None:
    sys.argv = ["palpate", *arguments]
    with redirect_stdout(StringIO()), suppress(SystemExit):
        main()


def measured(arguments: list[str]) -> tuple[set[str], set[tuple[str, str]], int]:
    """Return the files that were called, the pairs of files of calls that climb, and the frames above an answer."""
    _run(arguments)
    watch, floor = Watch(), floors()
    sys.setprofile(watch)
    try:
        _run(arguments)
    finally:
        sys.setprofile(None)
    rooms = [(floor.get(one.partition("/")[0], 0), floor.get(other.partition("/")[0], 0)) for one, other in watch.calls]
    climbs = {call for call, (one, other) in zip(watch.calls, rooms, strict=True) if call[0] and other > one}
    return {file for _, file in watch.calls}, climbs, watch.depth


if __name__ == "__main__":
    files, climbs, depth = measured(sys.argv[1:])
    print(f"{len(files)} files: {', '.join(sorted(files))}")
    print(f"{len(climbs)} climbs: {', '.join(f'{one} -> {other}' for one, other in sorted(climbs))}")
    print(f"{depth} frames from the command to the first answer")
