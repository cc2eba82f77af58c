"""What an arena senses: a quick camera shows what a slow one does, and tables stand for the barrel's contact."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from jaxtyping import Float, UInt8

from palpate_lab.simulation.arena.camera import BACKGROUNDS, TableCamera
from palpate_lab.simulation.arena.skin import KINDS, RingSkin, disc_points
from palpate_lab.simulation.barrel import Barrel, Indenter, Pressed
from palpate_lab.simulation.ring_camera import READ, SHOT, Look, RenderedCamera, RingCamera
from palpate_lab.simulation.ring_session import RingUnit

UNIT = RingUnit.drawn(3, coarse=True)
QUIET = replace(Look(), noise=0.0, quality=None)


@pytest.fixture(scope="module")
def states() -> list[Pressed]:
    barrel = Barrel.built(UNIT.barrel)
    return [barrel.press([]), barrel.press([Indenter("tip", 2.1, 0.006)])]


def points(state: Pressed) -> Float[np.ndarray, "m 3 3"]:
    return disc_points(UNIT.barrel, np.concatenate([state.markers[:, None], state.discs], axis=1))


def centroids(
    frame: UInt8[np.ndarray, "h w 3"], skin: UInt8[np.ndarray, "h w 3"], near: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "m 2"]:
    """Of what is redder than the skin, 12 px about each place."""
    rows, columns = np.mgrid[: frame.shape[0], : frame.shape[1]]
    more = frame[..., 2].astype(float) - skin[..., 2]
    found = [more * (np.hypot(columns - x, rows - y) < 12.0) for x, y in near]
    return np.array([[(each * axis).sum() / each.sum() for axis in (columns, rows)] for each in found])


@pytest.mark.parametrize("which", [0, 1])
def test_frames_are_those_of_the_photographer(states: list[Pressed], which: int) -> None:
    slow = RenderedCamera(UNIT.camera, QUIET, np.random.default_rng(0))
    swift = TableCamera(UNIT.camera, QUIET, np.random.default_rng(0))
    state = states[which]
    one, other, skin = slow.frame([state.discs], 0.0), swift.frame(points(state)), slow.background(0.0)
    assert np.abs(one.astype(int) - other).max() <= 6  # an edge is 60 of 255 a pixel: a tenth of one
    near = swift.places(points(state))
    off = centroids(one, skin, near) - centroids(other, skin, near)
    assert np.abs(off.mean(axis=0)).max() < 0.01
    assert np.sqrt((off**2).mean()) < 0.02  # whole levels of 255, and polygons whose rims are whole eighths of a pixel


def test_a_place_is_the_centroid_of_the_outline(states: list[Pressed]) -> None:
    swift = TableCamera(UNIT.camera, QUIET, np.random.default_rng(0))
    for state in states:
        x, y = np.moveaxis(UNIT.camera.project(state.discs), -1, 0)
        after_x, after_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
        part = x * after_y - after_x * y
        sums = [(part * (a + b)).sum(axis=1) / (3.0 * part.sum(axis=1)) for a, b in ((x, after_x), (y, after_y))]
        assert np.abs(np.stack(sums, axis=-1) - swift.places(points(state))).max() < 0.02


def test_noise_is_the_sensors_own_and_never_stands_still(states: list[Pressed]) -> None:
    swift = TableCamera(UNIT.camera, replace(Look(), vignette=0.0, shadow=0.0), np.random.default_rng(0))
    place = np.rint(swift.places(points(states[0]))).astype(int)
    frames = [swift.frame(points(states[0])).copy() for _ in range(40)]
    red = np.array([[frame[y, x, 2] for x, y in place] for frame in frames], dtype=float)
    assert red.std() == pytest.approx(np.sqrt(SHOT * 190.0 + READ**2), rel=0.1)  # 960 numbers: 3 % and blotches
    for one, other in pairwise(frames):
        assert not np.array_equal(one[16::32], other[16::32])


def test_hidden_markers_and_those_that_moved_leave_nothing_behind(states: list[Pressed]) -> None:
    swift = TableCamera(UNIT.camera, QUIET, np.random.default_rng(0))
    skin = RenderedCamera(UNIT.camera, QUIET, np.random.default_rng(0)).background(0.0)
    for _ in range(BACKGROUNDS):
        swift.frame(points(states[0]))
    assert np.array_equal(swift.frame(points(states[1]), hidden=range(24)), skin)
    assert not swift.black().any()
    aside = points(states[0]) + np.array([0.3, 0.0, 0.0])  # out of the picture: no window leaves the frame
    assert swift.frame(aside).shape == (UNIT.camera.height, UNIT.camera.width, 3)


def test_another_camera_sees_other_places(states: list[Pressed]) -> None:
    nominal = TableCamera(RingCamera(), QUIET, np.random.default_rng(0))
    middle = points(states[0])[:, 0]
    assert np.abs(nominal.places(points(states[0])) - RingCamera().project(middle)).max() < 0.1


STEP = 2.0 * np.pi / (2 * UNIT.barrel.around)  # rad between columns of nodes


@pytest.fixture(scope="module")
def skin() -> RingSkin:
    return RingSkin.built(UNIT)


def pressed(kind: str, angle: float, depth: float) -> Pressed:
    """The exact contact of what a kind stands for."""
    radius = {"flat": 1.0, "corner": 0.004, "round": 0.055}[kind]
    body = Indenter("plate" if kind == "flat" else "cylinder", angle, depth, radius)
    return Barrel.built(UNIT.barrel).press([body])


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
