"""The rig: read strictly, built into an estimator, updated without touching its author's words."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.io.guess import guess_orientation, guess_position, guess_time, guess_wrench
from palpate.io.rig import build, load_rig
from palpate.io.rig_edit import update_pose
from palpate.io.rig_new import propose_rig
from palpate.spatial.pose import Pose

RIG = """\
# the rig of the issue
[surface]
mesh = "probe.stl"
unit = "mm"
crease = 30                      # degrees
pose = { xyz = [0, 0, 0.05], quaternion_xyzw = [0, 0, 0, 1] }      # of the surface in the sensor's frame
[force_torque]
columns = ["fx", "fy", "fz", "tx", "ty", "tz"]
units = { force = "N", torque = "N m" }
axes = ["x", "y", "z"]
frame = "sensor"
noise = { force = 0.02, torque = 0.001 }
range = { force = 200, torque = 10 }

[orientation]
columns = ["qx", "qy", "qz", "qw"]
[estimate]
method = "soft_finger"
friction = 1.0
torsion = 0.005
contact = { on = 0.5, off = 0.3 }                                  # N
"""


def write_octahedron(path: Path, radius: float = 20.0) -> None:
    """A binary STL of eight facets, in the unit that `radius` is meant in."""
    axes = np.eye(3)
    facets = [
        np.array([i * axes[0], j * axes[1], k * axes[2]])[:: int(i * j * k)] * radius
        for i in (1, -1)
        for j in (1, -1)
        for k in (1, -1)
    ]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in facets)
    path.write_bytes(b"octahedron".ljust(80) + struct.pack("<I", len(facets)) + body)


def _rig(tmp_path: Path, text: str = RIG) -> Path:
    (tmp_path / "rig.toml").write_text(text)
    write_octahedron(tmp_path / "probe.stl")
    return tmp_path / "rig.toml"


def test_the_rig_of_the_issue_builds_an_estimator(tmp_path: Path) -> None:
    rig = load_rig(_rig(tmp_path))
    estimator = build(rig)
    assert estimator.locator.surface.size == pytest.approx(0.04 * 3**0.5)
    assert estimator.mount.translation.tolist() == [0, 0, 0.05]
    assert (estimator.locator.on, estimator.locator.off) == (0.5, 0.3)
    assert estimator.sensor.limits is not None
    assert estimator.sensor.limits.tolist() == [200] * 3 + [10] * 3
    assert estimator.sensor.noise is not None
    assert np.diag(estimator.sensor.noise) == pytest.approx([0.0004] * 3 + [1e-6] * 3)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("crease", "creese", r"unknown key 'creese' in \[surface\]. Did you mean 'crease'"),
        ("friction", "fricton", r"unknown key 'fricton' in \[estimate\]. Did you mean 'friction'"),
        ("[orientation]", "[orientaton]", "unknown key 'orientaton'. Did you mean 'orientation'"),
        ("on = 0.5", "onn = 0.5", r"unknown key 'onn' in \[estimate.contact\]. Did you mean 'on'"),
        ("quaternion_xyzw", "quaternion", "Did you mean 'quaternion_xyzw'"),
        ("crease = 30 ", 'crease = "30" ', "surface.crease must be a number, not '30'"),
        ("friction = 1.0", "friction = true", "estimate.friction must be a number, not True"),
        ('axes = ["x", "y", "z"]', 'axes = ["x", "y"]', "force_torque.axes must be a list of 3 texts, not 2 values"),
        ('axes = ["x", "y", "z"]', 'axes = ["x", "z", "y"]', "declare left_handed = true"),
        ("xyz = [0, 0, 0.05]", 'xyz = [0, "0", 0.05]', r"surface.pose.xyz\[1\] must be a number, not '0'"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", "not of length 1"),
        ("noise = { force = 0.02, torque = 0.001 }", "noise = 0.02", "noise must be a table of force, torque"),
        ("noise = { force = 0.02, torque = 0.001 }", "noise = { force = 0.02 }", "noise.torque is missing"),
        ("force = 0.02", "force = -0.02", "must be positive"),
        ("off = 0.3", "off = 0.7", "must lie between 0 and on"),
        ('torque = "N m"', 'torque = "Nm/s"', "unknown unit 'Nm/s'.*N mm"),
        ('unit = "mm"', 'unit = "mms"', "unit of the mesh"),
        ('unit = "mm"\n', "", "unit of the mesh"),
        ('mesh = "probe.stl"\n', "", "mesh is missing"),
        ('frame = "sensor"', 'frame = "tool"', "frame must be"),
        ("[estimate]", "[estimate", "not TOML.*line"),
        ("[surface]", "[surfaces]", r"needs a \[surface\]"),
        ("soft_finger", "soft_fingers", "soft_finger, wrench_axis"),
        ("probe.stl", "prob.stl", "no such"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, old: str, new: str, word: str) -> None:
    assert old in RIG
    path = _rig(tmp_path, RIG.replace(old, new, 1))
    with pytest.raises(InputError, match=word):
        build(load_rig(path))


def test_a_plane_and_a_region_need_no_more_than_their_keys(tmp_path: Path) -> None:
    plane = '[surface]\nkind = "plane"\npoint = [0, 0, 1]\nnormal = [0, 0, 2]\nhalf_width = 0.5\n'
    surface = load_rig(_rig(tmp_path, plane)).surface.load(tmp_path)
    assert surface.normals == pytest.approx(np.array([[0, 0, 1.0], [0, 0, 1.0]]))
    region = RIG.replace("crease = 30 ", "region = { box = [[0, 0, 0], [1, 1, 1]] } ")
    rig = load_rig(_rig(tmp_path, region))
    assert len(rig.surface.load(rig.folder).faces) == 1


def test_a_new_pose_leaves_every_other_word(tmp_path: Path) -> None:
    path = _rig(tmp_path)
    pose = Pose.from_rotation_vector([0.1, -0.2, 0.3], [1e-3, 2e-3, 3e-3])
    covariance = np.diag(np.arange(1.0, 7.0)) * 1e-7 / 3
    update_pose(path, path, pose, covariance, comment="from 12 touches")
    text = path.read_text()
    kept = [line for line in RIG.splitlines() if not line.startswith("pose")]
    assert [line for line in text.splitlines() if line in kept] == kept
    assert "# from 12 touches" in text
    surface = load_rig(path).surface
    assert np.array_equal(np.asarray(surface.pose_covariance), covariance)
    assert surface.pose.xyz == (1e-3, 2e-3, 3e-3)
    assert surface.pose.pose().rotation == pytest.approx(pose.rotation, abs=1e-15)
    update_pose(path, path, pose, covariance, comment="from 12 touches")
    assert path.read_text() == text  # and doing it again changes nothing


def test_a_pose_written_as_a_table_of_its_own_is_replaced_too(tmp_path: Path) -> None:
    path = _rig(
        tmp_path, '[surface]\nmesh = "probe.stl"\nunit = "mm"\n[surface.pose]\nxyz = [0, 0, 1]\n[time]\nunit = "ms"\n'
    )
    update_pose(path, path, Pose.identity(), np.eye(6))
    rig = load_rig(path)
    assert rig.surface.pose.xyz == (0, 0, 0)
    assert rig.time.unit == "ms"


def test_a_rig_without_a_pose_gets_one(tmp_path: Path) -> None:
    path = _rig(tmp_path, '[surface]\nmesh = "probe.stl"\nunit = "mm"\n\n[time]\nunit = "ms"\n')
    update_pose(path, path, Pose.identity(), np.eye(6), comment="new")
    assert load_rig(path).surface.pose_covariance is not None
    assert "\n\n[time]\n" in path.read_text()


def test_paths_follow_a_rig_into_another_folder(tmp_path: Path) -> None:
    path = _rig(tmp_path)
    (tmp_path / "sub").mkdir()
    update_pose(path, tmp_path / "sub" / "new.toml", Pose.identity(), np.eye(6))
    rig = load_rig(tmp_path / "sub" / "new.toml")
    assert rig.surface.load(rig.folder).size > 0


@pytest.mark.parametrize(
    ("header", "time", "wrench", "orientation", "position"),
    [
        ("time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw", "time", "fx,fy,fz,tx,ty,tz", "qx,qy,qz,qw", None),
        ("t,Fx,Fy,Fz,Mx,My,Mz", "t", "Fx,Fy,Fz,Mx,My,Mz", None, None),
        (
            "Timestamp,Fx (N),Fy (N),Fz (N),Tx (N m),Ty (N m),Tz (N m)",
            "Timestamp",
            "Fx (N),Fy (N),Fz (N),Tx (N m),Ty (N m),Tz (N m)",
            None,
            None,
        ),
        (
            "stamp,a.force.x,a.force.y,a.force.z,b.force.x,b.force.y,b.force.z,b.torque.x,b.torque.y,b.torque.z",
            "stamp",
            "b.force.x,b.force.y,b.force.z,b.torque.x,b.torque.y,b.torque.z",
            None,
            None,
        ),
        (
            "%time,w_force_x,w_force_y,w_force_z,w_torque_x,w_torque_y,w_torque_z,p_position_x,p_position_y,p_position_z,"
            "p_orientation_x,p_orientation_y,p_orientation_z,p_orientation_w",
            "%time",
            "w_force_x,w_force_y,w_force_z,w_torque_x,w_torque_y,w_torque_z",
            "p_orientation_x,p_orientation_y,p_orientation_z,p_orientation_w",
            "p_position_x,p_position_y,p_position_z",
        ),
        ("a,b,c", None, None, None, None),
    ],
)
def test_columns_are_guessed_from_their_names(
    header: str, time: str | None, wrench: str | None, orientation: str | None, position: str | None
) -> None:
    names = header.split(",")
    assert guess_time(names) == time
    for guess, expected in (
        (guess_wrench(names), wrench),
        (guess_orientation(names), orientation),
        (guess_position(names), position),
    ):
        assert guess == (None if expected is None else tuple(expected.split(",")))


@pytest.mark.parametrize("unit", ["N m", "N mm"])
@pytest.mark.parametrize(("mesh_unit", "radius"), [("mm", 20.0), ("m", 0.02)])
def test_a_proposed_rig_loads_and_knows_its_units(tmp_path: Path, unit: str, mesh_unit: str, radius: float) -> None:
    write_octahedron(tmp_path / "probe.stl", radius)
    rng = np.random.default_rng(0)
    force = rng.normal(size=(200, 3)) * np.repeat([0.01, 3.0], 100)[:, None]
    torque = np.cross(rng.normal(size=(200, 3)) * 0.02, force) * (1.0 if unit == "N m" else 1e3)
    rows = np.column_stack([1.7e9 * 1e9 + np.arange(200) * 1e7, force, torque])
    lines = ["stamp,f_x,f_y,f_z,m_x,m_y,m_z", *(",".join(map(repr, row)) for row in rows.tolist())]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    proposal = propose_rig(tmp_path / "log.csv", tmp_path / "probe.stl", tmp_path)
    (tmp_path / "rig.toml").write_text(proposal.text)
    rig = load_rig(tmp_path / "rig.toml")
    assert (rig.surface.unit, rig.force_torque.units.torque, rig.time.unit) == (mesh_unit, unit, "ns")
    assert rig.force_torque.columns == ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")
    assert rig.surface.load(rig.folder).size == pytest.approx(0.04 * 3**0.5, rel=1e-6)
    assert ("N mm" in " ".join(proposal.remarks)) == (unit == "N mm")
