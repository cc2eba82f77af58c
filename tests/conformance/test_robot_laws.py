"""Each sensor as the only one of a robot gives what it gives alone, to the last bit."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.contact.contacts import Contacts
from tests.conformance.fields import Case
from tests.conformance.sensors import SENSORS, Sensor


def as_robot(rig: Path, name: str) -> Path:
    """Write the tables of a rig as those of a robot's sensor, next to it."""
    text = re.sub(r"(?m)^(\s*)\[(?=[a-z])", rf"\1[sensors.{name}.", rig.read_text())
    robot = rig.with_name(f"robot_{rig.name}")
    robot.write_text(text)
    return robot


def assert_same(found: Contacts, alone: Contacts, count: int = 1, place: int = 0) -> None:
    """Assert equal rows; identities are those of sensor number `place` of `count`."""
    np.testing.assert_array_equal(found.identity, alone.identity * count + place)
    np.testing.assert_array_equal(found.rows()[:, :-1], alone.rows()[:, :-1])
    np.testing.assert_array_equal(found.time, alone.time)
    np.testing.assert_array_equal(found.sample, alone.sample)


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
def test_a_robot_of_one_sensor_answers_as_its_rig(sensor: Sensor, case_of: Callable[[Sensor], Case]) -> None:
    files = case_of(sensor).files
    alone = palpate.estimate(files.log, files.rig)
    found = palpate.estimate(files.log, as_robot(files.rig, "finger"))
    assert_same(found, alone)
    assert set(found.sensor) == {"finger"}
    touches, known = found.touches(), alone.touches()
    np.testing.assert_array_equal(touches.point, known.point)
    assert list(touches.sensor) == ["finger"] * len(known)
