"""Play steps in the folder of their inputs, with whichever Palpate is imported, and record what each printed and wrote.

Nothing but the command line and the front door is called, so that one file plays an older and a newer Palpate.
`python play.py STEPS.json FOLDER`; a step is a name, a folder of its inputs, and words of a command or a function of
this file.
"""

import contextlib
import importlib
import importlib.util
import io
import json
import os
import re
import sys
import traceback
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from palpate.cli import main

REST, SAMPLES = 0.25, 200  # s at the start of a log in which nothing touches; samples of a loop
BESIDE = ("orientation", "position", "acceleration", "unsteady")  # channels that are no reading of the sensor
GROUP = re.compile(r"^  ([a-z][\w-]*) ", re.MULTILINE)


def play(steps: list[dict[str, Any]], folder: Path) -> None:
    """Play each step in its folder; what it printed, and how it ended, goes to the folder `printed`."""
    printed = folder / "printed"
    printed.mkdir()
    for step in steps:
        os.chdir(folder / step["folder"])
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("always")
            try:
                code: Any = main(step["words"]) if "words" in step else PYTHON[step["python"]](*step["given"])
            except BaseException as problem:  # whatever it is, it is what is compared
                code = "".join(traceback.format_exception_only(problem)).strip()
        text = f"{' '.join(step.get('words', [step.get('python', '')]))}\n{code}\n{out.getvalue()}\n{err.getvalue()}"
        (printed / f"{step['name']}.txt").write_text(text)


def helps() -> None:
    """Print the help of every command."""

    def printed(*words: str) -> None:
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
            main([*words, "--help"])
        print(shown.getvalue())
        for name in GROUP.findall(shown.getvalue().partition("\ncommands:\n")[2]):
            printed(*words, name)

    printed()


def front_door(log: str, rig: str) -> None:
    """Save what `estimate`, blocks and single samples find in a log, and print the notes."""
    found = palpate.estimate(log, rig)
    _save("python_line", [found])
    print(*found.notes, sep="\n")
    known = palpate.load_rig(rig)
    with palpate.open_log(log, known) as opened:
        _save("python_blocks", known.estimator(opened).stream(opened))
    with palpate.open_log(log, known) as opened:
        first = next(iter(opened))
    live: Any = known.estimator(rate=100.0)
    live.tare(first.picked(first.time <= first.time[0] + REST))
    given = list(samples(live.channels, first.picked(slice(SAMPLES))))
    rows = live.empty(*([live.most] if hasattr(live, "most") else []))
    _save("python_live", [live.update(*sample) for sample in given])
    live.reset()
    for sample in given:
        count = live.update_into(*sample[:2], rows, *sample[2:])
        print(
            count,
            " ".join(value.hex() for value in np.ravel(rows[: max(count, 1)] if rows.ndim > 1 else rows).tolist()),
        )


def samples(channels: tuple[str, ...], recording: Any) -> Iterator[tuple[Any, ...]]:
    """Time, reading, rotation and acceleration of each sample, as `update` takes them."""
    columns = [recording.channels[name] for name in channels if name not in BESIDE]
    flat = [values.reshape(len(values), -1) for values in columns]
    none = [None] * len(recording)
    turns = recording.channels.get("orientation")
    rotations = none if turns is None else palpate.Pose.from_quaternion(turns, np.zeros(3)).rotation
    readings = columns[0] if len(columns) == 1 else np.concatenate(flat, axis=1)
    yield from zip(
        recording.time.tolist(), readings, rotations, recording.channels.get("acceleration", none), strict=True
    )


def _save(name: str, parts: Iterable[palpate.Contacts]) -> None:
    contacts = palpate.Contacts.joined(list(parts))
    contacts.to_polars().write_parquet(f"{name}.parquet")
    np.save(f"{name}.npy", contacts.rows())


def added(module: str) -> None:
    """Add the sensor of a module to Palpate's: by its entry point, or by importing it, as it was before."""
    outside = Path(palpate.__file__).parents[2] / "tests" / "conformance" / "outside"
    if outside.exists():
        sys.path.append(str(outside))
        place = "setup" if importlib.util.find_spec("palpate.setup") else "io.rig"  # until 44
        kinds: Any = importlib.import_module(f"palpate.{place}.kinds").KINDS
        kinds._complete = False  # the package joins now, not when this process began
    importlib.import_module(module)


def as_table(contacts: str) -> None:
    """Write a record's contacts as a table: its own messages bear the time of the run."""
    found = palpate.Contacts.load(contacts)
    found.to_polars().write_parquet(f"{contacts}.parquet")


PYTHON = {each.__name__: each for each in (helps, front_door, added, as_table)}

if __name__ == "__main__":
    play(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]).resolve())
