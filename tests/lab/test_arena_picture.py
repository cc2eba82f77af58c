"""The arena from above: the same moment gives the same pixels, and each thing is where it should be."""

from dataclasses import replace

import numpy as np
import pytest

from palpate_lab.viewer.arena import FORCE, Trails, colour, mixed, newtons, outline
from palpate_lab.viewer.arena_picture import HEAD, SIZE, ArenaPicture, senses
from tests.support.arena_scenes import BLOCKS, arena, scene

pytest.importorskip("cv2")

HIGH = SIZE[1] - HEAD - 118  # px of two metres


def _seen(picture: np.ndarray, x: float, y: float) -> tuple[int, ...]:
    """Red, green, blue at a place of the field [m]."""
    scale = HIGH / 2.0
    column, row = (SIZE[0] - 3.0 * scale) / 2 + scale * x, HEAD + HIGH - scale * y
    return tuple(picture[round(row), round(column)][::-1].tolist())


def _count(picture: np.ndarray, shade: tuple[int, ...]) -> int:
    """Pixels of the field of exactly this colour."""
    return int((picture[HEAD : HEAD + HIGH, :, ::-1] == shade).all(axis=-1).sum())


def test_the_same_moments_give_the_same_pixels() -> None:
    one, two = ArenaPicture(arena()), ArenaPicture(arena())
    for time in (0.0, 1.0, 2.0):
        first, second = one.draw(scene(time)), two.draw(scene(time))
    assert first.shape == (SIZE[1], SIZE[0], 3)
    np.testing.assert_array_equal(first, second)
    assert (first != ArenaPicture(arena()).draw(scene(2.0))).any()  # without the trail


def test_robots_and_blocks_are_where_they_are() -> None:
    picture = ArenaPicture(arena()).draw(scene(10.0))
    assert _seen(picture, 0.9 - 0.035, 1.0) == colour(0)  # beside its number
    assert _seen(picture, 0.9 + 0.053, 1.03) != colour(0)
    assert _seen(picture, 0.5 - 0.035, 1.5) == mixed(colour(1), 0.5)  # it has arrived
    fixed, pushed = _seen(picture, 1.0, 0.5), _seen(picture, 1.93, 1.0)
    assert len({fixed, pushed, (255, 255, 255)}) == 3
    assert _seen(picture, 2.4, 1.2) == (255, 255, 255)
    elsewhere = replace(scene(10.0), blocks=np.array([[2.4, 1.2, 0.0]]))
    assert _seen(ArenaPicture(arena()).draw(elsewhere), 2.33, 1.2) == pushed


def test_nothing_of_a_block_is_beyond_the_walls() -> None:
    """The third block reaches 0.1 m into the field and as far beyond: only the inner half is drawn."""
    size = arena().size
    inside = outline(BLOCKS[2], size)
    assert inside[:, 1].max() == pytest.approx(2.0)
    assert inside[:, 1].min() == pytest.approx(1.9)
    assert len(outline(replace(BLOCKS[2], y=2.5, turn=0.4), size)) == 0
    turned = outline(BLOCKS[0], size)
    np.testing.assert_allclose(turned.mean(axis=0), [1.0, 0.5])
    np.testing.assert_allclose(np.hypot(*(turned - [1.0, 0.5]).T), np.hypot(0.2, 0.1))
    picture = ArenaPicture(arena()).draw(scene())
    assert _seen(picture, 1.5, 1.95) == _seen(picture, 1.0, 0.5)
    assert _seen(picture, 1.5, 2.05) != _seen(picture, 1.0, 0.5)


def test_an_arrow_grows_with_the_force_and_stands_outside_the_skin() -> None:
    picture = ArenaPicture(arena())
    none, light, hard = (_count(picture.draw(scene(force=force)), FORCE) for force in (0.0, 1.0, 3.0))
    assert none < light < hard
    seen = picture.draw(scene(force=3.0))
    assert _seen(seen, 0.4, 1.0 + 0.055 + 0.1) == FORCE  # at its left, which is up
    assert _seen(seen, 0.4, 1.0 - 0.055 - 0.1) != FORCE


def test_cameras_and_blindness_are_shown() -> None:
    rings = senses(scene(blind=True), 8, 100)
    assert rings.shape == (100, 204, 3)
    images = senses(scene(images=True), 8, 48)
    assert images.shape == (48, 132, 3)
    assert images[40, 30].tolist() == [40, 40, 40]
    assert images[40, 110].tolist() == [200, 200, 200]
    assert newtons(None) == "feels nothing: blind"
    assert newtons(np.array([[0.0, 1.26], [1.0, 0.5]])) == "1.3 + 0.5 N"
    assert (ArenaPicture(arena()).draw(scene(blind=True)) != ArenaPicture(arena()).draw(scene())).any()


def test_a_trail_has_a_point_a_centimetre() -> None:
    trails = Trails(1)
    for x in np.arange(0.0, 0.1, 0.001):
        trails.add(np.array([[x, 0.0, 0.0]]))
    assert trails.length(0) == pytest.approx(10, abs=1)
    assert (np.diff(trails.of(0)[:, 0]) >= 0.01 - 1e-12).all()
