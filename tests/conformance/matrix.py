"""Every sensor by every field, as a table and a count."""

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.conformance.fields import FIELDS, Case, judged
from tests.conformance.sensors import SENSORS, Sensor

WORKS, REFUSED, FAILS = "works", "refused", "FAILS"


@dataclass(frozen=True)
class Entry:
    """One field of the matrix: `verdict` is "works", "refused: why" or "FAILS: the first line of what it said"."""

    sensor: str
    field: str
    verdict: str

    @property
    def good(self) -> bool:
        """It works, or physics refuses it."""
        return not self.verdict.startswith(FAILS)


def matrix(sensors: tuple[Sensor, ...] = SENSORS) -> Iterator[Entry]:
    """Every field of every sensor, in a folder that is removed afterwards."""
    with tempfile.TemporaryDirectory() as scratch:
        for number, sensor in enumerate(sensors):
            folder = Path(scratch) / str(number)
            case: Case | Exception = _made(sensor, folder)
            for field in FIELDS:
                yield Entry(sensor.name, field, _verdict(case, field).replace(f"{folder}/", ""))


def table(entries: list[Entry]) -> str:
    """A line a field, a column a sensor; then each failure, and the counts."""
    names = list(dict.fromkeys(entry.sensor for entry in entries))
    verdicts = {(entry.field, entry.sensor): entry.verdict.split(":", 1)[0] for entry in entries}
    width = max(map(len, FIELDS))
    lines = [" " * width + "  " + "".join(f"{name:<12}" for name in names)]
    lines += [f"{field:<{width}}  " + "".join(f"{verdicts[field, name]:<12}" for name in names) for field in FIELDS]
    alike: dict[tuple[str, str], list[str]] = {}
    for entry in entries:
        if entry.verdict != WORKS:
            alike.setdefault((entry.sensor, entry.verdict), []).append(entry.field)
    lines += ["", *(f"{sensor}, {', '.join(fields)}: {verdict}" for (sensor, verdict), fields in alike.items())]
    good = {name: sum(entry.good for entry in entries if entry.sensor == name) for name in names}
    counts = ", ".join(f"{name} {count}" for name, count in good.items())
    return "\n".join([*lines, "", f"{sum(good.values())} of {len(entries)} ({counts}; of {len(FIELDS)} each)"])


def _made(sensor: Sensor, folder: Path) -> Case | Exception:
    try:
        return Case.of(sensor, folder)
    except Exception as problem:  # whatever it is, every field of this sensor has it
        return problem


def _verdict(case: Case | Exception, field: str) -> str:
    try:
        if isinstance(case, Exception):
            raise case
        return judged(case, field)
    except (Exception, SystemExit) as problem:  # a traceback, for who types the command
        said = re.sub(r"\s+", " ", str(problem)).strip()[:160]
        kind = "" if isinstance(problem, AssertionError) else f"{type(problem).__name__}: "
        return f"{FAILS}: {kind}{said}"
