"""Magnets in rubber and pillars: the mechanics balance and obey their equations, and readings follow the touches."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate_lab.simulation.three_axis_skins import (
    FRICTION,
    MODULUS,
    POISSON,
    ThreeAxisSkin,
    half_space,
    magnetic_skin,
    pillar_array,
)
from palpate_lab.simulation.three_axis_touches import HEAVY, LIGHT, REST, SHEAR, Loads, three_axis_touches

SKINS = pytest.mark.parametrize("make", [magnetic_skin, pillar_array])
FORCE = np.array([0.7, -0.4, -2.0])


def _loads(skin: ThreeAxisSkin, spacing: tuple[float, float] | None = None, *, twist: bool = False) -> Loads:
    return three_axis_touches(skin.positions, np.random.default_rng(5), 12, spacing=spacing, twist=twist)


def _moved(place: np.ndarray) -> np.ndarray:
    return half_space(place[:2], -float(place[2]), FORCE)


def test_a_half_space_is_in_equilibrium() -> None:
    """Navier: (1 - 2 nu) lap u + grad div u = 0 inside, by differences of second order in steps of 3 um."""
    place, step = np.array([1.1e-3, -0.6e-3, -1.5e-3]), 3e-6
    axes = step * np.eye(3)

    def mixed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return _moved(place + a + b) - _moved(place + a - b) - _moved(place - a + b) + _moved(place - a - b)

    second = np.array([[mixed(a, b) for b in axes] for a in axes]) / (4 * step**2)
    terms = (1 - 2 * POISSON) * np.einsum("aac->c", second), np.einsum("cbb->c", second)
    np.testing.assert_allclose(sum(terms), 0.0, atol=1e-4 * np.abs(second).max())


def test_the_face_of_a_half_space_gives_way_as_boussinesq_says() -> None:
    down = half_space(np.array([2e-3, 0.0]), 0.0, np.array([0.0, 0.0, -3.0]))[2]
    assert down == pytest.approx(-3.0 * (1 - POISSON) / (2 * np.pi * MODULUS * 2e-3))


def test_pillars_balance_the_touch_within_friction() -> None:
    skin = pillar_array(4, 6, 0)
    loads = _loads(skin, twist=True)
    values, truth = skin.mechanics(skin.positions, loads)
    np.testing.assert_allclose(values[loads.frame].sum(axis=1), truth.force, atol=1e-12)
    np.testing.assert_allclose(truth.force[:, 2], loads.force[:, 2], rtol=1e-9)  # 40 halvings of 8 mm
    moment = np.cross(skin.positions, values[loads.frame]).sum(axis=1)
    left = moment - np.cross(truth.place, truth.force)
    np.testing.assert_allclose(left, truth.torque[:, None] * [0, 0, 1], atol=1e-12)
    assert (np.linalg.norm(truth.force[:, :2], axis=1) <= FRICTION * -truth.force[:, 2]).all()
    assert (values[..., 2] <= 0.0).all()  # nothing pulls


@SKINS
def test_readings_are_quiet_until_a_touch_and_turn_with_its_shear(
    make: Callable[[int, int, int], ThreeAxisSkin],
) -> None:
    skin = make(4, 4, 1)
    loads = _loads(skin)
    readings, _ = skin.readings(loads, 0)
    assert np.array_equal(readings, np.rint(readings))
    warm = skin.readings(loads, 0, np.linspace(0.0, 10.0, loads.count))[0]
    np.testing.assert_allclose(warm[-1], 0.988 * readings[-1] + 100.0, atol=1.1)  # whole counts, noise
    rest = readings[: REST // 2].std(axis=0).max()
    assert np.abs(readings[REST // 2 : REST] - readings[: REST // 2].mean(axis=0)).max() < 8 * rest
    assert np.ptp(readings, axis=0).max() > 50 * rest
    other = replace(loads, force=loads.force * [-1, -1, 1])
    change = (skin.readings(other, 0)[0] - readings)[loads.frame, :, :2].sum(axis=1)
    assert (np.sum(change * loads.force[:, :2], axis=1)[loads.full] != 0.0).all()
    signs = np.sign(np.sum(change * loads.force[:, :2], axis=1)[loads.full])
    assert abs(signs.mean()) > 0.9  # the sum of shear readings follows the shear, whatever its sign convention


@SKINS
def test_touches_are_as_asked(make: Callable[[int, int, int], ThreeAxisSkin]) -> None:
    skin = make(4, 4, 0)
    loads = _loads(skin, spacing=(2 * skin.pitch, 3 * skin.pitch), twist=True)
    pairs = loads.place.reshape(-1, 2, 3)
    far = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1) / skin.pitch
    assert (far >= 2.0).all()
    assert (far <= 3.0).all()
    force = loads.force[loads.full]
    assert ((-force[:, 2] >= LIGHT) & (-force[:, 2] <= HEAVY)).all()
    assert (np.linalg.norm(force[:, :2], axis=1) <= SHEAR * -force[:, 2] + 1e-12).all()
    assert loads.frame.max() < loads.count
    assert (np.abs(loads.place) <= np.abs(skin.positions).max() + 1e-12).all()
