"""A real arm that moves, vibrates and touches nothing has no contact, with orientations alone, an IMU, or a filter."""

from pathlib import Path

import pytest

import palpate
from palpate.contact.touch_finder import find_touches


@pytest.mark.parametrize(
    ("log", "rig"), [("1-baseline_q", "c_q"), ("1-baseline_qa", "c_qa"), ("1-baseline_q", "c_q_filtered")]
)
def test_a_real_arm_in_free_motion_touches_nothing(log: str, rig: str, shared: Path) -> None:
    folder = shared / "cases" / "ft" / "free_motion"
    if not folder.exists():
        pytest.skip("no cases in the shared data")
    found = palpate.estimate(folder / f"{log}.csv", folder / f"{rig}.toml")
    assert found.answered.mean() <= 0.01
    assert len(find_touches(found)) == 0
    said = " ".join(found.notes)
    assert "vibrates by up to" in said
    assert "from poses" not in said
    assert "bias or payload" not in said
    assert ("the accelerometer's bias" in said) == (rig == "c_qa")
