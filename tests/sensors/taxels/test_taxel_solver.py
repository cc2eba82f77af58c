"""What makes poked taxels quick, against the plain way: the place of a poke, the elimination of units, spreads."""

import numpy as np
from scipy.special import log_ndtr

from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.poking.calibrate import size_deviation, spreads
from palpate.sensors.taxels.poking.response import GRID, LEFT, ROUGH, UNEVEN, WIDE, LocalTaxels, Response, seen_among
from palpate.sensors.taxels.poking.rigid_groups import Units
from palpate.sensors.taxels.poking.solve import eliminated

RNG = np.random.default_rng
MODEL = Response(2.0, 1.5e-3, 2.5, 0.2)
SPACING = 6e-3


def _chart(pokes: int, rng: np.random.Generator) -> LocalTaxels:
    """Taxels about pokes, some of which answer, and a last poke to which none does."""
    width = 9
    taxels = np.where(rng.random((pokes, width)) < 0.8, rng.integers(0, 50, (pokes, width)), -1)
    taxels[:, 0] = 7
    flat = rng.uniform(-2 * SPACING, 2 * SPACING, (pokes, width, 2))
    flat[:, 0] = 0.0
    quiet = rng.normal(-0.5, 0.3, pokes)
    log = MODEL.log((flat**2).sum(axis=2)) + 0.3 * rng.standard_normal((pokes, width))
    log = np.where((taxels >= 0) & (log > quiet[:, None]), log, np.nan)
    log[-1] = np.nan
    return LocalTaxels(
        taxels, flat, taxels[:, 0], log, quiet, np.asarray(np.isfinite(log).any(axis=1), dtype=bool), SPACING
    )


def _likelihood(chart: LocalTaxels, grid: np.ndarray) -> np.ndarray:
    """Of the answers at points of a grid (n, g, 2), by NumPy."""
    log = MODEL.log(((chart.flat[:, None] - grid[:, :, None]) ** 2).sum(axis=3))
    answered = np.isfinite(chart.log)[:, None]
    share = np.where(answered, 1.0 / chart.variance(MODEL)[:, None], 0.0)
    gap = np.where(answered, chart.log[:, None] - log, 0.0)
    total = (share * gap).sum(axis=2)
    shift = total / (share.sum(axis=2) + 1.0 / UNEVEN**2)
    fit = -0.5 * ((share * gap**2).sum(axis=2) - total * shift)
    under = (chart.quiet[:, None, None] - log - shift[..., None]) / np.hypot(MODEL.scatter, ROUGH)
    silent = (chart.taxels >= 0)[:, None] & ~answered
    missed = np.asarray(log_ndtr(np.clip(under, -30.0, 30.0)), dtype=np.float64)
    fit = fit + np.where(silent, missed, 0.0).sum(axis=2)
    weight = np.exp(fit - fit.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)


def _square(points: int) -> np.ndarray:
    """(points^2, 2) of a grid from -1 to 1."""
    side = np.linspace(-1.0, 1.0, points)
    return np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)


def test_the_kernel_finds_pokes_where_numpy_does() -> None:
    chart = _chart(200, RNG(1))
    mean, half = np.zeros((200, 2)), np.full((200, 2), WIDE * SPACING)
    covariance = np.zeros((200, 2, 2))
    for _ in range(2):
        grid = mean[:, None] + half[:, None] * _square(GRID)
        weight = _likelihood(chart, grid)
        mean = np.einsum("ng,nga->na", weight, grid)
        away, cell = grid - mean[:, None], 2.0 * half / (GRID - 1)
        spread = np.einsum("ng,nga,ngb->nab", weight, away, away)
        covariance = spread + np.eye(2) * (cell**2 / 12.0)[:, None]
        half = np.minimum(half, LEFT * np.sqrt(np.einsum("naa->na", spread)) + 0.5 * cell)
    seen = seen_among(chart, MODEL)
    np.testing.assert_allclose(seen.covariance, covariance, rtol=1e-9, atol=1e-18)
    points = np.einsum("nw,nwa->na", seen.shares, chart.flat) + seen.second
    np.testing.assert_allclose(points[chart.found], mean[chart.found], atol=1e-12)


def test_a_poke_beside_two_taxels_may_be_on_either_side_of_them() -> None:
    """Both peaks, each narrow, are in mean and covariance, wherever they lie between points of a grid."""
    count, rng = 40, RNG(2)
    flat = np.zeros((count, 3, 2))
    flat[:, 1, 0], flat[:, 2, 1] = SPACING, -1.6 * SPACING
    beside = np.stack([rng.uniform(0.3, 0.5, count), rng.uniform(0.5, 0.75, count)], axis=1) * SPACING
    log = MODEL.log(((flat - beside[:, None]) ** 2).sum(axis=2))
    log[:, 2] = np.nan
    taxels = np.tile([7, 8, 9], (count, 1))
    quiet = MODEL.log(np.full(count, SPACING**2)) - 0.5
    chart = LocalTaxels(taxels, flat, taxels[:, 0], log, quiet, np.ones(count, dtype=bool), SPACING)
    grid = WIDE * SPACING * np.tile(_square(161), (count, 1, 1))
    weight = _likelihood(chart, grid)
    mean = np.einsum("ng,nga->na", weight, grid)
    away = grid - mean[:, None]
    deviation = np.sqrt(np.einsum("ng,nga,nga->na", weight, away, away))
    seen = seen_among(chart, MODEL)
    found = np.einsum("nw,nwa->na", seen.shares, chart.flat) + seen.second
    assert deviation[:, 1].min() > 2e-3
    np.testing.assert_allclose(found, mean, atol=0.3e-3)
    np.testing.assert_allclose(np.sqrt(np.einsum("naa->na", seen.covariance))[:, 1], deviation[:, 1], rtol=0.1)


def test_units_are_eliminated_one_by_one() -> None:
    rng, units, size, common = RNG(2), 5, 3, 4
    count = units * size + common
    root = rng.standard_normal((count, count))
    for unit in range(units):  # lines that touch one unit and what all have in common
        rows = slice(unit * size, (unit + 1) * size)
        keep = np.zeros(count, dtype=bool)
        keep[rows] = keep[units * size :] = True
        root[rows] *= keep
    root[units * size :, : units * size] = 0.0
    matrix, right = root.T @ root, rng.standard_normal(count)
    np.testing.assert_allclose(eliminated(matrix, right, units, size), np.linalg.solve(matrix, right), rtol=1e-8)


def test_spreads_are_those_of_all_places_at_once() -> None:
    """F K F' of derivatives and covariance, whole, and once the rigid motions of all places are taken off."""
    rng, units, taxels = RNG(3), 4, 6
    layout = ModuleLayout.repeated(5e-3 * rng.standard_normal((taxels, 2)), units)
    frame = np.linalg.qr(rng.standard_normal((units, 3, 3)))[0]
    frame[:, :, 2] *= np.linalg.det(frame)[:, None]
    made = Units(layout, 0.05 * rng.standard_normal((units, 3)), frame)
    root = rng.standard_normal((6 * units, 6 * units)) * np.tile([1e-3] * 3 + [5e-2] * 3, units)
    covariance = root.T @ root
    full = np.zeros((3 * units * taxels, 6 * units))
    for k, by in enumerate(made.jacobian):
        unit = layout.module[k]
        full[3 * k : 3 * k + 3, 6 * unit : 6 * unit + 6] = by
    points = made.places[0]
    turns = np.stack([np.cross(axis, points).ravel() for axis in np.eye(3)], axis=1)
    rigid = np.linalg.qr(np.column_stack([np.tile(np.eye(3), (len(points), 1)), turns]))[0]
    left = full - rigid @ (rigid.T @ full)
    absolute, relative = spreads(made, covariance)
    square = (full @ covariance @ full.T).reshape(len(points), 3, len(points), 3)
    each = np.arange(len(points))
    np.testing.assert_allclose(absolute, square[each, :, each], rtol=1e-9, atol=1e-18)
    trace = np.diag(left @ covariance @ left.T).reshape(-1, 3).sum(axis=1)
    np.testing.assert_allclose(relative, np.sqrt(trace), rtol=1e-6)
    away = (points - points.mean(axis=0)).ravel()
    growth = full.T @ away / (away @ away)
    np.testing.assert_allclose(size_deviation(made, covariance), np.sqrt(growth @ covariance @ growth), rtol=1e-9)


def test_a_poke_beyond_what_is_searched_is_not_used() -> None:
    """It would appear at the edge of the search, too near to its module."""
    flat = np.zeros((4, 3, 2))
    flat[:, 1, 0], flat[:, 2, 1] = SPACING, SPACING
    away = -np.array([0.3, 0.8, 1.9, 2.5]) * SPACING
    places = np.stack([away, np.full(4, 0.5 * SPACING)], axis=1)
    log = MODEL.log(((flat - places[:, None]) ** 2).sum(axis=2))
    taxels, found = np.tile([7, 8, 9], (4, 1)), np.ones(4, dtype=bool)
    chart = LocalTaxels(taxels, flat, taxels[:, 0], log, np.full(4, -9.0), found, SPACING)
    np.testing.assert_array_equal(seen_among(chart, MODEL).found, [True, True, False, False])
