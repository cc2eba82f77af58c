"""Inputs that fuzzing found end in an answer or a `PalpateError`, without a warning; `make fuzz` looks for more."""

from pathlib import Path
from resource import RUSAGE_SELF, getrusage

import pytest

from fuzz.__main__ import MOST
from fuzz.targets import TARGETS

CORPUS = sorted(path for path in (Path(__file__).parents[1] / "fuzz" / "corpus").glob("*/*"))


@pytest.mark.parametrize("kept", CORPUS, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_an_input_that_crashed_once_ends_in_an_answer_or_a_sentence(kept: Path) -> None:
    assert kept.stat().st_size <= 4096
    before = getrusage(RUSAGE_SELF).ru_maxrss
    TARGETS[kept.parent.name](kept.read_bytes())
    assert getrusage(RUSAGE_SELF).ru_maxrss - before < MOST
