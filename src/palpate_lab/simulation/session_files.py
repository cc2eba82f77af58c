"""Write a simulated session as a laboratory would have it: logs, a mesh in millimetres, marks, a rig by the drawing."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.signals.recording import ORIENTATION, Recording
from palpate.spatial.pose import Pose
from palpate_lab.simulation.session import NOISE, Session, SessionTouches
from palpate_lab.simulation.tables import write_rows

WRENCH_TOPIC, POSE_TOPIC = "/ft_sensor/wrench", "/arm/sensor_pose"
LOG = ("time", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
TOUCH = ("start", "end", "px", "py", "pz", "label")
RIG = """# Where the probe sits, how the sensor is logged, how contacts are located. Lengths in metres unless stated.
[surface]
mesh = "probe.stl"
unit = "mm"                          # of the mesh file
crease = 30                          # degrees: normals are smooth within it, split across it; 0 is faceted
pose = {{ xyz = {xyz}, quaternion_xyzw = {quaternion} }}  # of the surface in the sensor's frame, from the drawing

[force_torque]
columns = ["fx", "fy", "fz", "tx", "ty", "tz"]   # of a table
topic = "{wrench_topic}"          # of an MCAP file or a bag
units = {{ force = "N", torque = "N m" }}
axes = ["x", "y", "z"]
frame = "sensor"
noise = {{ force = {force}, torque = {torque} }}   # N, N m: one standard deviation of one reading, from the data sheet
range = {{ force = 200, torque = 10 }}       # N, N m
payload = "payload.toml"             # written by: palpate calibrate payload

[orientation]
columns = ["qx", "qy", "qz", "qw"]   # sensor in base, in a table
topic = "{pose_topic}"            # poses of the sensor in the base, on a clock of their own
offset = 0.0                         # s added to their stamps; written by: palpate calibrate clock

[filter]
kind = "butterworth"                 # of the compensated wrench, before it is located
cutoff = 15                          # Hz
order = 2

[estimate]
method = "soft_finger"
friction = 1.0                       # bounds tan(theta)
torsion = 0.005                      # m: bounds |torque| / |normal force|
contact = {{ on = 0.5, off = 0.3 }}    # N
"""


def write_session(session: Session, folder: Path) -> None:
    """Write a session into a folder: free_motion.csv, touches.csv, marks.csv, truth.csv, probe.stl and rig.toml.

    Of the touches, the first, third, ... are in marks.csv, with the points at which they were aimed (as an operator
    knows them); the others are in truth.csv, with the points at which they really landed (as only a simulation knows),
    so that a calibration on the one can be judged on the other. The folder is made if it is missing.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    import trimesh

    folder.mkdir(parents=True, exist_ok=True)
    write_rows(folder / "free_motion.csv", LOG, _log(session.free_motion))
    write_rows(folder / "touches.csv", LOG, _log(session.touches))
    write_rows(folder / "marks.csv", TOUCH, _touches(session.truth, session.truth.mark, slice(0, None, 2)))
    write_rows(folder / "truth.csv", TOUCH, _touches(session.truth, session.truth.point, slice(1, None, 2)))
    trimesh.Trimesh(1e3 * session.vertices, session.faces, process=False).export(folder / "probe.stl")
    (folder / "rig.toml").write_text(_rig(session.nominal), encoding="utf-8")


def _rig(pose: Pose) -> str:
    return RIG.format(
        xyz=pose.translation.tolist(),
        quaternion=pose.quaternion().tolist(),
        force=NOISE[0],
        torque=NOISE[3],
        wrench_topic=WRENCH_TOPIC,
        pose_topic=POSE_TOPIC,
    )


def _log(recording: Recording) -> Iterable[list[str]]:
    table = np.column_stack([recording.time, recording.wrenches(), recording.channels[ORIENTATION]])
    return ([f"{row[0]:.4f}", *(f"{value:.6f}" for value in row[1:])] for row in table.tolist())


def _touches(touches: SessionTouches, points: Float[np.ndarray, "n 3"], rows: slice) -> Iterable[list[str]]:
    numbers = np.column_stack([touches.start, touches.end, points])[rows].tolist()
    return (
        [*(f"{value:.6f}" for value in row), label] for row, label in zip(numbers, touches.label[rows], strict=True)
    )
