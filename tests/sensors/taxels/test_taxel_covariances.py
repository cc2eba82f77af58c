"""Covariances of taxels: a curve's forces, the fit of touches, its force, place and torque, each against dice.

The kernels run here as plain Python, one by one, on a skin whose axes lie at 45 degrees to everything.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.sensors.taxels import _kernels, _loads
from palpate.sensors.taxels._rest import FORCE, LIVE, LOAD, NUMBERS, ROUGH, SPREAD, WHOLE
from palpate.sensors.taxels.intensity import Curve
from palpate.sensors.taxels.response import TaxelResponse
from tests.support.dice import agree, mixed, rolled

PITCH = 5e-3
TILTED = Rotation.from_euler("zx", [45, 30], degrees=True).as_matrix()
KNOTS, JOINT = np.array([0.4, 2.0, 6.0]), 1.5
CURVES = {  # kind: its counts at a force, written out, and parameters
    "polynomial": (lambda p, f: p[0] * f + p[1] * f**2 + p[2] * f**3, [30.0, -1.0, 0.02]),
    "two_range": (lambda p, f: p[0] * min(f, JOINT) + p[1] * min(f, JOINT) ** 2 + p[2] * max(f - JOINT, 0.0),
                  [60.0, -5.0, 7.0]),
    "monotone": (lambda p, f: np.interp(f, [0.0, *KNOTS], [0.0, *p]), [20.0, 60.0, 110.0]),
    "resistive": (lambda p, f: 255.0 * 5.0 * f / (2.0 * p[0] + p[1] * f), [8.0, 3.0]),
}  # fmt: skip


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("force", [0.0, 0.3, 1.1, 5.0])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_force_by_a_curve_is_as_sure_as_curve_and_reading(kind: str, force: float, noise: float) -> None:
    """Of parameters that belong together: what moves the counts, over the slope there; at 0 N it is the reading."""
    counts, values = CURVES[kind]
    own = mixed(0.05 * np.abs(values), 1)
    curve = Curve(kind, values, own, 6.0, joint=JOINT, knots=KNOTS, reference=5.0, scale=255.0)
    above, below = counts(values, force + 1e-6), counts(values, max(force - 1e-6, 0.0))
    slope = (above - below) / (force + 1e-6 - max(force - 1e-6, 0.0))
    moved = rolled(lambda off: np.array([counts(values + off, force)]), own)[0, 0]
    stated = curve.deviation(np.array([force]), noise)[0]
    assert stated == pytest.approx(np.sqrt(moved + noise**2) / slope, rel=1e-4, abs=1e-12)


def response(count: int = 30, **more: object) -> TaxelResponse:
    """A response with every profile, a curve, and errors of its own."""
    guess = TaxelResponse.guessed(count, PITCH)
    shares = guess.shares + 0.2 * np.random.default_rng(1).normal(size=guess.shares.shape)
    return replace(guess, shares=shares, curve=np.array([1.1, 0.05, 0.02, 0.9, -0.03]), **more)


TOUCH = np.array([0.3, -0.2, 0.1, 0.8, -0.5, 2.0, 0.4])  # place [pitches], patch, force [N], torque [N pitches]
HERE = np.concatenate([[0.01, 0.02, 0.03], TILTED[2]])  # a place and its outward normal
ALONG = PITCH * TILTED[:2]  # what one step along either axis is there


@pytest.mark.parametrize("aside", [1.0, 0.0])
def test_a_force_in_space_is_as_sure_as_the_fit(aside: float) -> None:
    """Force, slip ratio and torque by small changes of what was fitted, all of which belong together."""
    model = response(widening=np.ones(3), inexact=np.zeros(3)).numbers()
    spread = mixed(np.array([0.05, 0.05, 0.02, 0.05, 0.08, 0.1, 0.03]), 2)
    touch = TOUCH * np.r_[np.ones(3), aside, aside, 1.0, 1.0]

    def written(off: np.ndarray) -> np.ndarray:
        out = np.zeros(40)
        _loads.write_force(touch + off, spread, model, HERE, ALONG, out, 22)
        return out

    out = written(np.zeros(7))
    force = out[6:9]
    agree(out[25:31][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]], rolled(lambda off: written(off)[6:9], spread), 1e-3)
    torque = rolled(lambda off: written(np.r_[np.zeros(6), off[6]])[9:10], spread)
    assert out[24] == pytest.approx(np.sqrt(torque[0, 0]), rel=1e-5)
    if aside:
        assert out[23] == pytest.approx(np.sqrt(rolled(lambda off: written(off)[22:23], spread)[0, 0]), rel=1e-3)
    known = {"patch": np.array([0.02, 0.01, 0.1]), "unusual": np.array([0.0, 0.4, 0.3])}
    more = response(widening=np.array([1.0, 1.5, 2.5]), inexact=np.array([0.0, 0.03, 0.05]), **known).numbers()
    wide, shape = np.zeros(40), touch[2] - 0.02 - 0.01 * touch[5] ** (2 / 3)
    _loads.write_force(touch, spread, more, HERE, ALONG, wide, 22)
    widths, local = np.array([2.5, 2.5, 1.5]), TILTED * [[1.0], [1.0], [-1.0]]
    was = local @ out[25:31][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]] @ local.T
    shares = np.array([0.05, 0.05, 0.03]) ** 2 + (np.array([0.3, 0.3, 0.4]) * shape) ** 2
    own = was * np.outer(widths, widths) + np.diag(shares) * (force @ force)
    assert wide[31] == pytest.approx(shape)
    agree(wide[25:31][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]], local.T @ own @ local)


def test_a_place_is_as_sure_along_both_axes_as_the_fit() -> None:
    more = {"inexact": np.array([0.1, 0.0, 0.0]), "unusual": np.array([3.0, 0.0, 0.0])}  # of a patch of 0.1
    model = response(widening=np.array([2.0, 1.0, 1.0]), **more).numbers()
    spread, fit, out = mixed(np.array([0.05, 0.03, 0.02, 0.05, 0.08, 0.1, 0.03]), 3), np.zeros(5), np.zeros(30)
    _loads._place(TOUCH, spread, model, 0.5 * PITCH, fit)
    _kernels._write(HERE, 0.5 * ALONG, np.array([0.3, 0.2, 0.1]), fit[2:], out, 22)
    own = 4.0 * spread[:2, :2] + (0.01 + 0.09) * np.eye(2)
    np.testing.assert_allclose(fit[:2], 2.0 * TOUCH[:2])
    agree(out[10:19].reshape(3, 3), ALONG.T @ own @ ALONG)


@pytest.mark.parametrize("count", [1, 2])
def test_what_a_fit_knows_is_the_covariance_of_what_moves_it(count: int) -> None:
    """Fisher: the information is the covariance of the slope of the log-likelihood, by noise of loads and by priors."""
    rng, model, size = np.random.default_rng(4), response().numbers(), _loads.UNKNOWN * count
    touches = np.stack([TOUCH, TOUCH * [-4.0, 3.0, 1.0, -0.5, 1.2, 0.7, -1.0]])[:count]
    places = rng.uniform(-3.0, 3.0, (2, 12))
    offsets = np.repeat(places[None], count, axis=0)
    weights = rng.uniform(5.0, 50.0, (3, 12))
    work = np.empty((6, 3)), np.empty(3), np.empty((3, size)), np.empty(3)

    def pulled(loads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normal, pull = np.empty((size, size)), np.empty(size)
        _loads._normal((offsets, loads, weights), touches, count, model, work, normal, pull)
        return np.tril(normal) + np.tril(normal, -1).T, pull

    shown, profiles, slopes = np.zeros((3, 12)), np.empty((6, 3)), np.empty((3, 7))
    for touch in touches:
        for k, place in enumerate(places.T):
            load = np.empty(3)
            _loads._load(*(place - touch[:2]), touch, model, profiles, load, slopes)
            shown[:, k] += load
    normal, prior = pulled(shown)
    found = rolled(lambda off: pulled(shown + off.reshape(3, 12))[1], np.diag(1.0 / weights.ravel()))
    known = np.zeros((size, size))
    for p, touch in enumerate(touches):
        usual = max(model[_loads.PATCH] + model[_loads.PATCH + 1] * touch[5] ** (2 / 3), _loads.LEAST_PATCH)
        mean, wide = np.array([0.0, 0.0, usual, 0.0]), [0.7, 0.7, model[_loads.LOOSE], 0.15 * touch[5]]
        at = 7 * p + np.array([0, 1, 2, 6])
        known[at, at] = np.array(wide) ** -2.0
        np.testing.assert_allclose(prior[at], (mean - touch[[0, 1, 2, 6]]) / np.square(wide), rtol=1e-9)
    agree(normal - known, found)
    spread = np.empty((count, 7, 7))
    _loads._covariances(normal, np.empty((size, size)), count, 1.7, spread)
    for p in range(count):
        agree(spread[p], 1.7 * np.linalg.inv(normal)[7 * p : 7 * p + 7, 7 * p : 7 * p + 7], 1e-6)


def test_sums_over_taxels_are_as_sure_as_loads_and_shares() -> None:
    """Each load is off by its noise, and each share by what another touch may have of it, along each axis."""
    rng, cells, model = np.random.default_rng(5), np.arange(6), response().numbers()
    numbers, whole = np.zeros((NUMBERS, 6)), np.ones((WHOLE, 6), dtype=np.int64)
    numbers[[LOAD, LOAD + 1, FORCE]] = rng.uniform(0.2, 1.0, (3, 6))
    numbers[[ROUGH, ROUGH + 1, SPREAD]] = rng.uniform(0.01, 0.05, (3, 6))
    whole[LIVE, 3] = 0
    offset, shares, spread = rng.uniform(-2.0, 2.0, (2, 6)), np.array([1.0, 0.9, 0.5, 1.0, 0.2, 1.0]), np.eye(7)
    loads = numbers[[LOAD, LOAD + 1, FORCE]].copy()

    def summed(off: np.ndarray) -> np.ndarray:
        """Place, force and torque about that place, of loads (3, 6), by their shares."""
        x, y, z = shares * (loads + off) * whole[LIVE]
        at, turn = offset @ z / z.sum(), offset[0] @ y - offset[1] @ x
        return np.array([*at, x.sum(), y.sum(), z.sum(), turn - at[0] * y.sum() + at[1] * x.sum()])

    touch = np.zeros(7)
    assert _loads._sum(cells, 6, offset, shares, numbers, whole, touch)
    np.testing.assert_allclose(touch[[0, 1, 3, 4, 5, 6]], summed(np.zeros((3, 6))))
    np.testing.assert_allclose(touch[2], np.linalg.norm(shares * loads * whole[LIVE]) / np.linalg.norm(touch[3:6]))
    _loads._sum_spread(cells, 6, offset, shares, 0.5, numbers, whole, model, touch, spread)
    own = numbers[[ROUGH, ROUGH + 1, SPREAD]] * [[0.5], [0.5], [1.0]]  # of the normal load it is scaled already
    own = np.sqrt(own**2 + ((1.0 - shares) * loads) ** 2)
    found = rolled(lambda off: summed(off.reshape(3, 6)), np.diag(own.ravel() ** 2))
    agree(spread[np.ix_([0, 1, 3, 4, 5, 6], [0, 1, 3, 4, 5, 6])], found)
    assert spread[2, 2] == 1.0


def test_a_centroid_is_as_sure_as_the_forces_of_its_cells() -> None:
    """But for what cells do not show of a touch that is smaller than they are, the same along either axis here."""
    rng, cells, at = np.random.default_rng(6), np.arange(8), np.zeros((2, 8))
    at[:], force, own = rng.uniform(-2.0, 2.0, (2, 8)), rng.uniform(0.5, 2.0, 8), rng.uniform(0.2, 1.0, 8)
    error, inside, out = rng.uniform(0.05, 0.3, 8), float(own @ force), np.zeros(3)
    middle, wide = at @ (own * force) / inside, np.array([4.0, 5.0, 1.5])  # so wide that cells show all of it
    _kernels._vary(cells, 8, own, error, inside, at, *middle, wide, out)
    least = 0.5 * (wide[0] + wide[1]) - np.hypot(0.5 * (wide[0] - wide[1]), wide[2])
    out[:2] -= [_kernels._narrow(wide[0], least), _kernels._narrow(wide[1], least)]
    found = rolled(lambda off: at @ (own * (force + off)) / (own @ (force + off)), np.diag(error**2))
    agree(out[[[0, 2], [2, 1]]], found)
