"""`palpate evaluate` of a ring's contacts against the angles and forces that its calibration's truth has."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status

FRAMES, OFF = 40, 0.5  # degrees by which every contact is off
TRUE = (np.arange(FRAMES) * 9.0 + 355.0) % 360.0  # degrees: over the seam between 360 and 0


def _contacts(features: bool = True) -> Contacts:
    angle = np.radians(TRUE + OFF)
    out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    along = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    estimate = ContactEstimate(
        point=0.055 * out,
        normal=out,
        force=-1.2 * out + 0.4 * along,
        torque=np.zeros(FRAMES),
        covariance=np.full((FRAMES, 3, 3), np.nan),
        residual=np.zeros(FRAMES),
        candidates=np.ones(FRAMES, dtype=np.int64),
        status=np.full(FRAMES, Status.CONTACT, dtype=np.int8),
    )
    known = {"angle": np.arctan2(out[:, 1], out[:, 0]), "depth": np.full(FRAMES, 2e-3), "shear": np.full(FRAMES, 0.4)}
    known["angle_sd"] = np.radians(np.where(np.arange(FRAMES) % 4, OFF, OFF / 4))  # holds the truth in 3 of 4
    return Contacts(
        np.arange(FRAMES), np.arange(FRAMES) / 30, np.ones(FRAMES, dtype=np.int64), estimate, known if features else {}
    )


@pytest.mark.parametrize("timed", [True, False])
def test_errors_are_in_the_ring_s_own_terms(tmp_path: Path, capsys: pytest.CaptureFixture[str], timed: bool) -> None:
    _contacts().save(tmp_path / "contacts.csv")
    columns = {"angle_deg": TRUE, "force_n": np.full(FRAMES, 1.1), "depth_mm": np.full(FRAMES, 2.3)}
    table = pl.DataFrame({"time": np.arange(FRAMES) / 30 + 0.004, **columns} if timed else columns)
    table.write_csv(tmp_path / "truth.csv")
    assert main(["evaluate", str(tmp_path / "contacts.csv"), str(tmp_path / "truth.csv")]) == 0
    words = capsys.readouterr().out.split()
    for name, mean in (("[deg]", "0.500"), ("[N]", "0.100"), ("[mm]", "0.300")):
        assert words[words.index(name) + 1] == mean
    assert "75.0" in words
    assert "shear" not in words


def test_what_cannot_be_compared_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, features in (("ring.csv", True), ("other.csv", False)):
        _contacts(features).save(tmp_path / name)
    pl.DataFrame({"angle_deg": TRUE, "force_n": TRUE}).write_csv(tmp_path / "truth.csv")
    pl.DataFrame({"angle_deg": TRUE[:9], "force_n": TRUE[:9]}).write_csv(tmp_path / "short.csv")
    for contacts, truth, said in (("other.csv", "truth.csv", "no angles"), ("ring.csv", "short.csv", "9 rows without")):
        assert main(["evaluate", str(tmp_path / contacts), str(tmp_path / truth)]) == 1
        assert said in capsys.readouterr().err
