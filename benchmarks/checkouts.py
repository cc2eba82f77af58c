"""Compare one `locate`, one live sample and a batch with another checkout, in turns: PALPATE_BESIDE=DIR."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from evidence.row import Row

__all__ = ["rows"]

COMMAND = "PALPATE_BESIDE=DIR python -m benchmarks --only checkouts"
NAME = "checkouts"
ROOT = Path(__file__).parents[1]
ROUNDS = 41
CALLS = {
    "one `palpate.locate`": "palpate.locate(wrench, mesh)",
    "one live sample, six-axis (`update_into`)": "estimator.update_into(0.0, wrench, row)",
    "10,000 wrenches by `Locator.run`": "locator.run(many, sequential=False)",
}
SIDE = """
import sys, time
import numpy as np, palpate
from palpate.simulation.shapes import Ellipsoid
mesh = palpate.Mesh.from_arrays(*Ellipsoid((0.010, 0.007, 0.005)).mesh(20_000))
locator = palpate.Locator(mesh, noise=[0.02] * 3 + [0.001] * 3)
estimator = palpate.WrenchEstimator(locator, palpate.ForceTorque([0.02] * 3 + [0.001] * 3))
wrench, row = np.array([0.5, 0.0, -5.0, 0.0, 0.001, 0.001]), estimator.empty()
many = np.random.default_rng(0).normal(size=(10_000, 6)) * [5, 5, 5, 0.02, 0.02, 0.02]
for line in sys.stdin:
    count, call = line.rstrip().split(" ", 1)
    run = eval("lambda: " + call)
    run()
    begin = time.process_time()
    for _ in range(int(count)):
        run()
    print(time.process_time() - begin, flush=True)
"""


def rows(small: bool) -> Iterator[Row]:
    """Measure the median ratio of rounds; small, or without another checkout, this one against itself."""
    there = Path(os.environ.get("PALPATE_BESIDE", ROOT)).resolve()
    sides = [_started(ROOT), _started(there)]
    try:
        for what, call in CALLS.items():
            count = 3 if "many" in call else 300 if small else 5000
            times = [[_round(side, count, call) for side in sides] for _ in range(3 if small else ROUNDS)]
            ratio = median(here / other for here, other in times)
            here, other = (1e6 * median(each) / count for each in zip(*times, strict=True))
            judged = None if small or there == ROOT else ratio <= 1.05
            got = f"{ratio:.3f} times ({here:.1f} us, {other:.1f} there; {len(times)} rounds in turns, CPU)"
            yield Row(NAME, what, "<= 1.05 times the other checkout's", got, judged, COMMAND)
    finally:
        for side in sides:
            side.kill()
            side.communicate()


def _started(tree: Path) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    surroundings = {**os.environ, "PYTHONPATH": str(tree / "src")}
    return subprocess.Popen([sys.executable, "-c", SIDE], stdin=pipe, stdout=pipe, env=surroundings, text=True)


def _round(side: subprocess.Popen[str], count: int, call: str) -> float:
    if side.stdin is None or side.stdout is None:
        raise RuntimeError("no pipes")
    side.stdin.write(f"{count} {call}\n")
    side.stdin.flush()
    return float(side.stdout.readline())
