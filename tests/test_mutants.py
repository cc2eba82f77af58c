"""The stated faults stand where they say, and the switch turns them on in Python and in compiled code alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numba import njit

from mutants.build import ROOT, sources
from mutants.fault import Fault, written
from mutants.faults import FAULTS
from mutants.switch import turn_on

SOURCE = '''"""Words."""
from __future__ import annotations

def judged(x, out):
    """More words."""
    if x > 2:
        out[0] = x
    return x + 2 * x

def other(x):
    return x > 2
'''
STATED = [
    Fault("", (), "compared", "x > 2", "x > 20", "judged"),
    Fault("", (), "left out", "out[0] = x", "pass"),
    Fault("", (), "a sum", "x + 2*x", "x - 2 * x"),
    Fault("", (), "a product within the sum", "2 * x", "3 * x"),
]


@pytest.fixture(params=[lambda function: function, njit], ids=["Python", "compiled"])
def judged(request: pytest.FixtureRequest) -> Iterator[Callable]:
    names: dict = {}
    exec(compile(written(SOURCE, list(enumerate(STATED, start=1))), "made", "exec"), names)
    yield request.param(names["judged"])
    turn_on(0)


@pytest.mark.parametrize(("number", "expected"), [(0, (5, 15)), (1, (0, 15)), (2, (0, 15)), (3, (5, -5)), (4, (5, 20))])
def test_the_switch_turns_one_fault_on(judged: Callable, number: int, expected: tuple[int, int]) -> None:
    out = np.zeros(1, dtype=np.int64)
    turn_on(number)
    found = judged(5, out)
    assert (out[0], found) == expected


@pytest.mark.parametrize("fault", [Fault("f.py", (), "", "x > 2", "x"), Fault("f.py", (), "", "x > 3", "x")])
def test_a_fault_that_has_no_one_place_is_refused(fault: Fault) -> None:
    with pytest.raises(ValueError, match="not once"):
        written(SOURCE, [(1, fault)])


def test_every_stated_fault_stands_where_it_says_and_has_tests() -> None:
    made = sources(FAULTS)
    assert len(made) > 10
    assert len(FAULTS) >= 100
    for path, text in made.items():
        compile(text, path, "exec")
    assert [test for fault in FAULTS for test in fault.tests if not (ROOT / test).exists()] == []
