"""Calibrated curves: the truth is a curve written down here, with noise of a known size."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.calibrate import identify_intensity, identify_resistive, tells
from palpate.sensors.taxels.intensity import Curve
from tests.support.dice import agree, rolled


def _pressed(force: np.ndarray, noise: float = 1.0, seed: int = 1) -> np.ndarray:
    """A polynomial of degree 2 on a rest of 7 counts."""
    return 7.0 + 30.0 * force - 0.6 * force**2 + noise * np.random.default_rng(seed).standard_normal(len(force))


def test_a_polynomial_is_found_within_its_own_deviations() -> None:
    force = np.linspace(0.0, 12.0, 300)
    curve = identify_intensity(force, _pressed(force), kind="polynomial", degree=2).curves[0]
    off = (curve.parameters - [30.0, -0.6]) / np.sqrt(np.diag(curve.covariance))
    assert np.abs(off).max() < 4.0
    assert curve.residual == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize(("degree", "misfits"), [(1, True), (2, False)])
def test_a_polynomial_of_too_low_a_degree_is_less_sure_than_by_its_residuals(degree: int, misfits: bool) -> None:
    """Those of a line through a curve go together: stretches left out are not where the others predict."""
    terms = np.linspace(0.0, 12.0, 400)[:, None] ** np.arange(degree + 1)
    reading = _pressed(terms[:, 1])
    variance = np.linalg.lstsq(terms, reading, rcond=None)[1][0] / (399 - degree)
    found = identify_intensity(terms[:, 1], reading, kind="polynomial", degree=degree).curves[0]
    assert (found.covariance[0, 0] > 5.0 * variance * np.linalg.inv(terms.T @ terms)[1, 1]) == misfits


@pytest.mark.parametrize("kind", ["auto", "polynomial", "monotone"])
def test_every_kind_predicts_forces_that_it_has_not_seen(kind: str) -> None:
    """To 0.15 N: five times the fit's deviation of 0.03 N, and the chord of twelve knots."""
    force = np.linspace(0.0, 12.0, 400)
    curve = identify_intensity(force, _pressed(force), kind=kind).curves[0]
    fresh = np.linspace(0.3, 11.7, 50)
    assert np.abs(curve.force(_pressed(fresh, 0.0) - 7.0) - fresh).max() < 0.15


def test_two_ranges_are_joined_where_they_meet() -> None:
    rng = np.random.default_rng(2)
    force = np.linspace(0.0, 15.0, 600)
    reading = 5.0 + 100.0 * np.minimum(force, 1.2) + 7.0 * np.maximum(force - 1.2, 0.0)
    curve = identify_intensity(force, reading + rng.standard_normal(600)).curves[0]
    assert curve.kind == "two_range"
    assert curve.joint == pytest.approx(1.2, abs=0.05)
    gap = curve.intensity(np.array([curve.joint - 1e-9, curve.joint + 1e-9]))
    assert abs(gap[1] - gap[0]) < 1e-5


def test_readings_at_the_end_of_the_range_are_left_out_and_named() -> None:
    force = np.linspace(0.0, 12.0, 300)
    cut = np.minimum(_pressed(force), 200.0)
    curve = identify_intensity(force, cut, kind="polynomial", degree=2).curves[0]
    assert curve.saturation == 200.0
    assert curve.parameters[0] == pytest.approx(30.0, rel=0.03)


@pytest.mark.parametrize("kind", ["auto", "monotone", "polynomial"])
def test_a_taxel_that_saturates_below_its_noise_is_measured_to_there(kind: str) -> None:
    """Flat from 5 N on: the range to within a knot, forces below to 0.15 N, and readings up there are saturated."""
    force = np.linspace(0.0, 20.0, 600)
    noise = np.random.default_rng(8).standard_normal(600)
    curve = identify_intensity(force, 7.0 + 40.0 * np.minimum(force, 5.0) + noise, kind=kind).curves[0]
    assert curve.largest == pytest.approx(5.0, abs=1.0)
    assert curve.saturation == pytest.approx(207.0, abs=10.0)
    assert curve.saturation < 207.0
    fresh = np.linspace(0.3, 4.7, 20)
    assert np.abs(curve.force(40.0 * fresh) - fresh).max() < 0.15
    assert tells(curve, np.array([curve.largest / 2])).all()


def test_a_straight_line_says_why_it_is_one() -> None:
    force = np.linspace(0.0, 8.0, 9)
    few = identify_intensity(force, 7.0 + 30.0 * force - 0.6 * force**2, kind="polynomial")
    assert any("degree 1: 9 presses are too few" in note for note in few.notes)
    many = np.linspace(0.0, 8.0, 200)
    reading = 7.0 + 30.0 * many + np.random.default_rng(9).standard_normal(200)
    notes = identify_intensity(many, reading, kind="polynomial").notes
    assert any("best the presses that were left out" in note for note in notes)
    assert not any("line" in note for note in identify_intensity(many, reading, kind="polynomial", degree=1).notes)


def test_loading_and_unloading_that_differ_are_reported() -> None:
    up = np.linspace(0.0, 10.0, 200)
    force = np.concatenate([up, up[::-1]])
    reading = 20.0 * force + np.where(np.arange(400) < 200, 0.0, 10.0 * np.sin(np.pi * force / 10.0))
    curve = identify_intensity(force, reading, kind="polynomial", degree=3).curves[0]
    assert curve.hysteresis == pytest.approx(10.0 / 200.0, rel=0.15)


def test_each_cell_has_its_gain() -> None:
    rng = np.random.default_rng(5)
    gain = 1.0 + 0.1 * rng.standard_normal((3, 4))
    force = np.tile(np.linspace(0.0, 10.0, 60), 12)
    cell = np.repeat(np.argwhere(np.ones((3, 4))), 60, axis=0)
    reading = rng.uniform(2, 9, 12).repeat(60) + gain.ravel().repeat(60) * (_pressed(force, 0.0) - 7.0)
    found = identify_intensity(force, reading + 0.5 * rng.standard_normal(720), cell, shape=(3, 5))
    slopes = np.array([curve.slope(np.array([1.0]))[0] for curve in found.curves])[found.numbers((3, 5)).reshape(3, 5)]
    ratio = slopes[:, :4] / gain
    assert ratio.std() / ratio.mean() < 0.01
    assert found.numbers((3, 5)).reshape(3, 5)[:, 4].tolist() == [0, 0, 0]  # not pressed: the common curve
    assert any("3 of 15 cells" in note for note in found.notes)


@pytest.mark.parametrize("flat", [np.inf, 6.0])
def test_gains_that_differ_by_a_third_are_not_taken_for_saturation(flat: float) -> None:
    """Raw readings scatter as if they went flat; over their gains only those beyond `flat` do, cell by cell."""
    rng = np.random.default_rng(1)
    gain, zero = np.exp(0.3 * rng.standard_normal(12)), rng.uniform(3.0, 8.0, 12)
    number, force = np.repeat(np.arange(12), 40), rng.uniform(0.0, 10.0, 480)
    exact = gain[number] * (20.0 * np.minimum(force, flat) - 0.6 * np.minimum(force, flat) ** 2)
    reading = zero[number] + exact + 0.5 * rng.standard_normal(480)
    found = identify_intensity(force, reading, np.stack([number // 4, number % 4], axis=1))
    assert found.curves[0].largest > (9.9 if flat > 10.0 else 5.0)
    for cell, curve in enumerate(found.curves[1:]):
        assert curve.force(np.array([gain[cell] * (20.0 * 4.0 - 0.6 * 16.0)]))[0] == pytest.approx(4.0, rel=0.03)
        end = zero[cell] + gain[cell] * (20.0 * 6.0 - 0.6 * 36.0)
        assert np.isnan(curve.saturation) if flat > 10.0 else curve.saturation == pytest.approx(end, rel=0.05)


def test_what_cannot_be_determined_is_said() -> None:
    with pytest.raises(NotIdentifiable, match="too few"):
        identify_intensity(np.arange(4.0), np.arange(4.0))
    with pytest.raises(NotIdentifiable, match="same force"):
        identify_intensity(np.full(50, 2.0), np.arange(50.0))
    with pytest.raises(InputError, match=r"negative.*Give"):
        identify_intensity(np.linspace(-5.0, 5.0, 50), np.linspace(0.0, 100.0, 50))


def test_a_resistive_sheet_gives_its_resistances_back() -> None:
    rng = np.random.default_rng(6)
    force = rng.uniform(0.1, 8.0, 600)
    layer = np.arange(600) % 2
    reference = np.full(600, 10.0)
    series = np.array([0.5, 1.6])[layer]
    reading = 1024.0 * (1.0 - reference / (2 * 17.0 / force + series)) + rng.standard_normal(600)
    force[3] = reading[5] = np.nan  # rows that are not finite are left out
    curves = identify_resistive(force, reading, scale=1024.0, reference=reference, layer=layer, floor=20.0)
    for curve, true in zip(curves, (0.5, 1.6), strict=True):
        off = (curve.parameters - [17.0, true]) / np.sqrt(np.diag(curve.covariance))
        assert np.abs(off).max() < 4.0


def test_real_taxels_are_predicted_better_than_by_the_published_parameters(shared: Path) -> None:
    """On every second block of 20 rows, held out; the published ones were found on three more runs."""
    table = np.loadtxt(shared / "data" / "taxel_force" / "thin.1614725386.31.txt")
    force = np.maximum((table[:, 0] - 8322237) / (8341540 - 8322237) * 0.050 * 9.80665, 0.0)
    reading, train = table[:, 1] / 5, np.arange(len(table)) // 20 % 2 == 0
    layer, reference = np.zeros(len(table), dtype=np.int64), np.ones(len(table))
    fitted = identify_resistive(
        force[train], reading[train], scale=1024.0, reference=reference[train], layer=layer[train]
    )[0]
    published = 1024.0 * (1.0 - force / (2 * 16.963 + 1.620 * force))
    ours = 1024.0 - fitted.intensity(force)
    rms = [float(np.sqrt(np.mean((model - reading)[~train] ** 2))) for model in (ours, published)]
    assert rms[0] <= rms[1]


def test_beyond_its_data_a_cubic_goes_on_by_its_last_slope() -> None:
    """The slope is the cubic's derivative at the largest force; back from counts it is a chord of 2048 knots."""
    force = np.linspace(0.0, 8.0, 400)
    curve = identify_intensity(force, 60.0 * force / (1.0 + 0.1 * force), kind="polynomial", degree=3).curves[0]
    beyond = np.linspace(8.0, 40.0, 9)
    slope = float(np.polyder(np.poly1d([*curve.parameters[::-1], 0.0]))(8.0))
    np.testing.assert_allclose(np.diff(curve.intensity(beyond)) / np.diff(beyond), np.full(8, slope), rtol=1e-5)
    np.testing.assert_allclose(curve.force(curve.intensity(beyond)), beyond, rtol=1e-3)


@pytest.mark.parametrize("scatter", [0.0, 0.02])
def test_halves_of_a_log_agree_within_their_deviations_where_the_gain_varies(scatter: float) -> None:
    """Twenty presses, each with a gain of its own; judged by all parameters alone it is 2.5 times what they expect."""
    rng, squares = np.random.default_rng(7), list[float]()
    force = 5.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(400) / 20.0))
    for _ in range(20):
        gain = 1.0 + np.repeat(scatter * rng.normal(size=20), 20)
        reading = 20.0 + 30.0 * gain * force + 3.0 * rng.normal(size=400)
        first, second = (
            identify_intensity(force[rows], reading[rows], kind="polynomial", degree=1).curves[0]
            for rows in (slice(200), slice(200, 400))
        )
        spread = float(first.covariance[0, 0] + second.covariance[0, 0])
        squares.append(float(first.parameters[0] - second.parameters[0]) ** 2 / spread)
    assert 0.5 < np.mean(squares) < 2.0


def test_a_divider_is_as_sure_as_its_readings() -> None:
    """Of two layers, the contact that they share and the resistance in series belong together."""
    rng, layer = np.random.default_rng(9), np.arange(60) % 2
    force, reference = rng.uniform(0.2, 5.0, 60), np.where(layer == 0, 4.0, 6.0)
    exact = 1000.0 * (1 - reference * force / (2 * 20.0 + np.array([0.5, 0.8])[layer] * force))
    reading = exact + rng.standard_normal(60)

    def fitted(off: np.ndarray) -> tuple[Curve, ...]:
        return identify_resistive(force, reading + off, scale=1000.0, reference=reference, layer=layer)

    curves = fitted(np.zeros(60))
    variance = sum(30 * curve.residual**2 for curve in curves) / 57
    for k, curve in enumerate(curves):
        found = rolled(lambda off, k=k: fitted(off)[k].parameters, variance * np.eye(60), 0.1)
        agree(curve.covariance, found, 0.02)
