"""A rig with [drift]: the zero is followed through a warm-up and touches, and the report draws it."""

import re
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main

RATE, SECONDS, RAMP = 100.0, 30.0, 0.016  # Hz, s, N/s: a warm-up of 1 N/min
RIG = """[surface]
kind = "plane"

[force_torque]
noise = { force = 0.04, torque = 0.002 }

[drift]
walk = { force = 0.003, torque = 1.5e-4 }
warm_up = { force = 1.0, torque = 0.02 }
settle = 200

[estimate]
tare = 2
"""


def test_the_zero_is_followed_from_a_tare_on_while_it_runs_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Over the 2 s of the tare the zero moves by 8 deviations of their mean; touches fill a quarter of the log."""
    rng = np.random.default_rng(5)
    time = np.arange(round(SECONDS * RATE)) / RATE
    wrenches = rng.normal(size=(len(time), 6)) * np.array([0.04] * 3 + [0.002] * 3)
    wrenches[:, 2] += RAMP * time
    force = np.array([0.0, 0.0, -5.0])
    wrenches[(time % 8 > 6) & (time > 8)] += np.concatenate([force, np.cross([0.02, 0.01, 0.0], force)])
    table, names = np.column_stack([time, wrenches]), "time,fx,fy,fz,tx,ty,tz"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="", fmt="%.6g")
    (tmp_path / "rig.toml").write_text(RIG)
    words = ["estimate", str(tmp_path / "log.csv"), "--rig", str(tmp_path / "rig.toml"), "-o", str(tmp_path / "c.csv")]
    assert main([*words, "--report", str(tmp_path / "r.html")]) == 0
    said, page = capsys.readouterr().out, (tmp_path / "r.html").read_text()
    assert "note: tare over 201 samples" in said
    held = re.search(r"in (\d+)% of the time it was kept", said)
    assert held is not None
    assert int(held[1]) < 40
    assert "the stated noise is not that of the log" not in said  # a zero that is followed is no noise
    section = page[page.index(">Zero<") :]
    assert "zero of the force" in section
    assert "with 95 % bands" in section
