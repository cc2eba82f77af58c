"""Faults are made from what stands in a file, and the switch turns them on in Python and in compiled code alike."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numba import njit

from mutants.build import ROOT, sources
from mutants.compiled_switch import switch  # noqa: F401 - that numba knows it
from mutants.fault import chosen, faults_in, written
from mutants.switch import reached, turn_on

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
MADE = faults_in("palpate/room/f.py", SOURCE)
TWICE = next(k for k, fault in enumerate(MADE, start=1) if fault.original == "2 * x")
COMPARED = next(k for k, fault in enumerate(MADE, start=1) if fault.original == "x > 2")
SUM = next(k for k, fault in enumerate(MADE, start=1) if fault.original == "x + 2 * x")


@pytest.fixture(params=[lambda function: function, njit], ids=["Python", "compiled"])
def judged(request: pytest.FixtureRequest) -> Iterator[Callable]:
    names: dict = {}
    exec(compile(written(SOURCE, list(enumerate(MADE, start=1))), "made", "exec"), names)
    yield request.param(names["judged"])
    turn_on(0)


@pytest.mark.parametrize(("number", "expected"), [(0, (5, 15)), (COMPARED, (0, 15)), (SUM, (5, -5)), (TWICE, (5, 12))])
def test_the_switch_turns_one_fault_on(judged: Callable, number: int, expected: tuple[int, int]) -> None:
    out = np.zeros(1, dtype=np.int64)
    turn_on(number)
    reached()
    found = judged(5, out)
    assert (out[0], found) == expected
    assert {COMPARED, SUM} <= {*reached()} <= {COMPARED, COMPARED + 1, SUM, TWICE}  # not those of the other function
    assert reached() == []


def test_faults_by_chance_stand_in_the_package_and_have_tests() -> None:
    faults = chosen(24)
    assert faults == chosen(24)
    assert len({fault.file for fault in faults}) > 20
    for path, text in sources(faults).items():
        compile(text, path, "exec")
    assert [fault.tests for fault in faults if not (ROOT / fault.tests.split()[0]).is_dir()] == []
