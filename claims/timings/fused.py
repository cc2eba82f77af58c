"""Forces of three contacts from a skin and one wrench: the closed form into arrays, and with cones that bind."""

from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np

from claims.clock import timed
from claims.papers.fused_contacts.bench import Conditions, forearm, touch
from claims.row import Row
from palpate.sensors.fused import _kernels as _fused
from palpate.sensors.fused.locator import FusedLocator, FusionSettings

CLOSED, CONES = 10.0, 500.0  # us


def rows(small: bool) -> Iterator[Row]:
    calls, rng = (50 if small else 20_000), np.random.default_rng(0)
    prior = FusionSettings()
    body = forearm(rng)
    *skin, wrenches, covariances = touch(body, 3, rng, Conditions(friction=0.3)).seen(3)
    known = np.array([prior.tangential, prior.gain, prior.floor, prior.friction, prior.turns])
    given = (FusedLocator.rows(*skin), wrenches[0].copy(), covariances[0].copy(), known)
    into = (np.empty(36 + _fused.room(3, 1)), np.empty((3, 5)), np.empty((9, 9)), np.empty(16))
    took = timed(lambda _: _fused.fuse_one(*given, *into), calls)
    what = "forces of 3 contacts and one wrench, closed form with covariance, into arrays"
    yield Row(what, f"<= {CLOSED:g} us p50", _said(took), None if small else np.median(took) <= CLOSED)
    tight = FusedLocator(body.mesh(), FusionSettings(friction=0.3))
    touches = [touch(body, 3, rng, Conditions(friction=0.45)).seen(3) for _ in range(50)]
    bound = [each for each in touches if tight.fuse(*each).bound.any()]
    what = "the same as values, where a cone binds (clarabel)"
    if find_spec("clarabel") is None or not bound:
        yield Row(what, f"<= {CONES:g} us p50", "skipped: no clarabel")
        return
    took = timed(lambda k: tight.fuse(*bound[k % len(bound)]), min(calls, 1_000))
    yield Row(what, f"<= {CONES:g} us p50", _said(took), None if small else np.median(took) <= CONES)


def _said(took: np.ndarray) -> str:
    return f"p50 {np.median(took):.1f} us, p99 {np.percentile(took, 99):.1f} us"
