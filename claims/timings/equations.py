"""Times of one contact on a surface with an equation, beside the older methods."""

from collections.abc import Callable, Iterator

import numpy as np

import palpate
from claims.clock import by_blocks
from claims.evidence.bodies import R, touched
from claims.row import Row
from palpate.surfaces import Ellipsoid, _bvh, _equation
from palpate_lab.papers.iterative import locate_iteratively
from palpate_lab.simulation.shapes import EllipsoidBody as Truth

BLOCK = 50
AXES = (R, 0.7 * R, 0.5 * R)


def rows(small: bool) -> Iterator[Row]:
    """Blocks of queries in turns, so that all of them meet the same machine, and none the other's cold caches."""
    count = 100 if small else 2_000
    rng = np.random.default_rng(5)
    truth, surface = Truth(AXES), Ellipsoid(AXES)
    wrenches = touched(truth, count, rng, pitch=0.3 * R)[1]
    locator, prepared = palpate.Locator(surface, torsion=np.inf), surface.prepared()
    unit, row, found = wrenches.copy(), locator.empty(), np.zeros((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
    unit[:, 3:] /= prepared.scale  # its centre is the origin
    variants: dict[str, Callable[[int], object]] = {
        "soft_finger into `out`": lambda i: _equation.contacts(unit[i], 1.0, np.inf, *prepared.arguments, found),
        "full answer, with status, into a row": lambda i: locator(wrenches[i], row),
        "iterative, analytic Jacobian": lambda i: locate_iteratively(wrenches[i], surface, jacobian="analytic"),
        "iterative, numeric Jacobian": lambda i: locate_iteratively(wrenches[i], surface, jacobian="numeric"),
    }
    taken = by_blocks(variants, count, BLOCK)
    ours = float(np.median(taken["soft_finger into `out`"]))
    for name, times in taken.items():
        middle = float(np.median(times))
        said = f"{middle:.2f} us (99 %: {np.percentile(times, 99):.1f}), {middle / ours:.0f} x"
        target, passed = "", None
        if name.startswith("soft_finger"):
            target, passed, said = "<= 2 us", middle <= 2, said.rsplit(",", 1)[0]
        elif "analytic" in name:
            target, passed = ">= 100 x soft_finger", middle >= 100 * ours
        yield Row(f"ellipsoid, {name}: one query from Python, median", target, said, None if small else passed)
