"""What cells can resolve: the slopes by differences, the errors by dice, the scaling by thought."""

import numpy as np
import pytest

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import nominal_cells, position_slope, resolution
from palpate_lab.simulation.ball_on_ellipse import Ellipse
from palpate_lab.simulation.cell_array import LAYOUTS, in_line, random_cells
from palpate_lab.simulation.contacts import directed_forces

TIP = Ellipse()
NOISE, GAIN = 1e-4, 10.0  # V, N/V


def _places(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    return TIP.foot(rng.uniform(-11e-3, 11e-3, count), rng.uniform(-15e-3, 15e-3, count))


def _forces(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    count = len(normals)
    return directed_forces(normals, rng.uniform(0.5, 3, count), rng.uniform(0, 0.6, count), rng.uniform(0, 6.3, count))


def _axis_on_ellipse(wrench: np.ndarray) -> np.ndarray:
    """Where the line of action enters the ellipse (`load_cells` (14), (15)): of two meetings the one that presses."""
    force, torque = wrench[..., :3], wrench[..., 3:]
    start = np.cross(force, torque) / np.sum(force**2, axis=-1, keepdims=True)
    inverse = np.array([TIP.a**-2, 0.0, TIP.b**-2])
    square, cross, level = (
        np.sum(u * v * inverse, axis=-1) for u, v in ((force, force), (start, force), (start, start))
    )
    way = (-cross - np.sqrt(np.maximum(cross**2 - square * (level - 1), 0.0))) / square
    return start + way[..., None] * force


def _without_torsion(wrench: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """The nearest wrenches without moment along the force, after two steps towards them."""
    for _ in range(2):
        torsion = np.concatenate([wrench[..., 3:], wrench[..., :3]], axis=-1)
        along = torsion @ spread
        short = np.sum(wrench[..., :3] * wrench[..., 3:], axis=-1) / np.sum(torsion * along, axis=-1)
        wrench = wrench - short[..., None] * along
    return wrench


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_wrench_needs_three_cells(count: int) -> None:
    with pytest.raises(InputError, match="at least three cells"):
        nominal_cells(np.eye(3)[:count], GAIN, NOISE)


def test_slopes_are_those_of_the_line_of_action_where_no_torque_arises() -> None:
    """Changes of a wrench that keep F . M = 0 move the contact along with the line of action."""
    rng = np.random.default_rng(0)
    point, normal = _places(rng, 40)
    force = _forces(normal, rng)
    wrench = np.concatenate([force, np.cross(point, force)], axis=1)
    torsion = np.concatenate([wrench[:, 3:], wrench[:, :3]], axis=1)
    slope = position_slope(point, normal, force)
    for step in rng.normal(size=(10, 40, 6)) * [1e-6, 1e-6, 1e-6, 1e-8, 1e-8, 1e-8]:
        change = step - torsion * (np.sum(step * torsion, axis=1) / np.sum(torsion**2, axis=1))[:, None]
        measured = (_axis_on_ellipse(wrench + change) - _axis_on_ellipse(wrench - change)) / 2
        predicted = np.einsum("nij,nj->ni", slope, change)
        np.testing.assert_allclose(predicted[:, :3], measured, atol=1e-13)  # m, of 1e-8
        assert np.abs(predicted[:, 3]).max() < 1e-18


def test_slopes_with_torque_rebuild_the_wrench() -> None:
    """A moved point with a new torque makes the moment that was asked for: dM = dp x F + p x dF + dtau n."""
    rng = np.random.default_rng(1)
    point, normal = _places(rng, 40)
    force = _forces(normal, rng)
    slope = position_slope(point, normal, force)
    change = rng.normal(size=(40, 6)) * [1, 1, 1, 0.01, 0.01, 0.01]
    moved = np.einsum("nij,nj->ni", slope, change)
    moment = np.cross(moved[:, :3], force) + np.cross(point, change[:, :3]) + moved[:, 3:] * normal
    np.testing.assert_allclose(moment, change[:, 3:], atol=1e-14)
    assert np.abs(np.sum(moved[:, :3] * normal, axis=1)).max() < 1e-14


@pytest.mark.parametrize("count", LAYOUTS)
def test_nominal_cells_of_one_stiffness_are_as_good_as_the_sum_of_forces(count: int) -> None:
    """(`load_cells` (3), (4)): the covariance of sum (f_i, l_i x f_i) with equal noise."""
    cells = nominal_cells(LAYOUTS[count], GAIN, NOISE)
    maps = np.concatenate([np.r_[np.eye(3), np.cross(np.eye(3), -place).T] for place in LAYOUTS[count]], axis=1)
    np.testing.assert_allclose(cells.inverse()[1], (GAIN * NOISE) ** 2 * maps @ maps.T, rtol=1e-9, atol=1e-18)


def test_predicted_errors_are_those_of_the_dice() -> None:
    rng = np.random.default_rng(2)
    true = random_cells(LAYOUTS[4], rng)
    cells = LoadCells(true.forward(), np.full(12, NOISE))
    point, normal = _places(rng, 20)
    force = 0.1
    wrench = force * np.concatenate([-normal, np.cross(point, -normal)], axis=1)
    tare = 25.0
    volts = true.voltages(wrench) + rng.normal(size=(4000, 20, 12)) * NOISE * np.sqrt(1 + 1 / tare)
    found, _ = cells.wrenches(volts)
    pure = _without_torsion(found, cells.inverse()[1])
    error = np.sqrt(np.mean(np.sum((_axis_on_ellipse(pure) - point) ** 2, axis=-1), axis=0))
    predicted = resolution(cells, point, normal, tare=tare, soft=False)
    np.testing.assert_allclose(error, predicted.position(force), rtol=0.05)  # 1 % by dice; 3 % noise bends the line
    seen = np.sqrt(np.mean(np.sum((found[..., :3] - wrench[:, :3]) ** 2, axis=-1)))
    assert seen == pytest.approx(predicted.force[0], rel=0.02)


def test_at_the_smallest_force_the_dice_err_by_what_was_wanted() -> None:
    """2 mm on a body of 28 x 32 mm is where first order ends: the surface bends, and the force is known to 10 %."""
    rng = np.random.default_rng(5)
    true = random_cells(LAYOUTS[4], rng)
    cells = LoadCells(true.forward(), np.full(12, NOISE))
    point, normal = _places(rng, 15)
    least = resolution(cells, point, normal, tare=400.0, soft=False).smallest(2e-3)
    wrench = least[:, None] * np.concatenate([-normal, np.cross(point, -normal)], axis=1)
    volts = true.voltages(wrench) + rng.normal(size=(4000, 15, 12)) * NOISE * np.sqrt(1 + 1 / 400)
    found = _axis_on_ellipse(_without_torsion(cells.wrenches(volts)[0], cells.inverse()[1]))
    error = np.sqrt(np.mean(np.sum((found - point) ** 2, axis=-1), axis=0))
    np.testing.assert_allclose(error, 2e-3, rtol=0.15)
    assert 0.015 < np.median(least) < 0.03  # N: about 0.02


def test_the_smallest_force_has_the_accuracy_and_none_where_the_calibration_is_worse() -> None:
    rng = np.random.default_rng(3)
    unsure = 1e-3 * np.eye(36)
    cells = LoadCells(random_cells(LAYOUTS[4], rng).forward(), np.full(12, NOISE), covariance=unsure**2)
    found = resolution(cells, *_places(rng, 30))
    least = found.smallest(2e-3)
    for force, noise, known in zip(least, found.noise, found.calibration, strict=True):
        assert np.hypot(noise / force, known) == pytest.approx(2e-3)
    assert np.isinf(found.smallest(float(found.calibration.min()) / 2)).all()
    assert np.all(found.smallest(1e-3) > least)


def test_more_cells_friction_tare_and_drift_act_the_way_they_must() -> None:
    places = _places(np.random.default_rng(4), 30)

    def noise(count: int = 4, **settings: float) -> np.ndarray:
        return resolution(nominal_cells(LAYOUTS[count], GAIN, NOISE), *places, **settings).noise

    plain = noise()
    assert np.all(noise(friction=0.5) > plain)
    np.testing.assert_allclose(noise(tare=1.0), np.sqrt(2) * plain)
    drifted = nominal_cells(LAYOUTS[4], GAIN, NOISE, drift=NOISE)  # as much again on every channel
    np.testing.assert_allclose(resolution(drifted, *places).noise, np.sqrt(2) * plain)
    assert np.all(resolution(nominal_cells(1.5 * LAYOUTS[4], GAIN, NOISE), *places).torque > 0)


def test_the_largest_force_takes_the_first_cell_to_its_limit() -> None:
    cells = nominal_cells(LAYOUTS[4], GAIN, NOISE, limit=0.5)
    point, normal = TIP.foot(np.array([0.0, 5e-3]), np.array([0.0, 12e-3]))
    largest = resolution(cells, point, normal).largest
    assert largest[0] == pytest.approx(4 * GAIN * 0.5)  # above the middle four cells share the push
    wrench = largest[:, None] * np.concatenate([-normal, np.cross(point, -normal)], axis=1)
    np.testing.assert_allclose(np.abs(wrench @ cells.matrix.T).max(axis=1), 0.5)


def test_cells_in_line_and_senseless_settings_are_refused() -> None:
    with pytest.raises(NotIdentifiable, match="in line"):
        nominal_cells(in_line(), GAIN, NOISE)
    with pytest.raises(InputError, match="tare"):
        resolution(nominal_cells(LAYOUTS[4], GAIN, NOISE), *_places(np.random.default_rng(0), 1), tare=0.0)
