"""What makers' wrenches mean: sign, frame, point, handedness and orientation, each wrong once, and all of them right.

Twelve makers' layouts, by names as their drivers and manuals have them. A session is twelve presses on a box or a ball
that a turning arm holds; what is logged follows from it by the formulas in `_logged`. Each table goes through `palpate
rig new` and `palpate estimate`, where the rig states what is usual of that maker.
"""

import re
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tomlkit
import trimesh
from scipy.spatial.transform import Rotation, Slerp

from claims.command import cli
from claims.row import Row
from palpate.files.contacts import read_contacts

PRESSES, LENGTH, GAP, RATE = 12, 25, 15, 100.0  # rows of a press and of the pause before it, Hz
NOISE = (0.02, 4e-4)  # N, N m
NEAR = 4e-3  # m: of the true place, at the median of a press
FLANGE = (0.0, 0.0, -0.12)  # m in the sensor's frame: a usual other point of the torque
IDENTITY, MIRROR = np.eye(3), np.diag([-1.0, 1.0, 1.0])
Columns = dict[str, np.ndarray]
Session = tuple[np.ndarray, np.ndarray, Rotation, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Meaning:
    """What is logged: sign, frames, point [m in the sensor's frame, or "base"], axes, and form of the orientation."""

    sign: float = 1.0
    frame: str = "sensor"
    torque_frame: str = "sensor"
    point: tuple[float, float, float] | str = (0.0, 0.0, 0.0)
    force_axes: np.ndarray = field(default_factory=lambda: IDENTITY)
    torque_axes: np.ndarray = field(default_factory=lambda: IDENTITY)
    form: str = "quaternion"


@dataclass(frozen=True)
class Maker:
    """A layout.

    Attributes:
        wrench: six names.
        pose: names of the orientation, in `usual.form`.
        position: names of the position.
        usual: what this maker writes.
        states: what the rig must state of it, table -> key -> value; what `rig new` knows by the names is not in it.
    """

    wrench: tuple[str, ...]
    pose: tuple[str, ...] = ("qx", "qy", "qz", "qw")
    position: tuple[str, ...] = ("x", "y", "z")
    usual: Meaning = Meaning()
    states: Mapping[str, Mapping[str, object]] = field(default_factory=dict)


def _six(name: str, low: int = 0) -> tuple[str, ...]:
    return tuple(name.format(k + low) for k in range(6))


def _words(force: str, torque: str) -> tuple[str, ...]:
    return tuple(word.format(axis) for word in (force, torque) for axis in "xyz")


_ARM = ("pose_qx", "pose_qy", "pose_qz", "pose_qw")
_BASED = Meaning(frame="base", torque_frame="base")
_LEFT = {"axes": ["-x", "y", "z"], "left_handed": True}
MAKERS = {
    # frankarobotics/libfranka issue 26, robot_state.h: the robot's wrench on the world; O_T_EE is column-major
    "Franka": Maker(
        _six("state.O_F_ext_hat_K[{}]"),
        tuple(f"state.O_T_EE[{k}]" for k in range(16)),
        (),
        replace(_BASED, sign=-1.0, point="base", form="matrix_columns"),
    ),
    # UniversalRobots/Universal_Robots_ROS2_Driver pull request 1287: base axes, about the TCP on CB3
    "UR CB": Maker(
        _six("actual_TCP_force_{}"),
        _six("actual_TCP_pose_{}")[3:],
        _six("actual_TCP_pose_{}")[:3],
        replace(_BASED, form="rotation_vector"),
    ),
    # the same pull request: about the tool flange on e-Series
    "UR e-Series": Maker(
        _six("actual_TCP_force_{}"),
        _six("actual_TCP_pose_{}")[3:],
        _six("actual_TCP_pose_{}")[:3],
        replace(_BASED, point=FLANGE, form="rotation_vector"),
        {"force_torque": {"reference": list(FLANGE)}},
    ),
    # IFL-CAMP/iiwa_stack CartesianWrench, epfl-lasa/iiwa_ros issue 19: along the flange's axes; A, B, C about z, y, x
    "KUKA": Maker(
        _words("CartesianWrench.wrench.force.{}", "CartesianWrench.wrench.torque.{}"),
        ("A [deg]", "B [deg]", "C [deg]"),
        ("X", "Y", "Z"),
        Meaning(form="euler_ZYX_deg"),
        {"orientation": {"form": "euler_ZYX_deg", "columns": ["A [deg]", "B [deg]", "C [deg]"]}},
    ),
    # Kinovarobotics/kortex BaseFeedback: tool_external_wrench_*, theta in degrees; its frame is not written there
    "Kinova": Maker(
        _words("tool_external_wrench_force_{}", "tool_external_wrench_torque_{}"),
        ("tool_pose_theta_x", "tool_pose_theta_y", "tool_pose_theta_z"),
        ("tool_pose_x", "tool_pose_y", "tool_pose_z"),
        replace(_BASED, form="euler_xyz_deg"),
        {"force_torque": {"frame": "base"}},
    ),
    # doosan-robot2 RobotStateRt.msg: external_tcp_force along the axes of the base
    "Doosan": Maker(_six("external_tcp_force[{}]"), _ARM, ("p_x", "p_y", "p_z"), _BASED, {"orientation": {}}),
    # roboticslab-uc3m/kinematics-dynamics issue 191: axes of the left hand
    "JR3": Maker(
        _words("jr3_force_{}", "jr3_moment_{}"),
        usual=Meaning(force_axes=MIRROR, torque_axes=MIRROR),
        states={"force_torque": _LEFT},
    ),
    # Bota Systems' serial protocol and bota_driver: geometry_msgs/WrenchStamped of the sensor
    "Bota": Maker(("Fx", "Fy", "Fz", "Mx", "My", "Mz")),
    # OnRobot HEX manual: FT_Tool and FT_Base
    "OnRobot": Maker(_words("F{} (N)", "T{} (Nm)")),
    # Robotiq FT 300 manual, data stream
    "Robotiq": Maker(_words("F{}[N]", "M{}[Nm]")),
    # ATI 9610-05; UTNuclearRoboticsPublic/netft_utils issue 3: right-handed
    "Net F/T": Maker(_words("F{} [N]", "T{} [N-m]")),
    # geometry_msgs/WrenchStamped and PoseStamped, flattened
    "ROS": Maker(
        _words("ft.wrench.force.{}", "ft.wrench.torque.{}"),
        tuple(f"pose.orientation.{axis}" for axis in "xyzw"),
        tuple(f"pose.position.{axis}" for axis in "xyz"),
        states={"orientation": {}},
    ),
}
MISTAKES = ("sign", "frame", "point", "handedness", "orientation")
KEYS = {  # of a rig, that mend a mistake
    "sign": "acts_on",
    "frame": "frame",
    "point": "reference",
    "handedness": "axes",
    "orientation": r"\[orientation\]|orientation\.form|form = ",
}
LISTED = re.compile(r"check the units of [^:]*")  # sentences that list what may be wrong


@dataclass(frozen=True)
class Table:
    """A table: whose, what is wrong with it ("": nothing), on which body, with which form of poses."""

    maker: str
    mistake: str = ""
    body: str = "box"
    form: str = ""
    seed: int = 1

    @property
    def name(self) -> str:
        return ", ".join(filter(None, (self.maker, self.mistake or "right", self.body, self.form)))

    def logged(self) -> Meaning:
        maker = MAKERS[self.maker].usual
        usual = replace(maker, form=self.form) if self.form else maker
        if self.mistake == "sign":
            return replace(usual, sign=-usual.sign)
        if self.mistake == "frame":
            other = "base" if usual.frame == "sensor" else "sensor"
            return replace(usual, frame=other, torque_frame=other)
        if self.mistake == "point":
            return replace(usual, point=FLANGE if usual.point in ((0.0, 0.0, 0.0), "base") else (0.0, 0.0, 0.0))
        if self.mistake == "handedness":
            force, torque = ((True, False), (False, True), (True, True))[[*MAKERS].index(self.maker) % 3]
            return replace(
                usual,
                force_axes=usual.force_axes @ (MIRROR if force else IDENTITY),
                torque_axes=usual.torque_axes @ (MIRROR if torque else IDENTITY),
            )
        if self.mistake == "orientation":
            return replace(usual, form=_OTHERS.get(usual.form, "quaternion_wxyz"))
        return usual


_OTHERS = {
    "matrix_columns": "matrix_rows",
    "rotation_vector": "euler_xyz",
    "euler_ZYX_deg": "euler_xyz_deg",
    "euler_xyz_deg": "euler_ZYX_deg",
}
_NAMES = {"matrix_columns": 9, "matrix_rows": 9, "quaternion": 4, "quaternion_wxyz": 4}
_FORMS: tuple[tuple[str, str], ...] = (  # body and form of the poses of good tables
    ("box", ""),
    ("ball", ""),
    ("box", "quaternion_wxyz"),
    ("ball", "matrix_rows"),
    ("box", "rotation_vector"),
    ("ball", "euler_XYZ"),
    ("box", "matrix_columns"),
)
WRONG = tuple(
    Table(maker, mistake, "box" if (k + row) % 2 else "ball", seed=30 + row)
    for row, maker in enumerate(MAKERS)
    for k, mistake in enumerate(MISTAKES)
)
GOOD = tuple(
    Table(maker, body=body, form=form, seed=2 + k)
    for maker in MAKERS
    for k, (body, form) in enumerate(_FORMS)
)  # fmt: skip


def _session(body: str, seed: int) -> Session:
    """Force and torque (n, 3) of the sensor, its rotations and places (n, 3), the press of each row, and points."""
    rng = np.random.default_rng(seed)
    shape = _shape(body)
    points, facets = trimesh.sample.sample_surface(shape, 40 * PRESSES, seed=seed)
    normals = shape.face_normals[facets] if body == "box" else _unit(points - shape.centroid)
    free = normals[:, 2] > -0.4  # the side at the sensor holds the body
    points, normals = points[free][:PRESSES], normals[free][:PRESSES]
    rows = PRESSES * (LENGTH + GAP)
    press = np.repeat(np.arange(PRESSES), LENGTH + GAP)
    press[np.arange(rows) % (LENGTH + GAP) < GAP] = -1
    knots = np.linspace(0, rows - 1, PRESSES + 1)
    rotation = Slerp(knots, Rotation.random(PRESSES + 1, random_state=rng))(np.arange(rows))
    walk = rng.uniform((0.3, -0.3, 0.2), (0.6, 0.3, 0.6), (PRESSES + 1, 3))
    position = np.stack([np.interp(np.arange(rows), knots, column) for column in walk.T], axis=1)
    aside = np.cross(normals, rng.normal(size=(PRESSES, 3)))
    pushes = rng.uniform(4, 10, (PRESSES, 1)) * (0.3 * rng.uniform(size=(PRESSES, 1)) * _unit(aside) - normals)
    force, torque = (noise * rng.standard_normal((rows, 3)) for noise in NOISE)
    there = press >= 0
    force[there] += pushes[press[there]]
    torque[there] += np.cross(points, pushes)[press[there]]
    return force, torque, rotation, position, press, points


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _shape(body: str) -> trimesh.Trimesh:
    """Make a body that lies off the sensor's axis, in m in the sensor's frame."""
    shape = trimesh.creation.box((0.05, 0.036, 0.07)) if body == "box" else trimesh.creation.icosphere(5, 0.03)
    shape.apply_translation((0.014, -0.009, 0.085))
    return shape


def _logged(session: Session, meaning: Meaning) -> np.ndarray:
    """The six columns: of a wrench (F, M) about the sensor's origin, M - P x F is the torque about a point P."""
    force, torque, rotation, position, _, _ = session
    point = -rotation.inv().apply(position) if isinstance(meaning.point, str) else np.array([meaning.point])
    torque = torque - np.cross(point, force)
    parts = ((force, meaning.frame, meaning.force_axes), (torque, meaning.torque_frame, meaning.torque_axes))
    framed = [(rotation.apply(part) if frame == "base" else part) @ axes for part, frame, axes in parts]
    return meaning.sign * np.hstack(framed)


def _orientation(rotation: Rotation, position: np.ndarray, form: str, count: int) -> np.ndarray:
    """The columns of an orientation, with the position in a matrix of 16."""
    if form.startswith("matrix"):
        pose = np.tile(np.eye(4), (len(position), 1, 1))
        pose[:, :3, :3], pose[:, :3, 3] = rotation.as_matrix(), position
        pose = pose if count == 16 else pose[:, :3, :3]
        return (pose if form == "matrix_rows" else pose.swapaxes(1, 2)).reshape(len(position), -1)
    if form.startswith("quaternion"):
        return rotation.as_quat()[:, [3, 0, 1, 2] if form.endswith("wxyz") else [0, 1, 2, 3]]
    if form == "rotation_vector":
        return rotation.as_rotvec()
    return rotation.as_euler(form.split("_")[1], degrees=form.endswith("deg"))


def _columns(table: Table, session: Session) -> tuple[Columns, dict[str, dict[str, object]]]:
    """The columns of the table, and what the rig states."""
    maker, meaning = MAKERS[table.maker], table.logged()
    states = {key: dict(value) for key, value in maker.states.items()}
    names = maker.pose
    if table.form:
        names = tuple(f"o{k}" for k in range(_NAMES.get(table.form, 3)))
        states["orientation"] = {"columns": list(names), "form": table.form}
    elif not states.get("orientation", True):
        states["orientation"] = {"columns": list(names)}
    place = maker.position or (("x", "y", "z") if table.form else ())
    if place and "orientation" in states:
        states["orientation"] |= {"position": list(place)}
    pose = _orientation(session[2], session[3], meaning.form, len(names))
    columns: Columns = {"time [s]": np.arange(len(pose)) / RATE}
    for names_, values in ((names, pose), (place, session[3]), (maker.wrench, _logged(session, meaning))):
        columns |= dict(zip(names_, values.T, strict=bool(names_)))
    return columns, states


@dataclass(frozen=True)
class Outcome:
    """What became of a table.

    Attributes:
        verdict: "right"; "named": a warning or refusal has the key that mends it; "listed": a warning has it
            among others; "warned" of something else; "stated": `rig new` says by this key what it takes the wrench for;
            "refused" for another reason; "silent".
        message: what `estimate` warned of, or why it refused.
        warnings: of `estimate`.
    """

    verdict: str
    message: str
    warnings: int


def tried(table: Table, folder: Path) -> Outcome:
    """`rig new`, what is usual stated in the rig, `estimate`; then judged by the true places."""
    session = _session(table.body, table.seed)
    columns, states = _columns(table, session)
    log, rig, mesh, found = (folder / name for name in ("log.csv", "rig.toml", "body.stl", "contacts.csv"))
    rows_ = np.column_stack(list(columns.values()))
    np.savetxt(log, rows_, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    _shape(table.body).apply_scale(1e3).export(mesh)
    code, _, _, made = cli("rig", "new", log, mesh, "-o", rig, "--force")
    if code:
        return _judged(table, "refused", made)
    rig.write_text(_stated(tomllib.loads(rig.read_text()), states))
    code, _, _, said = cli("estimate", log, "--rig", rig, "-o", found)
    if code not in (0, 4):
        return _judged(table, "refused", said)
    warned = "".join(re.findall(r"warning: .*\n(?:    .*\n)*", said))
    wrong = "stated" if table.mistake and re.search(KEYS[table.mistake], " ".join(made.split())) else "silent"
    return _judged(table, "right" if _right(found, session) else wrong, warned, warned.count("warning:"))


def _judged(table: Table, verdict: str, said: str, warnings: int = 0) -> Outcome:
    said = " ".join(said.split())
    if table.mistake and verdict != "right":
        key = KEYS[table.mistake]
        if re.search(key, LISTED.sub("", said)):
            return Outcome("named", said, warnings)
        verdict = "listed" if re.search(key, said) else "warned" if warnings else verdict
    return Outcome(verdict, said, warnings)


def _right(found: Path, session: Session) -> bool:
    contacts, (*_, press, points) = read_contacts(found), session
    off = np.linalg.norm(contacts.estimate.point - points[press], axis=1)
    off = np.where(contacts.estimate.answered, off, np.inf)
    return all(np.median(off[press == k]) < NEAR for k in range(PRESSES))


def _stated(rig: dict[str, dict[str, object]], states: Mapping[str, Mapping[str, object]]) -> str:
    for name, keys in states.items():
        rig[name] = dict(keys) if name == "orientation" else {**rig.get(name, {}), **keys}
    return tomlkit.dumps(rig)


def rows(small: bool) -> Iterator[Row]:
    wrong, good = (tables[:: 11 if small else 1] for tables in (WRONG, GOOD))
    with tempfile.TemporaryDirectory() as folder:
        found = {table: tried(table, Path(folder)) for table in (*wrong, *good)}
    yield from _wrong({table: found[table] for table in wrong})
    clean = [table for table in good if found[table].verdict == "right" and not found[table].warnings]
    lost = "; ".join(table.name for table in good if table not in clean)
    got = f"{len(clean)} of {len(good)}{': not ' * bool(lost)}{lost}"
    yield Row("good tables: true places, and no warning", "all", got, not lost)


def _wrong(found: Mapping[Table, Outcome]) -> Iterator[Row]:
    for mistake in MISTAKES:
        verdicts = [outcome.verdict for table, outcome in found.items() if table.mistake == mistake]
        got = ", ".join(f"{verdicts.count(word)} {word}" for word in dict.fromkeys(sorted(verdicts)))
        yield Row(f"{mistake} other than the rig has it", "", got or "skipped")
    for what, target, words, least in (
        ("right, or a sentence has the key that mends it", ">= 95 %", ("right", "named", "listed", "stated"), 0.95),
        ("right, or named by a warning or refusal of this table", "", ("right", "named"), 0.0),
        ("refused without naming it", "<= 10 %", ("refused",), None),
        ("its key is only listed among others", "", ("listed",), None),
        ("warned of something else", "", ("warned",), None),
        ("only stated by `rig new` as what the wrench is taken for", "", ("stated",), None),
        ("wrong in silence", "0", ("silent",), None),
    ):
        these = [table for table, outcome in found.items() if outcome.verdict in words]
        share = len(these) / max(len(found), 1)
        met = None if not target else share >= least if least is not None else share <= (0.1 if "%" in target else 0.0)
        listed = ": " + "; ".join(table.name for table in these) if least is None and these else ""
        yield Row(f"wrong tables: {what}", target, f"{len(these)} of {len(found)}{listed}", met)
