"""The rig: read strictly, built into an estimator, updated without touching its author's words."""

import os
import re
import struct
import sys
import tomllib
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.sensors.force_torque.compensation import Compensation
from palpate.setup import check_rig, load_rig
from palpate.setup.body import GivenBody
from palpate.setup.edit import update_pose
from palpate.setup.makers import named_pose
from palpate.setup.names import orientation_columns, position_columns, time_column, wrench_columns
from palpate.setup.new import propose_rig
from palpate.setup.pipeline import open_log
from palpate.setup.source import RigSource
from palpate.setup.tables import RigEstimate, RigPair, RigSurface, RigThresholds
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
    estimator = rig.estimator()
    assert estimator.locator.surface.size == pytest.approx(0.04 * 3**0.5)
    assert estimator.mount.translation.tolist() == [0, 0, 0.05]
    assert (estimator.locator.on, estimator.locator.off) == (0.5, 0.3)
    assert isinstance(estimator.sensor, Compensation)
    assert estimator.sensor.sensor.limits is not None
    assert estimator.sensor.sensor.limits.tolist() == [200] * 3 + [10] * 3
    assert estimator.sensor.noise is not None
    assert np.diag(estimator.sensor.noise) == pytest.approx([0.0004] * 3 + [1e-6] * 3)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("crease", "creese", r"unknown key 'creese' in \[surface\]. Did you mean 'crease'"),
        ("[orientation]", "[orientaton]", "unknown key 'orientaton'. Did you mean 'orientation'"),
        ("on = 0.5", "onn = 0.5", r"unknown key 'onn' in \[estimate.contact\]. Did you mean 'on'"),
        ("quaternion_xyzw", "quaternion", "Did you mean 'quaternion_xyzw'"),
        ("crease = 30 ", 'crease = "30" ', "toml: surface.crease must be a number, not '30'"),
        ('axes = ["x", "y", "z"]', 'axes = ["x", "y"]', "force_torque.axes must be a list of 3 texts, not 2 values"),
        ('axes = ["x", "y", "z"]', 'axes = ["x", "z", "y"]', "declare left_handed = true"),
        ("xyz = [0, 0, 0.05]", 'xyz = [0, "0", 0.05]', r"toml: surface.pose.xyz\[1\] must be a number, not '0'"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", "pose: .*must have length 1"),
        ("noise = { force = 0.02, torque = 0.001 }", "noise = 0.02", "toml: .*noise must be a table of force, torque"),
        ("noise = { force = 0.02, torque = 0.001 }", "noise = { force = 0.02 }", "toml: .*noise.torque is missing"),
        ("force = 0.02", "force = -0.02", "noise: .*must be positive"),
        ("off = 0.3", "off = 0.7", "contact: .*must be between 0 and on"),
        ('torque = "N m"', 'torque = "Nm/s"', "unknown unit 'Nm/s'.*N mm"),
        ('unit = "mm"', 'unit = "mms"', "unit of the mesh"),
        ('unit = "mm"\n', "", "unit of the mesh"),
        ('mesh = "probe.stl"\n', "", "surface: mesh, the file of the surface, is missing"),
        ('frame = "sensor"', 'frame = "tool"', "force_torque: frame must be"),
        ("[estimate]", "[estimate", "toml: .*not TOML.*line"),
        ("soft_finger", "soft_fingers", "soft_finger, wrench_axis"),
        ("probe.stl", "prob.stl", "stl: .*does not exist"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, old: str, new: str, word: str) -> None:
    assert old in RIG
    path = _rig(tmp_path, RIG.replace(old, new, 1))
    with pytest.raises(InputError, match=word):
        load_rig(path).estimator()


def test_a_plane_and_a_region_need_no_more_than_their_keys(tmp_path: Path) -> None:
    plane = '[surface]\nkind = "plane"\npoint = [0, 0, 1]\nnormal = [0, 0, 2]\nhalf_width = 0.5\n'
    surface = load_rig(_rig(tmp_path, plane)).resolve().link.surface()
    assert surface.normals == pytest.approx(np.array([[0, 0, 1.0], [0, 0, 1.0]]))
    region = RIG.replace("crease = 30 ", "region = { box = [[0, 0, 0], [1, 1, 1]] } ")
    rig = load_rig(_rig(tmp_path, region))
    assert len(rig.resolve().link.surface().faces) == 1


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
    assert rig.resolve().link.surface().size > 0


def test_the_robots_of_a_rig_follow_it_too(tmp_path: Path) -> None:
    text = '[surface]\nurdf = "arm.urdf"\nlink = "hand"\n[orientation]\nurdf = "arm.urdf"\nbase = "a"\nsensor = "b"\n'
    (tmp_path / "rig.toml").write_text(text)
    (tmp_path / "sub").mkdir()
    update_pose(tmp_path / "rig.toml", tmp_path / "sub" / "new.toml", Pose.identity(), np.eye(6))
    moved = (tmp_path / "sub" / "new.toml").read_text()
    assert moved.count('urdf = "../arm.urdf"') == 2


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
    assert time_column(names) == time
    for guess, expected in (
        (wrench_columns(names), wrench),
        (orientation_columns(names), orientation),
        (position_columns(names), position),
    ):
        assert guess == (None if expected is None else tuple(expected.split(",")))
    assert getattr(named_pose(["Roll [deg]", "Pitch [deg]", "Yaw [deg]"]), "form", "") == "euler_xyz_deg"


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
    proposal = propose_rig(tmp_path / "log.csv", GivenBody.of(tmp_path / "probe.stl"), tmp_path)
    (tmp_path / "rig.toml").write_text(proposal.text)
    rig = load_rig(tmp_path / "rig.toml")
    assert (rig.surface.unit, rig.sensors["force_torque"].units.torque, rig.time.unit) == (mesh_unit, unit, "ns")
    assert rig.sensors["force_torque"].columns == ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")
    assert rig.resolve().link.surface().size == pytest.approx(0.04 * 3**0.5, rel=1e-6)
    assert ("N mm" in " ".join(proposal.remarks)) == (unit == "N mm")


_SURFACE = "mesh = 'probe.stl'\nunit = 'mm'\n"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (f"[surface]\n{_SURFACE}{line}", word)
        for line, word in (
            ("pose = { xyz = [0, 0, nan] }", r"toml: surface.pose.xyz\[2\] must be a finite number, not nan"),
            ("pose = { xyz = [0, 0, 1e200] }", r"toml: surface.pose.xyz\[2\] must be a finite number"),
            ("pose = { quaternion_xyzw = [0, 0, 0, nan] }", r"toml: .*quaternion_xyzw\[3\] must be a finite number"),
            ("crease = -30", "surface: crease must be between 0 and 180"),
            ("crease = 181", "surface: crease must be between 0 and 180"),
            ("crease = inf", "toml: surface.crease must be a finite number, not inf"),
            ("crease = 1" + "0" * 400, "surface.crease must be a finite number, not an integer that is too large"),
            ("half_width = 0", "surface: half_width must be positive"),
            ("normal = [0, 0, 0]", "surface: normal must not be zero"),
            ("pose_covariance = [[1, 2], [3]]", "surface: pose_covariance must be 6 x 6"),
            (f"pose_covariance = {(-np.eye(6)).tolist()}", "surface: pose_covariance must be positive semidefinite"),
            (f"pose_covariance = {np.triu(np.ones((6, 6))).tolist()}", "surface: pose_covariance must be symmetric"),
            (f"pose_covariance = {np.full((6, 6), np.nan).tolist()}", r"pose_covariance\[0\]\[0\] must be a finite"),
            ("[force_torque]\npayload = ''", "force_torque: payload must name a file"),
            ('[force_torque]\npayload = "a\\u0000b"', "force_torque: payload must name a file"),
            ("[force_torque]\nnoise = { force = nan, torque = 1 }", "noise.force must be a finite number, not nan"),
            ("[force_torque]\nnoise = { force = 0, torque = 1 }", "noise: force and torque must be positive"),
            ("[force_torque]\nnoise = { force = 1, torque = 1, corner = 0 }", "corner must be positive and finite"),
            ("[force_torque]\nnoise = { force = [1, 1, nan], torque = 1 }", r"noise.force\[2\] must be a finite"),
            ("[force_torque]\nrange = { force = inf, torque = 1 }", "toml: .*range.force must be"),
            ("[estimate]\nfriction = 0", "estimate: friction must be positive"),
            ("[estimate]\nfriction = inf", "toml: estimate.friction must be a finite number"),
            ("[estimate]\ntorsion = nan", "toml: estimate.torsion must be a finite number"),
            ("[estimate]\ntorsion = -inf", "estimate: .*torsion not negative"),
            ("[estimate]\ncontact = { on = inf, off = 0 }", "toml: .*contact.on must be a finite number"),
            ("[estimate]\ncontact = { on = true, off = 0 }", "toml: .*contact.on must be a number, not True"),
        )
    ]
    + [
        ("[surface]\nmesh = ''\nunit = 'mm'", "surface: mesh must name a file"),
        ("surface = " + "[" * 3000 + "]" * 3000, "toml: is not TOML"),
    ],
)
def test_a_number_or_name_without_sense_is_refused_by_its_key(tmp_path: Path, text: str, word: str) -> None:
    path = _rig(tmp_path, text)
    with pytest.raises(InputError, match=word) as refused:
        load_rig(path)
    assert str(path) in str(refused.value)


def test_torsion_may_be_without_bound_and_a_rig_may_begin_with_a_mark(tmp_path: Path) -> None:
    path = _rig(tmp_path, f"\ufeff[surface]\n{_SURFACE}[estimate]\ntorsion = inf\n")
    assert load_rig(path).estimate.torsion == np.inf


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_what_is_made_in_python_is_held_to_the_same(value: float) -> None:
    for make in (
        lambda: RigPair(value, 1.0),
        lambda: RigThresholds(value, 0.0),
        lambda: RigEstimate(friction=value),
        lambda: RigSurface(mesh="m", unit="mm", crease=value),
    ):
        with pytest.raises(ValueError, match="must"):
            make()


@pytest.mark.parametrize(
    "text",
    [
        'surface = { mesh = "a.stl", unit = "mm", pose = { xyz = [0, 0, 1] } }\n# kept\n[time] # kept\nunit = "ms"\n',
        'surface.mesh = "a.stl"\nsurface.unit = "mm"\nsurface.pose.xyz = [0, 0, 1]\n# kept\n[time] # kept\nunit="ms"',
        'surface.mesh = "a.stl"\ntime.unit = "ms" # kept\nsurface.unit = "mm"\n# kept\n',
        '[surface.pose]\nxyz = [0, 0, 1]\n[time] # kept\nunit = "ms" # kept\n[surface]\nmesh = "a.stl"\nunit = "mm"',
        '[surface]\nmesh = "a.stl" # kept\nunit = "mm"\npose.xyz = [0, 0, 1]\n# kept\n[time]\nunit = "ms"',
        '[surface]\nmesh = "a.stl"\nunit = "mm"\n[time] # kept\nunit = "ms" # kept\n[surface.pose]\nxyz = [0, 0, 1]\n',
        '\ufeff[surface]\nmesh = "a.stl"\nunit = "mm" # kept\n[time] # kept\nunit = "ms"',
    ],
)
@pytest.mark.parametrize("folder", ["", "sub"])
def test_whatever_the_form_of_a_rig_a_new_pose_can_be_read_back(tmp_path: Path, text: str, folder: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    (tmp_path / "sub").mkdir()
    target = tmp_path / folder / "rig.toml"
    update_pose(path, target, Pose.identity(), np.eye(6), comment="from a\nb.csv")
    rig = load_rig(target)
    assert rig.surface.pose.xyz == (0, 0, 0)
    assert np.array_equal(np.asarray(rig.surface.pose_covariance), np.eye(6))
    assert rig.folder.joinpath(str(rig.surface.mesh)).resolve() == tmp_path / "a.stl"
    assert rig.time.unit == "ms"
    assert target.read_text().count("# kept") == 2


def test_a_surface_that_is_no_table_is_refused_and_left(tmp_path: Path) -> None:
    path = _rig(tmp_path, "[[surface]]\nmesh = 'a.stl'\n")
    with pytest.raises(InputError, match=r"needs a \[surface\].*Add"):
        update_pose(path, path, Pose.identity(), np.eye(6))
    assert path.read_text() == "[[surface]]\nmesh = 'a.stl'\n"


def test_a_proposed_rig_loads_whatever_the_names_or_is_not_proposed(tmp_path: Path) -> None:
    header = '"time\x7f",fx,fy,fz,tx,ty,tz'
    rows = [f"{k},{k % 3},0,1,0,0,0" for k in range(50)]
    log = tmp_path / 'a "b\n.csv'
    log.write_text("\n".join([header, *rows]))
    write_octahedron(tmp_path / 'm "x".stl')
    text = propose_rig(log, GivenBody.of(tmp_path / 'm "x".stl'), tmp_path).text
    assert check_rig(tomllib.loads(text), tmp_path / "rig.toml").time.column == "time\x7f"
    write_octahedron(tmp_path / os.fsdecode(b"bad\xff.stl"))
    body = GivenBody.of(tmp_path / os.fsdecode(b"bad\xff.stl"))
    with pytest.raises(InputError, match=r"(?i)utf-8"):
        write_text(tmp_path / "r.toml", propose_rig(log, body, tmp_path).text)
    log.write_text("\n".join(row.partition(",")[2] for row in [header, *rows]))  # without times
    with pytest.raises(InputError, match=r"time: rate must be positive"):
        propose_rig(log, None, tmp_path, rate=-5.0)


@pytest.fixture
def opened() -> Iterator[list[Path]]:
    """Each file that is opened, in order; a hook of this kind cannot be taken back, only made deaf."""
    files, listening = list[Path](), [True]

    def hear(event: str, details: tuple[object, ...]) -> None:
        if event == "open" and listening and isinstance(details[0], str):
            files.append(Path(details[0]))

    sys.addaudithook(hear)
    yield files
    listening.clear()


@pytest.mark.parametrize("sensor", ["six-axis", "load_cells", "skin", "skin_and_wrench", "marker_ring"])
def test_a_setup_reads_each_file_of_a_rig_once(sensor: str, opened: list[Path]) -> None:
    folder = Path(__file__).parents[1] / "v03" / sensor
    setup = load_rig(folder / "rig.toml").resolve()
    opened.clear()
    for _ in range(2):
        setup.layout()
        setup.prepared()
    read = [path.name for path in opened if path.parent == folder]
    assert read
    assert len(read) == len(set(read)), read


def test_an_estimator_for_a_log_of_another_rigs_sensor_is_refused() -> None:
    folder = Path(__file__).parents[1] / "v03"
    with (
        open_log(folder / "skin" / "log.csv", folder / "skin" / "rig.toml") as log,
        pytest.raises(InputError, match=r"the rig has no \[skin\].*Available"),
    ):
        load_rig(folder / "six-axis" / "rig.toml").estimator(log)


ARRAY = 'kind = "serial"\naddress = "a"'


@pytest.mark.parametrize(
    ("table", "keys", "word"),
    [
        ("source", 'kind = "nett"', "source: kind must be one of netft, serial, ros2, camera, replay, not 'nett'"),
        ("source", 'kind = "serial"', "source: a serial needs an address"),
        ("source", f'{ARRAY}\nframing = "x"', "source: framing must be one of cobs, lines, not 'x'"),
        ("source", f"{ARRAY}\nport = 65536", "source: ports must be between 1 and 65535"),
        ("source", f"{ARRAY}\nweb = 0", "source: ports must be between 1 and 65535"),
        ("source", f"{ARRAY}\nport = 65535\nweb = 1\ncolumns = [0]\nspeed = 0", ""),
        ("source", 'kind = "ros2"\ndomain = 233', "source: domain must be between 0 and 232"),
        ("source", f"{ARRAY}\nspeed = -1", "source: speed must not be negative"),
        ("source", f"{ARRAY}\ncolumns = [0, -1]", "source: columns must not be negative"),
        ("source", f'{ARRAY}\nwrench = {{ kind = "replay", address = "a" }}', "source: a log that is replayed has its"),
        ("source", 'kind = "replay"\naddress = "a"\nwrench = { kind = "ros2" }', "source: a log that is replayed has"),
        ("source", f"{ARRAY}\nrate = 0", "source: rate must be positive and finite, not 0"),
        ("pokes", 'sensor = "a"', "pokes: sensor and link must be given together"),
        ("pokes", 'urdf = "a"', "pokes: urdf needs sensor and link"),
        ("pokes", 'joints = "j"', "pokes: joints needs a urdf"),
        ("pokes", 'topic = "/a"\npose = { xyz = [0, 0, 0] }', "pokes: topic and pose exclude each other"),
        ("pokes", 'columns = ["a", "b", "c", "d"]', "pokes: columns and position must be given together"),
        ("pokes", "max_gap = 0", "pokes: max_gap must be positive"),
        ("pokes", 'layout = ""', "pokes: layout must name a file, not ''"),
        ("pokes", "priors = { frame = -1 }", "pokes.priors: frame must not be negative"),
        ("pokes", "priors = { lever = 0 }", "pokes.priors: lever must be positive"),
        ("pokes", "priors = { framme = 0.1 }", "unknown key 'framme' in [pokes.priors]. Did you mean 'frame'"),
    ],
)
def test_a_table_s_bounds_are_named(tmp_path: Path, table: str, keys: str, word: str) -> None:
    path = _rig(tmp_path, f"{RIG}\n[{table}]\n{keys}\n")
    with pytest.raises(InputError, match=rf"rig\.toml: {re.escape(word)}") if word else nullcontext():
        load_rig(path)


def test_a_source_is_written_as_it_is_read(tmp_path: Path) -> None:
    """And the pokes' files and priors are those that are stated: angles in degrees."""
    for kind, address in (("netft", "10.0.0.1"), ("serial", "/dev/x"), ("ros2", ""), ("camera", "0"), ("replay", "a")):
        assert load_rig(_rig(tmp_path, RIG + RigSource(kind, address).text())).source == RigSource(kind, address)
    keys = 'sensor = "a"\nlink = "b"\nurdf = "r.urdf"\nlayout = "l.csv"\npriors = { frame = 0, frame_angle = 180 }'
    pokes = load_rig(_rig(tmp_path, f"{RIG}\n[pokes]\n{keys}\n")).pokes
    assert pokes.files(tmp_path) == {"kinematics": tmp_path / "r.urdf", "layout": tmp_path / "l.csv"}
    assert pokes.priors.stated() == {"frame": 0.0, "frame_angle": pytest.approx(np.pi)}
