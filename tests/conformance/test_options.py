"""No option is ignored: it is refused with a sentence that names it, or it changes what comes out."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from tests.conformance.fields import Case, Refused, run
from tests.conformance.sensors import SENSORS, Sensor

OPTIONS = {  # of `estimate` and `view` -> values that no rig here states
    "--payload": ("nope.toml",),
    "--noise": ("0.5", "0.05"),
    "--unit": ("mm",),
    "--crease": ("11",),
    "--method": ("wrench_axis",),
    "--friction": ("0.3",),
    "--torsion": ("1e-5",),
    "--contact": ("1.9", "1.1"),
    "--filter": ("kalman",),
    "--cutoff": ("7",),
    "--tare": ("0.25",),
}
SENSOR = pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)


@SENSOR
@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_is_applied_or_refused(case_of: Callable[[Sensor], Case], sensor: Sensor, option: str) -> None:
    case = case_of(sensor)
    plain = case.estimate()
    said, changed = "", plain
    try:
        changed = case.estimate(".csv", option, *OPTIONS[option])
    except Refused as problem:
        said = str(problem)
    if said:
        assert _named(option, said), said
    else:
        assert option not in sensor.ignores, "it means nothing to this sensor, and was not refused"
        assert changed.read_text() != plain.read_text() or _record(changed) != _record(plain)


@SENSOR
def test_a_payload_that_is_not_there_is_never_overlooked(case_of: Callable[[Sensor], Case], sensor: Sensor) -> None:
    case = case_of(sensor)
    for command in (("estimate", "-o", str(case.files.folder / "x.csv")), ("view", "--port", "0")):
        with pytest.raises(Refused, match=r"payload|nope\.toml"):
            run(command[0], str(case.files.log), "--rig", str(case.files.rig), "--payload", "nope.toml", *command[1:])


@pytest.mark.parametrize("sensor", [sensor for sensor in SENSORS if sensor.table != "marker_ring"])
def test_a_log_of_another_sensor_is_one_sentence(case_of: Callable[[Sensor], Case], sensor: Sensor) -> None:
    """Each rig is given a log that has nothing but times and poses."""
    case = case_of(sensor)
    other = case.files.folder / "other.csv"
    pl.read_csv(case.files.log).select("time", "qx", "qy", "qz", "qw", "x", "y", "z").write_csv(other)
    with pytest.raises(Refused, match=r"column"):
        run("estimate", str(other), "--rig", str(case.files.rig), "-o", str(case.files.folder / "x.csv"))


def _named(option: str, sentence: str) -> bool:
    """Whether a sentence is about this option."""
    return option in sentence or option.removeprefix("--") in sentence or "nope.toml" in sentence


def _record(contacts: Path) -> dict[str, object]:
    """What stands beside contacts."""
    return tomllib.loads(contacts.with_name(f"{contacts.name}.toml").read_text())
