"""The skin of tables stands for the barrel's own contact, and adds up as linear elasticity does."""

import numpy as np
import pytest
from jaxtyping import Float

from palpate_lab.simulation.arena.skin import KINDS, RingSkin, disc_points
from palpate_lab.simulation.barrel import Barrel, Indenter, Pressed
from palpate_lab.simulation.ring_session import RingUnit

UNIT = RingUnit.drawn(3, coarse=True)
STEP = 2.0 * np.pi / (2 * UNIT.barrel.around)  # rad between columns of nodes


@pytest.fixture(scope="module")
def skin() -> RingSkin:
    return RingSkin.built(UNIT)


def pressed(kind: str, angle: float, depth: float) -> Pressed:
    """The exact contact of what a kind stands for."""
    radius = {"flat": 1.0, "corner": 0.004, "round": 0.055}[kind]
    body = Indenter("plate" if kind == "flat" else "cylinder", angle, depth, radius)
    return Barrel.built(UNIT.barrel).press([body])


def points(state: Pressed) -> Float[np.ndarray, "m 3 3"]:
    return disc_points(UNIT.barrel, np.concatenate([state.markers[:, None], state.discs], axis=1))


def touch(kind: str, angle: float, force: float, shear: float = 0.0) -> Float[np.ndarray, "1 5"]:
    return np.array([[angle, force, shear, 0.0, KINDS.index(kind)]])


def test_nothing_moves_where_nothing_touches(skin: RingSkin) -> None:
    assert np.array_equal(skin.markers(np.zeros((0, 5))), skin.rest)
    assert np.allclose(skin.rest[:, 0], Barrel.built(UNIT.barrel).rest[:, 0], atol=5e-5)  # the disc lies on a bent skin


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("angle", "share"), [(0.0, 0.02), (20 * STEP, 0.04), (41.3 * STEP, 0.06)])
def test_a_touch_is_the_barrels(skin: RingSkin, kind: str, angle: float, share: float) -> None:
    """Closest where it was solved; a thicker wall is pressed otherwise, and an edge hops from point to point."""
    state = pressed(kind, angle, 0.006)
    found = skin.markers(touch(kind, float(state.angle[0]), float(state.force[0]), float(state.shear[0])))
    largest = np.abs(points(state) - skin.rest).max()
    assert np.abs(found - points(state)).max() < share * largest


def test_touches_add_up(skin: RingSkin) -> None:
    one, other = touch("flat", 1.0, 2.0, 0.3), touch("corner", 2.5, 1.0)
    both = skin.markers(np.concatenate([one, other])) - skin.rest
    alone = (skin.markers(one) - skin.rest) + (skin.markers(other) - skin.rest)
    assert np.allclose(both, alone, rtol=0.0, atol=1e-12)


def test_shear_drags_the_skin_along_and_a_turn_changes_nothing(skin: RingSkin) -> None:
    ahead, back = (skin.markers(touch("flat", 0.0, 2.0, each)) for each in (0.5, -0.5))
    assert ahead[0, 0, 1] > back[0, 0, 1] + 1e-4  # rising angle at angle 0 is y
    turned = skin.markers(touch("flat", -2.0 * np.pi, 2.0, 0.5))
    assert np.allclose(turned, ahead, rtol=0.0, atol=1e-12)


def test_more_force_moves_more_and_beyond_the_tables_in_proportion(skin: RingSkin) -> None:
    for kind in KINDS:
        moved = [np.abs(skin.markers(touch(kind, 0.7, each)) - skin.rest).max() for each in np.linspace(0.01, 8, 60)]
        assert (np.diff(moved) > 0.0).all()
    last = float(skin.largest[0])
    once, twice = (skin.markers(touch("flat", 0.7, each * last)) - skin.rest for each in (1.0, 2.0))
    assert np.allclose(twice, 2.0 * once, rtol=0.0, atol=1e-12)
