"""A sensor's files are made once a session; whoever cannot be made fails each of its tests with the reason."""

from collections.abc import Callable

import pytest

from tests.conformance.fields import Case
from tests.conformance.sensors import Sensor

_CASES = pytest.StashKey[dict[str, Case | Exception]]()


@pytest.fixture
def case_of(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[Sensor], Case]:
    """The sensor's files."""
    cases = request.config.stash.setdefault(_CASES, {})

    def found(sensor: Sensor) -> Case:
        if sensor.name not in cases:
            try:
                cases[sensor.name] = Case.of(sensor, tmp_path_factory.mktemp("sensor") / "files")
            except Exception as problem:
                cases[sensor.name] = problem
        case = cases[sensor.name]
        if isinstance(case, Exception):
            raise case
        return case

    return found
