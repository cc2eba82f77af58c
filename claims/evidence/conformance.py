"""The matrix: every field of every sensor works, or is refused with a reason that is physics. See tests/conformance."""

import json
import subprocess
import sys
from collections.abc import Iterator

from claims.row import ROOT, Row

WORKS, FAILS = "works", "FAILS"
# Taken on 2026-11-21 with OLD a checkout of the last commit before the redesign (322154f, version 0.3.0), here:
# PYTHONPATH=.:OLD/src python -m tests.conformance six-axis "load cells" skin. Calls that it lacks fail.
BEFORE = {"six-axis": 17, "load cells": 9, "skin": 6}
FIELDS = 20  # of each sensor, then


def rows(small: bool) -> Iterator[Row]:
    """A row a field, over all sensors; small takes one sensor, that is made in no time."""
    found = _matrix(["plate"] if small else [])
    fields, sensors = (list(dict.fromkeys(entry[key] for entry in found)) for key in ("field", "sensor"))
    verdicts = {(entry["field"], entry["sensor"]): entry["verdict"] for entry in found}
    for field in fields:
        got = {sensor: verdicts[field, sensor] for sensor in sensors}
        said = "; ".join(sensor if verdict == WORKS else f"{sensor} {verdict}" for sensor, verdict in got.items())
        passed = not any(verdict.startswith(FAILS) for verdict in got.values())
        yield Row(field, "every sensor, or physics says why not", said, passed)
    good = {sensor: sum(not verdicts[field, sensor].startswith(FAILS) for field in fields) for sensor in sensors}
    counts = ", ".join(f"{sensor} {count}" for sensor, count in good.items())
    before = ", ".join(f"{sensor} {count}" for sensor, count in BEFORE.items())
    got = f"{counts} of {len(fields)} each; before: {before} of {FIELDS} each"
    yield Row("fields that work", "all", got, sum(good.values()) == len(verdicts))


def _matrix(sensors: list[str]) -> list[dict[str, str]]:
    """Of a process of its own: sensors that are not Palpate's are added to its table there."""
    command = [sys.executable, "-m", "tests.conformance", "--json", *sensors]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if not done.stdout:
        raise RuntimeError(f"no matrix: {done.stderr}")
    return json.loads(done.stdout)
