"""Tasks on logs of wrench sensors: a probe on a moving arm, and a fingertip on force cells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate_lab.benchmark.task import MadeTask, TaskTruth, write_body, write_table
from palpate_lab.simulation.ball_on_ellipse import FINGERTIP
from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.session import NOISE, RATE, simulate_session
from palpate_lab.simulation.session_files import write_session

NEAR = 0.1  # s about a touch that are not judged as untouched
PRESS_RATE, REST, RAMP, HOLD, PAUSE = 100.0, 1.0, 0.1, 0.4, 0.3  # Hz, s: of the fingertip
THIN = 20  # one sample in this many of the bench's 1000 Hz
CELL_AXES = "xyz"
TIP = f"""# What task.toml says, as a rig of Palpate.
[surface]
kind = "elliptic_cylinder"
a = {FINGERTIP.a}
b = {FINGERTIP.b}
half_length = 0.016
upper = true

[estimate]
tare = {0.8 * REST}
"""


def payload_log(folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
    """Make a log of a probe on a turning force/torque sensor, as a `MadeTask`, and write its files into `folder`.

    The readings include the probe's weight and the sensor's bias.
    """
    session = simulate_session(int(rng.integers(2**31)), touches=4 if small else 10, facets=3000)
    session = replace(session, nominal=session.true)  # where the probe sits is known here
    write_session(session, folder)
    (folder / "touches.csv").rename(folder / "readings.csv")
    (folder / "marks.csv").unlink()
    write_body(folder / "body.stl", session.vertices, session.faces)
    time, contact, pose = session.touches.time, session.contact, session.true
    steady = np.zeros(len(time), dtype=np.int64)
    for k, (start, end) in enumerate(zip(session.truth.start, session.truth.end, strict=True)):
        steady[(time >= start) & (time < end)] = k + 1
    held = np.flatnonzero(steady)
    truth = TaskTruth.of(
        held, session.truth.point[steady[held] - 1], contact[held, :3] @ pose.rotation, _quiet(contact, NEAR * RATE)
    )
    return MadeTask(
        "log",
        "a probe that weighs 4 to 5 N on a force/torque sensor with a zero of its own, turned by an arm and touched; "
        "free_motion.csv is of the same tool without touch",
        "of the mesh, which sits at `pose` in the sensor's frame; the readings are in the sensor's frame",
        len(time),
        1,
        {
            "readings.csv": "time, wrench, and orientation qx, qy, qz, qw of the sensor in the base; a row a sample",
            "free_motion.csv": "the same columns, untouched",
            "body.stl": "the probe, in metres",
            "rig.toml": "the same facts as a rig of Palpate; with it probe.stl, in millimetres",
        },
        truth,
        {
            "noise": {"force": NOISE[0], "torque": NOISE[3]},
            "pose": {"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()},
            "friction": 0.4,
            "torsion": 0.0025,
        },
    )


def fingertip(folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
    """Make voltages of four 3-axis force cells under a fingertip, as a `MadeTask`, and write its files into `folder`.

    A bench log to calibrate by is among them.

    Raises:
        OSError: the folder does not exist or cannot be written.
    """
    bench = replace(BENCHES["rigid"], seed=int(rng.integers(2**31)))
    run = bench.run(0, thin=THIN)
    names = [f"u{cell}{axis}" for cell in range(1, bench.cells().count + 1) for axis in CELL_AXES]
    known = [f"ref_f{axis}" for axis in CELL_AXES] + [f"ref_{axis}" for axis in CELL_AXES]
    table = np.column_stack([run.time, run.voltages, run.force, run.position])
    write_table(folder / "bench.csv", dict(zip(["time", *names, *known], table.T, strict=True)), digits=9)
    time, wrenches, truth = _pressed(6 if small else 24, rng)
    volts = bench.cells().voltages(wrenches) + rng.normal(0.0, 0.02, len(names))
    volts += bench.channel_noise() * rng.standard_normal(volts.shape)
    write_table(folder / "readings.csv", dict(zip(["time", *names], np.c_[time, volts].T, strict=True)), digits=9)
    (folder / "plain.toml").write_text(f"{TIP}\n[load_cells]\n", encoding="utf-8")
    (folder / "rig.toml").write_text(f'{TIP}\n[load_cells]\nmodel = "tip.toml"\n', encoding="utf-8")
    return MadeTask(
        "load_cells",
        f"a fingertip on four 3-axis force cells, pressed at one place after the other; the first {REST:g} s are "
        "untouched. It is the upper side of the elliptic cylinder (x/a)^2 + (z/b)^2 = 1 along y, |y| < 16 mm",
        "of the elliptic cylinder",
        len(time),
        1,
        {
            "readings.csv": "time and voltages of the cells, u1x, u1y, u1z, u2x ...; a row a sample",
            "bench.csv": "a bench with the same cells: a ball slides over the tip; with the voltages the force on the "
            "tip (ref_fx ...) and the place of the ball's centre (ref_x ...). Where time jumps, zeros are new, and the "
            "first 2 s from there are untouched",
            "rig.toml": "the same facts as a rig of Palpate; plain.toml is the same before the calibration",
        },
        truth,
        {
            "a": FINGERTIP.a,
            "b": FINGERTIP.b,
            "ball": bench.radius,
            "rest": REST,
            "noise": {"voltage": bench.channel_noise(), "bench_force": bench.reference_noise},
            "friction": 0.5,
            "torsion": 0.00125,
        },
    )


def _pressed(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, TaskTruth]:
    """Return times (n,) [s], wrenches (n, 6) and the truth of successive presses on the fingertip."""
    points, normals = FINGERTIP.foot(rng.uniform(-9e-3, 9e-3, count), rng.uniform(-12e-3, 12e-3, count))
    whole = touch_wrenches(points, normals, rng, force=(1.0, 5.0), tan_theta=0.5, pitch=0.001)
    start = REST + RAMP + (2 * RAMP + HOLD + PAUSE) * np.arange(count)
    time = np.arange(round((start[-1] + HOLD + RAMP + PAUSE) * PRESS_RATE)) / PRESS_RATE
    away = np.maximum(start - time[:, None], time[:, None] - start - HOLD) / RAMP
    share = np.where(away < 1e-6, 1.0, np.clip(1.0 - away, 0.0, 1.0))  # rounded times still have the full force
    wrenches = share @ whole
    held, which = np.nonzero(share == 1.0)
    truth = TaskTruth.of(held, points[which], whole[which, :3], _quiet(wrenches, NEAR * PRESS_RATE))
    return time, wrenches, truth


def _quiet(wrenches: np.ndarray, near: float) -> np.ndarray:
    """Return the samples that have no contact, and none within `near` samples."""
    touched = np.abs(wrenches).max(axis=1) > 0.0
    return np.flatnonzero(np.convolve(touched, np.ones(2 * round(near) + 1), mode="same") < 0.5)
