"""Every field of every sensor: a right answer, or a sentence with a reason that is physics."""

from collections.abc import Callable

import pytest

from tests.conformance.fields import FIELDS, Case, judged
from tests.conformance.sensors import SENSORS, Sensor


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
def test_it_works_or_physics_refuses_it(case_of: Callable[[Sensor], Case], sensor: Sensor, field: str) -> None:
    judged(case_of(sensor), field)
