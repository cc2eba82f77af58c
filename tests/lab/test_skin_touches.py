"""Fingers on the skin: readings stand where the truth is, two are as far apart as asked, frames begin with rest."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate_lab.simulation.poke_bench import PokeBench
from palpate_lab.simulation.skin_touches import SkinTouches, simulate_touches


@pytest.fixture(scope="module")
def bench() -> PokeBench:
    return PokeBench.drawn(np.random.default_rng(1))


@pytest.fixture(scope="module")
def single(bench: PokeBench) -> SkinTouches:
    return simulate_touches(bench, np.random.default_rng(2), 40)


def test_the_strongest_taxel_is_near_the_truth(bench: PokeBench, single: SkinTouches) -> None:
    """Gains differ by 10 %, neighbours lie 6 mm apart: the strongest is one of those within 6 mm."""
    there = single.frames[single.start] - single.rest
    away = np.linalg.norm(bench.skin.places.positions[there.argmax(axis=1)] - single.point, axis=1)
    assert away.max() < 6e-3
    assert there.max(axis=1).min() > 3.0


def test_readings_are_whole_or_not_and_rest_between(bench: PokeBench, single: SkinTouches) -> None:
    assert (single.frames == np.rint(single.frames)).all()
    floats = simulate_touches(bench, np.random.default_rng(2), 40, counts=False)
    np.testing.assert_array_equal(floats.point, single.point)
    assert np.abs(floats.frames - single.frames).max() <= 0.5
    before = floats.frames[:8] - floats.rest
    assert before.std() == pytest.approx(bench.layer.noise, rel=0.1)
    assert np.abs(floats.frames[-1] - floats.rest).max() < 5 * bench.layer.noise


def test_truth_has_a_row_a_contact_and_frame(single: SkinTouches) -> None:
    rows = single.truth()
    assert len(rows) == (single.end - single.start + 1).sum()
    assert (np.diff(rows[:, 0]) >= 0).all()
    touched = (single.frames - single.rest).max(axis=1)
    assert touched[np.searchsorted(single.time, rows[:, 0])].min() > 3.0
    assert (np.einsum("ni,ni->n", rows[:, 4:7], rows[:, 7:10]) < 0).all()


def test_two_at_once_are_so_far_apart(bench: PokeBench) -> None:
    """Along the sheet; straight through the cone at most 1 - (12 / 32)^2 / 24 of it."""
    both = simulate_touches(bench, np.random.default_rng(3), 30, spacing=12e-3)
    pair = both.point.reshape(-1, 2, 3)
    apart = np.linalg.norm(pair[:, 1] - pair[:, 0], axis=1)
    assert apart.max() <= 12e-3 + 1e-9
    assert apart.min() > 12e-3 * (1 - (12 / 28) ** 2 / 24)
    np.testing.assert_array_equal(both.touch, np.repeat(np.arange(30), 2))
    with pytest.raises(InputError, match="no two places"):
        simulate_touches(bench, np.random.default_rng(3), 5, spacing=0.125)


def test_forces_add_up(bench: PokeBench) -> None:
    """A finger's readings are linear in its pressure: twice the force on the same disc, twice the reading."""
    points = bench.skin.places.positions[:4]
    x, y = np.zeros((4, 1)), np.zeros((4, 1))
    one, two = (bench.answers(points, x, y, np.full((4, 1), force))[2] for force in (3.0, 6.0))
    np.testing.assert_allclose(two, 2 * one)
