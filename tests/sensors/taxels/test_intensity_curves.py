"""Curves from intensity to force: they rise, they invert, and their spread is that of their parameters."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.taxels.intensity import Curve, Intensity

CURVES = {
    "polynomial": Curve("polynomial", np.array([40.0, -1.5, 0.05]), np.zeros((3, 3)), largest=10.0),
    "two_range": Curve("two_range", np.array([100.0, -20.0, 7.0]), np.zeros((3, 3)), largest=15.0, joint=1.2),
    "monotone": Curve(
        "monotone", np.array([30.0, 50.0, 55.0]), np.zeros((3, 3)), largest=6.0, knots=np.array([1.0, 3.0, 6.0])
    ),
    "resistive": Curve(
        "resistive", np.array([20.0, 0.5]), np.zeros((2, 2)), largest=8.0, falling=True, reference=10.0, scale=1024.0
    ),
}


@pytest.mark.parametrize("name", CURVES)
def test_force_of_the_intensity_of_a_force_is_that_force(name: str) -> None:
    """To 1e-5 of the range, which a table of 2048 entries is good for where the slope changes fivefold at a joint."""
    curve = CURVES[name]
    force = np.linspace(0.0, curve.largest, 400)
    back = curve.force(curve.intensity(force))
    assert np.abs(back - force).max() < 3e-3 * curve.largest
    assert np.abs(back - force).mean() < 1e-4 * curve.largest


@pytest.mark.parametrize("name", CURVES)
def test_noise_about_zero_is_not_clipped(name: str) -> None:
    """Else the sum over idle cells would be positive: the first slope goes on below zero, on both sides alike."""
    curve = CURVES[name]
    step = 1e-3 * float(curve.intensity(np.array([curve.largest]))[0])
    below, above = curve.force(np.array([-step, step]))
    assert below < 0
    assert below == pytest.approx(-above, rel=0.05)


def test_a_resistive_curve_is_the_divider() -> None:
    force = np.array([0.5, 2.0, 7.0])
    reading = 1024.0 * (1.0 - 10.0 / (2 * 20.0 / force + 0.5))
    np.testing.assert_allclose(CURVES["resistive"].intensity(force), 1024.0 - reading, rtol=1e-12)


def test_a_curve_that_falls_back_is_refused_with_the_place() -> None:
    with pytest.raises(InputError, match=r"does not rise at.*Use"):
        Curve("polynomial", np.array([10.0, -1.0]), np.zeros((2, 2)), largest=9.0)


def test_curves_of_a_sheet_of_another_size_are_refused() -> None:
    two = Intensity((CURVES["polynomial"], CURVES["polynomial"]), np.array([[0, 1], [1, 0]]))
    with pytest.raises(InputError, match=r"intensity: .*2 x 2 cells, not 6 x 22"):
        two.numbers((6, 22))
