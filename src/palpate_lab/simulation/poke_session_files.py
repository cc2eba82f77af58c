"""Write a session of pokes as a laboratory would have it: logs, the arm's description, CAD, and the truth."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial.pose import quaternion_from_rotation
from palpate_lab.simulation.bags import Stamped, joint_states, readings, wrenches, write_bag
from palpate_lab.simulation.forearm import Cone
from palpate_lab.simulation.poke_bench import PokeSession
from palpate_lab.simulation.poke_log import EVERY, PokeLog, Timing, simulate_poke_log
from palpate_lab.simulation.skin_touches import SkinTouches, simulate_touches
from palpate_lab.simulation.tables import formatted, write_rows

WRENCH_TOPIC, TAXEL_TOPIC, JOINT_TOPIC = "/ft_sensor/wrench", "/skin/taxels", "/joint_states"
JOINTS = ("elbow_pitch", "elbow_roll")
_FORM = ".7g"
_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_URDF = """<robot name="arm">
  <link name="ft_sensor"/>
  <link name="elbow"/>
  <link name="forearm">
    <visual><geometry><mesh filename="forearm.stl"/></geometry></visual>
  </link>
  <joint name="elbow_pitch" type="revolute">
    <parent link="ft_sensor"/><child link="elbow"/>
    <origin xyz="0 0 {upper}"/><axis xyz="0 1 0"/>
    <limit lower="0.26" upper="1.85" effort="20" velocity="2"/>
  </joint>
  <joint name="elbow_roll" type="revolute">
    <parent link="elbow"/><child link="forearm"/>
    <origin xyz="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1.58" upper="1.58" effort="20" velocity="2"/>
  </joint>
</robot>
"""


def write_poke_session(
    session: PokeSession,
    cone: Cone,
    cad: TaxelPlaces,
    folder: Path,
    rng: np.random.Generator,
    *,
    timing: Timing | None = None,
    touches: int = 60,
) -> PokeLog:
    """Write the session, and touches of the same skin afterwards; return the `PokeLog` of the pokes.

    pokes.mcap; pokes_log.csv, the same at 50 Hz; pokes.csv, one row a poke; arm.urdf and forearm.stl; cad.txt;
    truth.csv; touches.mcap, touches.csv and touches_truth.csv (single touches); the same for
    pairs (two at once, at a distance of 12 mm).

    Args:
        session: session of pokes.
        cone: the link.
        cad: places that CAD states.
        folder: created if it does not exist.
        rng: random numbers of noise and touches.
        timing: times of the pokes.
        touches: number of touches.

    Raises:
        InputError: rosbags is not installed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = simulate_poke_log(session, rng, timing)
    write_poke_log(log, folder / "pokes.mcap")
    names, numbers = log.table()
    write_rows(folder / "pokes_log.csv", names, formatted(numbers, _FORM))
    _write_pokes(session, folder / "pokes.csv")
    write_arm(session.bench.arm.upper, cone, folder)
    write_places(cad, folder / "cad.txt")
    places = session.bench.skin.places
    rows = np.column_stack([places.positions, places.normals, places.module])
    write_rows(folder / "truth.csv", ("x", "y", "z", "nx", "ny", "nz", "module"), formatted(rows, _FORM))
    write_touches(simulate_touches(session.bench, rng, touches), folder, "touches")
    write_touches(simulate_touches(session.bench, rng, touches, spacing=12e-3), folder, "pairs")
    return log


def write_poke_log(log: PokeLog, path: Path) -> None:
    """Write a log as MCAP: WrenchStamped at 200 Hz, JointState at 100 Hz, taxels as UInt8MultiArray at 50 Hz.

    Raises:
        InputError: rosbags is not installed.
    """

    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        return (
            wrenches(types, WRENCH_TOPIC, log.time, log.wrench),
            joint_states(types, JOINT_TOPIC, log.time[::2], JOINTS, log.joints[::2]),
            readings(types, TAXEL_TOPIC, log.time[::EVERY], log.taxels, ("taxel",)),
        )

    kinds = {WRENCH_TOPIC: "geometry_msgs/msg/WrenchStamped", JOINT_TOPIC: "sensor_msgs/msg/JointState"}
    write_bag(path, kinds | {TAXEL_TOPIC: "std_msgs/msg/UInt8MultiArray"}, made)


def write_touches(touches: SkinTouches, folder: Path, name: str) -> None:
    """Write samples as NAME.mcap and NAME.csv (time, t0 and so on), and NAME_truth.csv for `palpate evaluate`.

    Raises:
        InputError: rosbags is not installed.
    """
    counts = np.clip(np.rint(touches.frames), 0, 255).astype(np.uint8)
    write_bag(
        folder / f"{name}.mcap",
        {TAXEL_TOPIC: "std_msgs/msg/UInt8MultiArray"},
        lambda types: (readings(types, TAXEL_TOPIC, touches.time, counts, ("taxel",)),),
    )
    taxels = tuple(f"t{k}" for k in range(touches.frames.shape[1]))
    frames = np.column_stack([touches.time, touches.frames])
    write_rows(folder / f"{name}.csv", ("time", *taxels), formatted(frames, _FORM))
    point = ("px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz")
    write_rows(folder / f"{name}_truth.csv", ("time", *point), formatted(touches.truth(), _FORM))


def write_arm(upper: float, cone: Cone, folder: Path) -> None:
    """Write arm.urdf, with links ft_sensor, elbow and forearm, and next to it the mesh forearm.stl in metres."""
    import trimesh

    (folder / "arm.urdf").write_text(_URDF.format(upper=upper), encoding="utf-8")
    trimesh.Trimesh(*cone.mesh(), process=False).export(folder / "forearm.stl")


def write_places(places: TaxelPlaces, path: Path) -> None:
    """Write places in iCub's plain form: x y z [m] nx ny nz, a row per taxel, zeros where there is none.

    Raises:
        OSError: the file cannot be written.
    """
    rows = np.where(places.there[:, None], np.column_stack([places.positions, places.normals]), 0.0)
    np.savetxt(path, rows, fmt="%9.6f")


def _write_pokes(session: PokeSession, path: Path) -> None:
    pokes = session.pokes
    answers = np.zeros((len(pokes), pokes.taxels))
    answers[pokes.poke, pokes.taxel] = pokes.response
    rows = [pokes.time, pokes.configuration, pokes.wrench, quaternion_from_rotation(pokes.rotation), pokes.origin]
    pose = ("qx", "qy", "qz", "qw", "x", "y", "z")
    names = ("time", "configuration", *_WRENCH, *pose, *(f"t{k}" for k in range(pokes.taxels)))
    write_rows(path, names, formatted(np.column_stack([*rows, answers]), _FORM))
