"""Write a run on the phantom as files: what a robot would have recorded, its description, and separately the truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.spatial.pose import Pose
from palpate_lab.simulation.bags import Stamped, header, joint_states, nanoseconds, poses, wrenches, write_bag
from palpate_lab.simulation.phantom.elfin3 import JOINTS, SENSOR, urdf
from palpate_lab.simulation.phantom.lab import PhantomLab, PhantomTruth, Reading
from palpate_lab.simulation.phantom.probes import Probe
from palpate_lab.simulation.tables import write_rows

WRENCH, JOINT, COMMAND, IMU = "/ft_sensor/wrench", "/joint_states", "/robot/command", "/ft_sensor/imu"
FORCE, PHANTOM, PROBE, STATE = "/truth/wrench", "/truth/phantom", "/truth/sensor", "/controller/state"
TRUTH = ("time", "px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "in_plane", "out_of_plane", "press", "depth")
_KINDS = {
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    JOINT: "sensor_msgs/msg/JointState",
    COMMAND: "sensor_msgs/msg/JointState",
    IMU: "sensor_msgs/msg/Imu",
    FORCE: "geometry_msgs/msg/WrenchStamped",
    PHANTOM: "geometry_msgs/msg/PoseStamped",
    PROBE: "geometry_msgs/msg/PoseStamped",
    STATE: "std_msgs/msg/String",
}
RIG = """# A probe on the force/torque sensor of a simulated arm. What it was really pressed with is on /truth/* of the
# recording and in {name}_truth.csv; nothing here knows of it.
[surface]
mesh = "{name}_probe.stl"
unit = "m"

[force_torque]
topic = "{wrench}"
frame = "sensor"
noise = {{ force = {force}, torque = {torque} }}   # N, N m: one standard deviation of one reading
payload = "{name}_payload.toml"

[orientation]
urdf = "{name}_robot.urdf"
joints = "{joints}"
base = "base"
sensor = "{sensor}"

[acceleration]
topic = "{imu}"
kind = "imu"                         # at the sensor's origin

[estimate]
method = "soft_finger"
contact = {{ on = 0.5, off = 0.3 }}    # N
"""


@dataclass(frozen=True)
class PhantomRun:
    """A run, with a row per period of the force/torque sensor.

    Attributes:
        readings: readings of the robot.
        commands: (n, 6) the newest joint command at that time [rad].
        states: states of the controller, in its words.
        truths: the truth.
    """

    readings: list[Reading]
    commands: Float[np.ndarray, "n 6"]
    states: list[str]
    truths: list[PhantomTruth]

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """Times of the readings, (n,) [s]."""
        return np.array([reading.time for reading in self.readings])


def files_of(recording: Path) -> dict[str, Path]:
    """Return a dict of kind -> path of all files of a run, next to its recording.

    The kinds are recording, rig, robot, probe, payload and truth.
    """
    ends = {"rig": "rig.toml", "robot": "robot.urdf", "probe": "probe.stl", "payload": "payload.toml"}
    ends["truth"] = "truth.csv"
    beside = {what: recording.with_name(f"{recording.stem}_{end}") for what, end in ends.items()}
    return {"recording": recording, **beside}


def write_run(run: PhantomRun, lab: PhantomLab, recording: Path, name: str) -> None:
    """Write the recording (MCAP), and next to it rig, robot, probe and truth; the caller writes the payload.

    Args:
        run: run to write.
        lab: lab of the run.
        recording: the MCAP file; the others are named as `files_of` says.
        name: stem of the names in the rig.

    Raises:
        InputError: rosbags is not installed.
    """
    import trimesh

    files, probe, settings = files_of(recording), lab.probe, lab.settings
    write_bag(recording, _KINDS, lambda types: _topics(run, types))
    trimesh.Trimesh(probe.vertices, probe.faces, process=False).export(files["probe"])
    files["robot"].write_text(urdf(probe, f"{name}_probe.stl"), encoding="utf-8")
    filled = RIG.format(
        name=name, wrench=WRENCH, joints=JOINT, sensor=SENSOR, imu=IMU,
        force=max(settings.force_noise, 1e-4), torque=max(settings.torque_noise, 1e-5),
    )  # fmt: skip
    files["rig"].write_text(filled, encoding="utf-8")
    write_rows(files["truth"], TRUTH, (_truth_row(truth, probe) for truth in run.truths if truth.press > 0.0))


def _truth_row(truth: PhantomTruth, probe: Probe) -> list[str]:
    """Return point, direction and force of the tissue on the probe, in the sensor's frame; angles [rad], depth [m]."""
    turn = truth.sensor.rotation.T
    values = [truth.time, *_on_face(truth, probe), *-(turn @ truth.normal), *(turn @ truth.force)]
    return [f"{value:.6f}" for value in (*values, truth.in_plane, truth.out_of_plane, truth.press, truth.depth)]


def _on_face(truth: PhantomTruth, probe: Probe) -> Float[np.ndarray, "3"]:
    """Return the point where the pressure's line of action leaves the probe [m]; the centre of pressure is only a mean.

    The point is on the tangent plane of the cell nearest to the line, of those that face the tissue.
    """
    way = -(truth.sensor.rotation.T @ truth.normal)
    away = probe.points - truth.centre
    facing = probe.normals @ way
    aside = (away**2).sum(axis=1) - (away @ way) ** 2
    cell = int(np.where(facing > 0.3, aside, np.inf).argmin())
    return truth.centre + way * (away[cell] @ probe.normals[cell]) / facing[cell]


def _topics(run: PhantomRun, types: Any) -> Iterable[Iterable[Stamped]]:
    fresh = [reading for reading in run.readings if reading.fresh]
    times, shown = np.array([reading.time for reading in fresh]), np.array([reading.wrench for reading in fresh])
    acts = np.array([_contact_wrench(truth) for truth in run.truths])
    fed = [reading for reading in run.readings if reading.joints_time == reading.time]
    joints = np.array([each.joints for each in fed])
    sent = np.flatnonzero(np.r_[True, np.any(np.diff(run.commands, axis=0) != 0.0, axis=1)])
    return (
        wrenches(types, WRENCH, times, shown),
        joint_states(types, JOINT, np.array([each.time for each in fed]), JOINTS, joints),
        joint_states(types, COMMAND, run.time[sent], JOINTS, run.commands[sent]),
        _accelerations(types, run.readings),
        wrenches(types, FORCE, run.time, acts),
        _poses(types, PHANTOM, run.time, [truth.phantom for truth in run.truths]),
        _poses(types, PROBE, run.time, [truth.sensor for truth in run.truths]),
        _states(types, run),
    )


def _contact_wrench(truth: PhantomTruth) -> Float[np.ndarray, "6"]:
    """Return the wrench of the tissue on the probe, about the sensor's origin and in its frame."""
    turn = truth.sensor.rotation.T
    return np.concatenate([turn @ truth.force, turn @ truth.moment])


def _poses(types: Any, topic: str, time: Float[np.ndarray, " n"], seen: list[Pose]) -> Iterator[Stamped]:
    turns, places = np.array([pose.quaternion() for pose in seen]), np.array([pose.translation for pose in seen])
    return poses(types, topic, time, turns, places)


def _accelerations(types: Any, readings: list[Reading]) -> Iterator[Stamped]:
    imu, vector, turn = (
        types[name] for name in ("sensor_msgs/msg/Imu", "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion")
    )
    nothing, unknown = np.zeros(9), np.array([-1.0, *[0.0] * 8])  # -1: no orientation, no angular velocity
    for stamp, reading in zip(nanoseconds(np.array([each.time for each in readings])), readings, strict=True):
        rest = turn(0.0, 0.0, 0.0, 1.0), unknown, vector(0.0, 0.0, 0.0), unknown
        felt = vector(*reading.acceleration.tolist())
        yield stamp, IMU, imu(header(types, stamp, SENSOR), *rest, felt, nothing)


def _states(types: Any, run: PhantomRun) -> Iterator[Stamped]:
    """Yield a message where the state changes."""
    before = ""
    for stamp, state in zip(nanoseconds(run.time), run.states, strict=True):
        if state != before:
            yield stamp, STATE, types["std_msgs/msg/String"](state)
        before = state
