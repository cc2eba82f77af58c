"""Times of one contact on a surface with an equation, beside the older methods."""

import time
from collections.abc import Callable, Iterator

import numpy as np

import palpate
from claims.evidence.bodies import R
from claims.row import Row
from palpate.surfaces import Ellipsoid, _bvh, _equation
from palpate_lab.papers.iterative import locate_iteratively
from palpate_lab.simulation import touch_wrenches
from palpate_lab.simulation.shapes import EllipsoidBody as Truth

BLOCK = 50
AXES = (R, 0.7 * R, 0.5 * R)


def rows(small: bool) -> Iterator[Row]:
    """Blocks of queries in turns, so that all of them meet the same machine, and none the other's cold caches."""
    count = 100 if small else 2_000
    rng = np.random.default_rng(5)
    truth, surface = Truth(AXES), Ellipsoid(AXES)
    points = truth.sample(count, rng)
    wrenches = touch_wrenches(points, truth.normals(points), rng, pitch=0.3 * R)
    locator, prepared = palpate.Locator(surface, torsion=np.inf), surface.prepared()
    unit, row, found = wrenches.copy(), locator.empty(), np.zeros((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
    unit[:, 3:] /= prepared.scale  # its centre is the origin

    def analytic(i: int) -> None:
        locate_iteratively(wrenches[i], surface, jacobian="analytic")

    def numeric(i: int) -> None:
        locate_iteratively(wrenches[i], surface, jacobian="numeric")

    variants: dict[str, Callable[[int], object]] = {
        "soft_finger into `out`": lambda i: _equation.contacts(unit[i], 1.0, np.inf, *prepared.arguments, found),
        "full answer, with status, into a row": lambda i: locator(wrenches[i], row),
        "iterative, analytic Jacobian": analytic,
        "iterative, numeric Jacobian": numeric,
    }
    taken = {name: np.empty(count) for name in variants}
    for start in range(0, count, BLOCK):
        for name, call in variants.items():
            for i in range(start, start + BLOCK):
                begin = time.perf_counter()
                call(i)
                taken[name][i] = time.perf_counter() - begin
    ours = float(np.median(taken["soft_finger into `out`"]))
    for name, seconds in taken.items():
        middle = float(np.median(seconds))
        said = f"{1e6 * middle:.2f} us (99 %: {1e6 * np.percentile(seconds, 99):.1f}), {middle / ours:.0f} x"
        target, passed = "", None
        if name.startswith("soft_finger"):
            target, passed, said = "<= 2 us", middle <= 2e-6, said.rsplit(",", 1)[0]
        elif "analytic" in name:
            target, passed = ">= 100 x soft_finger", middle >= 100 * ours
        yield Row(f"ellipsoid, {name}: one query from Python, median", target, said, None if small else passed)
