"""A table of somebody else is read as the plain one is, or refused with the reason; see `evidence.first_minutes`."""

from pathlib import Path

import numpy as np
import pytest

from claims.evidence.exports import EDITED, EXPORTS, NOTED, POINTS, PRESSED, REFUSED, Export
from claims.evidence.first_minutes import EDIT, GOOD, LOST, REFUSAL, Outcome, first_minutes, plain_answers


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Status and point of each row of the plain table, which are those of the session."""
    found = plain_answers(tmp_path_factory.mktemp("plain"))
    touch = np.cumsum(np.diff(PRESSED, prepend=False) & PRESSED)[PRESSED] - 1
    assert np.abs(found[PRESSED, 1:] - POINTS[touch]).max() < 1e-4
    return found


@pytest.mark.parametrize("export", EXPORTS.values(), ids=EXPORTS)
def test_an_export_is_read_as_the_plain_table_is(export: Export, plain: np.ndarray, tmp_path: Path) -> None:
    verdict = next((word for word, of in ((EDIT, EDITED), (LOST, NOTED), (REFUSAL, REFUSED)) if export in of), GOOD)
    assert first_minutes(export, tmp_path, plain) == Outcome(verdict)
