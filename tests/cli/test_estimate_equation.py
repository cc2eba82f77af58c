"""`palpate estimate` on a surface without a mesh: an elliptic cylinder by its lengths, in a sensor's frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate.spatial.pose import Pose
from palpate_lab.simulation.contacts import contact_wrenches

RIG = """
[surface]
kind = "elliptic_cylinder"
a = 0.014
b = 0.005
half_length = 0.016
upper = true
pose = { xyz = [0.0, 0.01, 0.02], quaternion_xyzw = [0.0, 0.0, 0.6, 0.8] }

[force_torque]
noise = { force = 0.002, torque = 1e-5 }
"""


def test_contacts_on_an_elliptic_cylinder(tmp_path: Path) -> None:
    """In closed form: points by angle and length, forces within friction, torque about the normal."""
    (tmp_path / "rig.toml").write_text(RIG)
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(0.2, np.pi - 0.2, 200), rng.uniform(-0.015, 0.015, 200)
    points = np.c_[0.014 * np.cos(angle), along, 0.005 * np.sin(angle)]
    normals = np.c_[np.cos(angle) / 0.014, np.zeros(200), np.sin(angle) / 0.005]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sideways = np.cross(normals, rng.normal(size=(200, 3)))
    forces = -3.0 * normals + 0.8 * sideways / np.linalg.norm(sideways, axis=1, keepdims=True)
    wrenches = contact_wrenches(points, normals, forces, rng.uniform(-2e-3, 2e-3, 200))
    seen = wrenches @ Pose.from_quaternion((0.0, 0.0, 0.6, 0.8), (0.0, 0.01, 0.02)).wrench_matrix().T
    columns = ("fx", "fy", "fz", "tx", "ty", "tz")
    pl.DataFrame({"time": np.arange(200) / 100, **dict(zip(columns, seen.T, strict=True))}).write_csv(
        tmp_path / "log.csv"
    )
    out, page = tmp_path / "contacts.csv", tmp_path / "report.html"
    call = ["estimate", str(tmp_path / "log.csv"), "--rig", str(tmp_path / "rig.toml"), "-o", str(out)]
    assert main([*call, "--report", str(page)]) == 0
    contacts = read_contacts(out)
    assert contacts.estimate.answered.all()
    assert np.abs(contacts.estimate.point - points).max() < 1e-8
    assert "an elliptic cylinder" in page.read_text(encoding="utf-8")
