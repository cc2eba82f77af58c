"""Compare `locate`, and each sensor in loops and batches, with numba or with another checkout: PALPATE_BESIDE=DIR.

Both sides run in turns, a process each, started anew a few times. The marker ring is left out: there is no small film
of it in the project.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import cycle, islice
from math import ceil
from pathlib import Path
from statistics import median

from claims.row import Row

ROOT = Path(__file__).parents[2]
STARTS, ROUNDS = 5, 9  # the same two sides had a ratio of 0.91 in one start, and of 1.04 in another
MOST = 1.05  # times
SKIN = "skin of 132 cells, 8 touches in 2,000 frames by `run`"
FRAMES = 0.97  # as many frames a second
SENSORS = ("six-axis", "load_cells", "skin", "skin_and_wrench")
WAYS = ("at rest", "that moves")
LASTS = 0.1  # s of CPU that a round takes at least: of rounds of 5 ms, two equal sides differed by 36 %
CALLS = {
    "one `palpate.locate`": "palpate.locate(wrench, mesh)",
    "one live sample, six-axis (`update_into`)": "estimator.update_into(0.0, wrench, row)",
    "one untouched live sample of a stream, six-axis with payload and poses (`Live`)": "live.pass_on(0.0)",
    "10,000 wrenches by `Locator.run`": "locator.run(many, sequential=False)",
    SKIN: "(skin.reset(), skin.run(touched))",
    **{f"{name}: 100 samples by `update_into`": f"loop({name!r})" for name in SENSORS},
    **{f"{name}: 100 samples by `run`": f"sides[{name!r}][0].run(sides[{name!r}][1])" for name in SENSORS},
    **{f"an arm {way}: 20,000 samples by `stream`": f"list(arms[{way!r}].stream(logs[{way!r}]))" for way in WAYS},
}
SIDE = """
import sys, time
import numpy as np, palpate
from palpate.live.live import Live
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.taxels.health import examine
from palpate.signals.motion import Motion
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.shapes import EllipsoidBody
from palpate_lab.simulation.skin_bench import Rolled
from tests.same.play import samples

def made(name):
    rig = palpate.load_rig(f"tests/v03/{name}/rig.toml")
    with palpate.open_log(f"tests/v03/{name}/log.csv", rig) as log:
        block = next(iter(log))
    estimator = rig.estimator(rate=100.0)
    estimator.tare(block.picked(slice(20)))
    recording = block.picked(slice(100))
    return estimator, recording, list(samples(estimator.channels, recording)), estimator.empty()

def arm(swing):
    time, noise = np.arange(20_000) / 500.0, np.repeat([0.02, 0.001], 3)
    angle = swing * np.sin(2.0 * time)[:, None]
    turns = np.concatenate([np.sin(angle / 2) * [0.6, 0.0, 0.8], np.cos(angle / 2)], axis=1)
    payload = palpate.Payload([0.0, 0.0, -4.0], [0.0] * 3, [0.0, 0.0, 0.04], [0.0] * 3, np.eye(12) * 1e-8)
    free = -payload.compensate(np.zeros((20_000, 6)), rotation_from_quaternion(turns))[0]
    read = free + np.random.default_rng(0).normal(size=(20_000, 6)) * noise
    channels = {"force": read[:, :3], "torque": read[:, 3:], "orientation": turns, "position": angle * [0.1, 0.2, 0.0]}
    log, motion = palpate.Recording(time, channels), Motion("none", lever=payload.center_of_mass)
    sensor = Compensation(palpate.ForceTorque(noise), payload, motion)
    blocks = [log.picked(slice(start, start + 2000)) for start in range(0, 20_000, 2000)]
    return palpate.WrenchEstimator(mesh, sensor, live=False), blocks

def loop(name):
    estimator, _, given, out = sides[name]
    estimator.reset()
    for time, reading, *more in given:
        estimator.update_into(time, reading, out, *more)

class Stream:
    shape, dtype, poses, stamp = (6,), np.float64, True, 0
    events = list

    def __init__(self, log):
        self.wrenches, self.turns = log.wrenches()[:20], log.channels["orientation"][:20]  # untouched

    def receive(self, batch, timeout):
        self.stamp, row = self.stamp + 1_000_000, self.stamp // 1_000_000 % 20
        batch.stamp[0], batch.values[0] = self.stamp, self.wrenches[row]
        batch.orientation[0], batch.position[0] = self.turns[row], 0.0
        return 1

def pressed():
    sheet, rng, time = Rolled(6, 22, 0.005, np.inf).layout(), np.random.default_rng(3), np.arange(2000) / 100.0
    row, column = (each.ravel() for each in np.mgrid[:6, :22])
    cells = 300.0 + rng.normal(0.0, 1.5, (2000, 132))
    for begun in 3.0 + 2.0 * np.arange(8):
        peak = 200.0 * np.exp(-((row - rng.uniform(1, 4)) ** 2 + (column - rng.uniform(1, 20)) ** 2) / 2.5)
        cells += np.clip(np.minimum(time - begun, begun + 0.8 - time) / 0.08, 0.0, 1.0)[:, None] * peak
    log, body = palpate.Recording(time, {"cells": np.rint(cells)}), palpate.TaxelBody.sheet(sheet)
    return palpate.TaxelEstimator(body, health=examine(log, body, seconds=2.5)), log

skin, touched = pressed()
sides = {name: made(name) for name in SENSORS}
mesh = palpate.Mesh.from_arrays(*EllipsoidBody((0.010, 0.007, 0.005)).mesh(20_000))
arms, logs = (dict(zip(WAYS, each)) for each in zip(arm(0.0), arm(0.5), strict=True))
locator = palpate.Locator(mesh, noise=[0.02] * 3 + [0.001] * 3)
estimator = palpate.WrenchEstimator(locator, palpate.ForceTorque([0.02] * 3 + [0.001] * 3))
wrench, row = np.array([0.5, 0.0, -5.0, 0.0, 0.001, 0.001]), estimator.empty()
live = Live(palpate.load_rig("tests/v03/six-axis/rig.toml"), source=Stream(sides["six-axis"][1]))
many = np.random.default_rng(0).normal(size=(10_000, 6)) * [5, 5, 5, 0.02, 0.02, 0.02]
for line in sys.stdin:
    count, call = line.rstrip().split(" ", 1)
    run = eval("lambda: " + call)
    run()
    begin = time.process_time()
    for _ in range(int(count)):
        run()
    print(time.process_time() - begin, flush=True)
""".replace("SENSORS", str(SENSORS)).replace("WAYS", str(WAYS))


def rows(small: bool) -> Iterator[Row]:
    there = os.environ.get("PALPATE_BESIDE")
    what = "the other checkout's" if there else "numba's"
    starts = [_once(there, 3 if small else ROUNDS) for _ in range(1 if small else STARTS)]
    for name in CALLS:
        ratios = [median(here / other for here, other in start[name]) for start in starts]
        here, other = (median(each) for each in zip(*(pair for start in starts for pair in start[name]), strict=True))
        got = f"{median(ratios):.3f} times ({here:.1f} us, {other:.1f} there; {min(ratios):.3f} to {max(ratios):.3f} "
        got += f"in {len(starts)} starts of both, {len(starts[0][name])} rounds each in turns, CPU)"
        most = 1.0 / FRAMES if there and name == SKIN else MOST
        yield Row(name, f"<= {most:.3g} times {what}", got, None if small else median(ratios) <= most)


def _once(there: str | None, rounds: int) -> dict[str, list[tuple[float, float]]]:
    """Return the CPU time [us] of each call, of this side and of the other, in each round of two new processes."""
    sides = [_started(ROOT, "1"), _started(Path(there or ROOT).resolve(), "1" if there else "0")]
    try:
        return {name: list(_turns(sides, call, rounds)) for name, call in CALLS.items()}
    finally:
        for side in sides:
            side.kill()
            side.communicate()


def _turns(sides: list[subprocess.Popen[str]], call: str, rounds: int) -> Iterator[tuple[float, float]]:
    count = ceil(LASTS / min(_round(side, 3, call) / 3 for side in sides))
    for turn in islice(cycle((1, -1)), rounds):  # each side is first in every other round
        here, other = [1e6 * _round(side, count, call) / count for side in sides[::turn]][::turn]
        yield here, other


def _started(tree: Path, native: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    surroundings = {**os.environ, "PYTHONPATH": f"{tree / 'src'}{os.pathsep}{ROOT}", "PALPATE_NATIVE": native}
    return subprocess.Popen(
        [sys.executable, "-c", SIDE], stdin=pipe, stdout=pipe, env=surroundings, text=True, cwd=ROOT
    )


def _round(side: subprocess.Popen[str], count: int, call: str) -> float:
    if side.stdin is None or side.stdout is None:
        raise RuntimeError("no pipes")
    side.stdin.write(f"{count} {call}\n")
    side.stdin.flush()
    return float(side.stdout.readline())
