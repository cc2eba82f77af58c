"""Covariance: does the 95 % ellipse hold the truth 95 times in 100?

Each trial draws its own load and biases, its own free-motion log (24 poses, one noisy reading each, from which
`identify_payload` makes its own payload model), its own orientation and touch, and one noisy reading of it. The noise
is 0.02 N and 0.001 N m, the lever arm 50 mm. Compensation carries the payload's covariance. Nothing is filtered out: a
trial without an answer counts as one that missed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.bodies import BODIES, CONVEX, R, mesh_of, touched
from claims.row import Row
from palpate_lab.simulation import Body

NOISE = np.array([0.02] * 3 + [0.001] * 3)  # N, N m: one reading
POSES = 24
LEVER = 0.05  # m from the sensor's origin to the middle of the body
CHI2_95 = 5.991464547107979


@dataclass(frozen=True)
class Trials:
    """Of each trial the rotation (sensor in base), the payload's true reading there, and the payload identified."""

    rotations: np.ndarray
    loads: np.ndarray
    payloads: list[palpate.Payload]


def rows(small: bool) -> Iterator[Row]:
    """Smooth convex bodies from 2 N, then lighter touches, then facets."""
    count = 150 if small else 10_000
    slack = 5.0 if small else 1.0  # 150 trials scatter by 1.8 % and by 0.16: three deviations
    cases = [
        (name, smooth, force) for force in ((2.0, 10.0), (0.5, 2.0)) for smooth in (True, False) for name in CONVEX
    ]
    cases = sorted(cases, key=lambda case: (not case[1], -case[2][0]))
    for name, smooth, force in cases[: len(CONVEX) + 1] if small else cases:
        judged = smooth and force[0] >= 2
        yield _coverage(name, BODIES[name], smooth, force, count, slack if judged else None)


@cache
def _trials(count: int) -> Trials:
    rng = np.random.default_rng(23)
    rotations, loads, payloads = [], [], []
    for _ in range(count):
        weight = np.array([0.0, 0.0, -rng.uniform(2.0, 10.0)])
        centre = np.array([0.0, 0.0, 0.04]) + rng.normal(0.0, 0.005, 3)
        bias = np.concatenate([rng.normal(0.0, 4.0, 3), rng.normal(0.0, 0.1, 3)])
        turns = Rotation.random(POSES + 1, random_state=int(rng.integers(2**31))).as_matrix()
        hung = np.einsum("nji,j->ni", turns, weight)
        read = np.concatenate([hung, np.cross(centre, hung)], axis=1) + bias
        log = read[1:] + rng.standard_normal((POSES, 6)) * NOISE
        payloads.append(palpate.identify_payload(log, turns[1:], noise=NOISE))
        rotations.append(turns[0])
        loads.append(read[0])
    return Trials(np.array(rotations), np.array(loads), payloads)


def _coverage(name: str, body: Body, smooth: bool, force: tuple[float, float], count: int, slack: float | None) -> Row:
    trials = _trials(count)
    rng = np.random.default_rng(29)
    points, touches = touched(body, count, rng, force=force, pitch=0.2 * R)
    mount = palpate.Pose(np.eye(3), [0.0, 0.0, LEVER])  # T_sensor_surface
    sensed = touches @ mount.wrench_matrix().T + trials.loads + rng.standard_normal((count, 6)) * NOISE
    located, covariances = np.empty((count, 6)), np.empty((count, 6, 6))
    back = mount.inverse().wrench_matrix()
    for i, payload in enumerate(trials.payloads):
        wrench, added = payload.compensate(sensed[i : i + 1], trials.rotations[i : i + 1])
        located[i], covariances[i] = back @ wrench[0], back @ (added[0] + np.diag(NOISE**2)) @ back.T
    locator = palpate.Locator(mesh_of(body, 20_000, smooth), noise=NOISE, on=0.0, off=0.0)
    found = locator.run(located, covariances, sequential=False)
    share, mean = coverage(found, points)
    spread = np.sqrt(np.einsum("nii->n", found.covariance[found.answered]))
    met = None
    if slack is not None:
        met = abs(share - 0.95) <= 0.02 * slack and abs(mean - 2) <= 0.1 * slack
    kind = "smooth" if smooth else "faceted"
    got = f"{share:.2%}, {mean:.3f}; median of the stated rms {1e3 * np.median(spread):.2f} mm"
    lost = int(np.count_nonzero(~found.answered))
    got += f"; {count:,} trials, {lost} not answered"
    if lost:
        got += f" (of the answered {coverage(found[found.answered], points[found.answered])[0]:.2%})"
    what = (
        f"{name}, R = 10 mm, {kind}, {force[0]:g} to {force[1]:g} N: truth in the 95 % ellipse, mean squared distance"
    )
    return Row(what, "93 to 97 %, 2 +- 0.1" if force[0] >= 2 and smooth else "", got, met)


def coverage(found: palpate.ContactEstimate, points: np.ndarray) -> tuple[float, float]:
    """How often the 95 % ellipse holds the truth, and the mean squared distance where there is an answer."""
    square = squared_distance(found, points)
    return float(np.mean(square <= CHI2_95)), float(np.mean(square[found.answered]))


def squared_distance(found: palpate.ContactEstimate, points: np.ndarray) -> np.ndarray:
    """Of the truth in the tangent plane at the answer, two degrees of freedom; inf without an answer."""
    square, answered = np.full(len(points), np.inf), found.answered
    values, vectors = np.linalg.eigh(found.covariance[answered])  # the least belongs to the normal: the rank is 2
    off = np.einsum("nij,ni->nj", vectors, points[answered] - found.point[answered])
    square[answered] = np.sum(off[:, 1:] ** 2 / values[:, 1:], axis=1)
    return square
