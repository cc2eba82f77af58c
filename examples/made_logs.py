"""Simulated logs in the forms of other robots and recorders: franka, ur, xela, mat or lerobot.

Run: `python examples/made_logs.py franka`. docs/from has a page for each. What is pressed where is known by
construction: truth.csv.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import polars as pl
import trimesh
from scipy.spatial.transform import Rotation

RNG, RATE = np.random.default_rng(7), 100.0
HALF = np.array([0.02, 0.02, 0.03])  # m: half edges of the box that arms carry
WEIGHT, CENTRE = np.array([0.0, 0.0, -5.0]), np.array([0.002, -0.001, 0.04])  # N in the base, m in the sensor
BIAS = np.array([3.0, -2.0, 8.0, 0.05, -0.08, 0.02])  # N, N m


def carried(height: float, noise: float, free: float) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Times, turns of the arm and wrenches of eight presses of a box whose middle is so far above the sensor [m].

    Nothing touches for the first `free` seconds. Writes tool.stl, in mm, and truth.csv, both in the box's frame.
    """
    time = np.arange(0.0, free + 25.0, 1 / RATE)
    turns = Rotation.from_euler("xyz", np.column_stack([np.sin(w * time) for w in (0.31, 0.47, 0.73)]))
    wrench = RNG.normal(0.0, np.repeat([noise, 0.05 * noise], 3), (len(time), 6))
    rows = list[dict[str, float]]()
    for number, side in enumerate([0, 1, 2, 0, 1, 2, 0, 1]):
        normal = np.eye(3)[side] * (1 if side == 2 or number % 2 else -1)
        point = np.where(normal == 0, RNG.uniform(-0.7, 0.7, 3), normal) * HALF
        force = -RNG.uniform(4, 9) * (normal + 0.2 * np.cross(normal, RNG.normal(size=3)))
        start = free + 3.0 * number + 1.0
        pressed = (time >= start) & (time < start + 1.5)
        wrench[pressed] += [*force, *np.cross(point + np.array([0, 0, height]), force)]
        rows.append(dict(zip(("start", "end", "px", "py", "pz"), (start + 0.1, start + 1.4, *point), strict=True)))
    pl.DataFrame(rows).write_csv("truth.csv")
    trimesh.creation.box(2e3 * HALF).export("tool.stl")
    return time, turns, wrench


def franka() -> None:
    """franka.csv: the external wrench in K, compensated by the robot, and the end effector's pose."""
    time, turns, wrench = carried(0.0, 0.1, 2.0)
    pose = np.zeros((len(time), 4, 4))
    pose[:, :3, :3], pose[:, 3] = turns.as_matrix(), [0.4, 0.0, 0.5, 1.0]  # its columns, one after the other
    pose[:, :3, :3] = pose[:, :3, :3].transpose(0, 2, 1)
    columns = {"time": time}
    columns |= {f"K_F_ext_hat_K[{k}]": -wrench[:, k] for k in range(6)}  # what the robot does to the world
    columns |= {f"O_T_EE[{k}]": pose.reshape(-1, 16)[:, k] for k in range(16)}
    pl.DataFrame(columns).write_csv("franka.csv", float_precision=6)


def ur() -> None:
    """netft.csv: wrenches with weight and bias; rtde.csv: the arm's poses on the same clock, as recorded."""
    time, turns, wrench = carried(0.05, 0.02, 30.0)
    weight = turns.inv().apply(WEIGHT)
    wrench += BIAS + np.hstack([weight, np.cross(CENTRE, weight)])
    names = ("Fx [N]", "Fy [N]", "Fz [N]", "Tx [Nm]", "Ty [Nm]", "Tz [Nm]")
    pl.DataFrame({"time": time} | dict(zip(names, wrench.T, strict=True))).write_csv("netft.csv", float_precision=5)
    pose = np.hstack([np.tile([0.4, 0.0, 0.5], (len(time), 1)), turns.as_rotvec()])
    columns = {"timestamp": time} | {f"actual_TCP_pose_{k}": pose[:, k] for k in range(6)}
    pl.DataFrame(columns).write_csv("rtde.csv", separator=" ", float_precision=6)


def xela() -> None:
    """presses.csv, presses_truth.csv, to calibrate; xela.csv, truth.csv: counts of 4 x 4 taxels of three axes."""
    from palpate_lab.simulation.three_axis_skins import magnetic_skin
    from palpate_lab.simulation.three_axis_touches import REST, three_axis_touches

    skin = magnetic_skin(4, 4, seed=1)
    assert REST >= RATE  # a second untouched, for the tare
    for log, truth, touches in (("presses.csv", "presses_truth.csv", 120), ("xela.csv", "truth.csv", 20)):
        loads = three_axis_touches(skin.positions, RNG, touches)
        counts, loads = skin.readings(loads, seed=touches)
        names = [f"{axis}{k}" for k in range(1, 17) for axis in "XYZ"]
        frames = dict(zip(names, counts.reshape(len(counts), -1).T, strict=True))
        pl.DataFrame({"time": np.arange(len(counts)) / RATE} | frames).write_csv(log, float_precision=2)
        acted = np.column_stack([loads.frame / RATE, loads.place, loads.force])
        acted = acted if log == "presses.csv" else acted[loads.full]
        pl.DataFrame(acted, schema=["time", "px", "py", "pz", "fx", "fy", "fz"]).write_csv(truth)


def mat() -> None:
    """mat.csv: 16 x 16 pressures [kPa] under five presses of round tips; truth.csv."""
    time = np.arange(0.0, 17.0, 1 / 50.0)
    grid = 0.01 * (np.indices((16, 16)) - 7.5)  # m: row, column
    frames, rows = np.zeros((len(time), 16, 16)), list[dict[str, float]]()
    for number in range(5):
        place, force, spread = RNG.uniform(-0.05, 0.05, 2), RNG.uniform(5, 20), 0.009
        start = 2.5 + 2.8 * number
        shape = np.exp(-np.sum((grid - place[:, None, None]) ** 2, axis=0) / (2 * spread**2))
        frames[(time >= start) & (time < start + 1.5)] += force / (2 * np.pi * spread**2) * shape / 1e3
        rows.append({"start": start + 0.1, "end": start + 1.4, "px": place[1], "py": place[0], "pz": 0.0})
    frames *= RNG.normal(1.0, 0.02, (16, 16))  # gains of cells differ
    read = np.rint(10 * (frames + RNG.normal(0.0, 0.1, frames.shape)).clip(0)) / 10
    names = [f"r{row}c{column} [kPa]" for row in range(16) for column in range(16)]
    table = dict(zip(names, read.reshape(len(time), -1).T, strict=True))
    pl.DataFrame({"time": time} | table).write_csv("mat.csv", float_precision=2)
    pl.DataFrame(rows).write_csv("truth.csv")


def lerobot() -> None:
    """data_set: four episodes of version 3.0 with a press of a ball each, and the wrench in observation.state[2:8]."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from claims.evidence.datasets_written import write_dataset

    write_dataset(Path("data_set"), "v3.0", episodes=4)


MAKERS = {maker.__name__: maker for maker in (franka, ur, xela, mat, lerobot)}

if __name__ == "__main__":
    made = MAKERS[sys.argv[1]]
    print(made.__doc__, flush=True)
    made()
