"""The response of a ring of markers: its derivatives, what it predicts, and how a new unit borrows it."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.optical.ring_response import ring_basis
from palpate.sensors.marker_ring.locator import RingLocator, turned
from palpate.sensors.marker_ring.response_fit import (
    RingPresses,
    _deviations,
    _dragged,
    _most_likely,
    _pressed,
    _usual,
    fit_response,
)

pytest.importorskip("skfem")

from tests.support.ring_presses import MARKERS, all_round, calibrated, presses, tip


def test_the_basis_is_periodic_and_orthogonal() -> None:
    turn = 2.0 * np.pi * np.arange(60) / 60
    basis = ring_basis(turn, 4)
    np.testing.assert_allclose(basis, ring_basis(turn + 2.0 * np.pi, 4), atol=1e-12)
    gram = basis.T @ basis / 60
    np.testing.assert_allclose(gram, np.diag([1.0, *([0.5] * 8)]), atol=1e-12)


def test_tables_are_the_response_and_its_derivative() -> None:
    response, step = calibrated()[0], 1e-6
    table, slope = response.tables(MARKERS, 36)
    for k in (0, 5, 17):
        phi = 2.0 * np.pi * k / 36

        def at(angle: float) -> np.ndarray:
            return response.at(MARKERS - angle, np.full(24, angle)).reshape(48, -1)

        np.testing.assert_allclose(table[k], at(phi), atol=1e-15)
        np.testing.assert_allclose(slope[k], (at(phi + step) - at(phi - step)) / (2.0 * step), atol=1e-9)


def test_a_press_that_was_left_out_is_predicted() -> None:
    """Within a tenth of what the markers move by, and what is said of the misfit holds."""
    response = calibrated()[0]
    made = presses([tip(at, 0.006) for at in (0.5, 2.2, 4.1)], np.random.default_rng(3))
    z = (made.depth / made.force - response.width[0]) / response.width[1]
    for k in range(3):
        shapes = response.at(MARKERS - made.angle[k], np.full(24, made.angle[k]))
        terms = np.array([made.force[k], made.force[k] * z[k], made.force[k] * z[k] ** 2, made.shear[k]])
        left = made.displacements[k] - shapes @ terms
        assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(made.displacements[k] ** 2))


def test_each_ring_has_the_response_of_its_own_markers() -> None:
    """Two rings that see the same have each what one alone has, to rounding; another's rings must be as many."""
    alone, made = calibrated()
    twice = replace(
        made,
        displacements=np.concatenate([made.displacements, 2.0 * made.displacements], axis=1),
        markers=np.tile(MARKERS, 2),
        noise=np.concatenate([made.noise, 2.0 * made.noise]),
        rings=2,
    )
    both = fit_response(twice)
    assert both.rings == 2
    np.testing.assert_allclose(both.coefficients[:, :2], alone.coefficients, rtol=0, atol=1e-12)
    np.testing.assert_allclose(both.coefficients[:, 2:], 2.0 * alone.coefficients, rtol=0, atol=1e-9)
    np.testing.assert_allclose(both.misfit, np.concatenate([alone.misfit, 2.0 * alone.misfit]), rtol=1e-6)
    table, _ = both.tables(np.tile(MARKERS, 2), 8)
    np.testing.assert_allclose(table[:, 48:], 2.0 * table[:, :48], rtol=0, atol=1e-9)
    with pytest.raises(InputError, match=r"1 rings of markers, but this unit has 2.*Name"):
        fit_response(twice, alone)


def test_the_likeliest_prior_is_the_one_that_numbers_were_drawn_from() -> None:
    """Coefficients drawn with known deviations, seen through a random design: their size within a tenth."""
    rng, shape = np.random.default_rng(12), (3, 2, 17, 3)
    for size, smooth, uneven in ((0.5, 3.0, 0.1), (2.0, 5.0, 0.5)):
        truth = 1e-3 * _deviations(shape, size, smooth, uneven)
        design = rng.standard_normal((1500, len(truth))) / 1e-4
        drawn = design @ (truth[:, None] * rng.standard_normal((len(truth), 2))) + rng.standard_normal((1500, 2))
        found = _most_likely(design.T @ design, design.T @ drawn, shape, 1e-3, (1.0, 4.0, 0.03))
        assert np.abs(np.log(found / truth)).max() < 0.8
        assert abs(np.log(found[0] / truth[0])) < 0.3


def test_what_is_usual_is_what_the_presses_were() -> None:
    """Widths 1 and 3 in turns, half of the presses dragged by 0.4 of their force; a light one's 0.9 is no grip."""
    force, shear = np.array([2.0, 2.0, 1.0, 1.0, 0.1]), np.array([0.8, 0.0, -0.4, 0.0, 0.09])
    depth = force * (3e-3 + 1e-3 * np.array([1.0, 3.0, 1.0, 3.0, 2.0]))
    nothing = np.zeros((5, 24, 2))
    made = RingPresses(np.arange(5.0), depth, force, shear, nothing, MARKERS, np.ones((24, 2)))
    usual, grip = _usual(made, np.array([3e-3, 1e-3]), True)
    np.testing.assert_allclose(usual, [2.0, np.sqrt(0.8), np.sqrt((2.0 * 0.16 + 0.81) / 5.0)])
    assert grip == pytest.approx(0.4)
    assert _usual(made, np.array([3e-3, 1e-3]), False)[1] == 0.0


def test_presses_of_two_kinds_are_found_as_they_were_drawn() -> None:
    rng = np.random.default_rng(13)
    for share, narrow, wide in ((0.1, 0.03, 0.4), (0.3, 0.05, 0.25)):
        dragged = rng.random(2000) < share
        found = _dragged(np.where(dragged, wide, narrow) * rng.standard_normal(2000))
        np.testing.assert_allclose(found, [share, narrow, wide], rtol=0.12)


def test_presses_of_one_kind_are_of_one_kind() -> None:
    for seed in range(20):
        assert not _dragged(0.2 * np.random.default_rng(seed).standard_normal(300)).any()
    assert not _dragged(np.zeros(50)).any()


def test_shear_that_is_stated_as_0_is_not_believed_to_be_0() -> None:
    share, narrow, wide = _dragged(np.array([0.0] * 90 + [0.4, -0.4] * 5)).tolist()
    assert share == pytest.approx(0.1, abs=0.01)  # 0 may be dragged, too
    assert narrow == 0.02
    assert wide == pytest.approx(0.4, rel=0.05)


def test_a_calibration_finds_its_dragged_presses() -> None:
    response, made = calibrated()
    share = made.shear / made.force
    assert response.dragged[0] == pytest.approx(np.mean(np.abs(share) > 0.1), abs=0.12)
    assert response.dragged[1] < 0.06
    assert response.dragged[2] == pytest.approx(response.grip, rel=0.4)


def test_skin_that_shear_carries_along_is_found() -> None:
    """Angles that shear turns by more, per newton and by its compliance, raise what is found by that; the rest stays.

    To 5 %: the forces are then along other axes of the skin.
    """
    made = calibrated()[1]
    deep, added = made.depth / made.force, ((0.01, 0.0), (0.02, 2.0))
    here, more = (replace(made, angle=made.angle + (wall + local * deep) * made.shear) for wall, local in added)
    before, after = fit_response(here), fit_response(more)
    assert (before.carried > 0.005).all()
    first, second = (each.carried[0] + each.carried[1] * deep for each in (before, after))
    np.testing.assert_allclose(second, first + 0.01 + 2.0 * deep, rtol=0.05)
    np.testing.assert_allclose(after.coefficients, before.coefficients, atol=0.02 * np.abs(before.coefficients).max())


def test_a_press_is_the_same_force_along_the_axes_of_the_skin() -> None:
    made = calibrated()[1]
    turned = _pressed(made, np.array([0.1, 1.0]))
    assert np.abs(turned.angle - made.angle).max() > 0.01
    before, after = (np.exp(1j * each.angle) * (-each.force + 1j * each.shear) for each in (made, turned))
    np.testing.assert_allclose(after, before, rtol=1e-12)


def test_another_unit_is_touched_as_the_first() -> None:
    """Two dozen presses that are not dragged tell nothing of friction."""
    before, made = calibrated()
    some = np.arange(len(made)) % 6 < 2
    after = fit_response(made.picked(some), before)
    assert after.grip == before.grip
    np.testing.assert_array_equal(after.carried, before.carried)
    np.testing.assert_array_equal(after.usual, before.usual)
    np.testing.assert_array_equal(after.dragged, before.dragged)


def test_the_skin_turns_as_kirchhoff_says() -> None:
    """u_outer = u (1 + t / r) - t / r dw / dtheta, the slope by a difference; the sum over harmonics written out."""
    response = calibrated()[0]
    skin, step, share = response.skin(0.055, 0.051), 1e-6, 0.004 / 0.051
    for delta, phi in ((0.4, 1.0), (-0.7, 4.0)):
        here, after, before = (
            response.at(np.array([delta + each]), np.array([phi]))[0, :, :3] for each in (0.0, step, -step)
        )
        slope = (after[0] - before[0]) / (2.0 * step)
        basis = ring_basis(np.array(delta), response.orders[0]), ring_basis(np.array(phi), response.orders[1])
        found, tilt = np.einsum("ebkm,k,m->eb", skin[:, :3], *basis)
        np.testing.assert_allclose(found, here[1] * (1.0 + share) - share * slope, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(tilt, slope, rtol=1e-6, atol=1e-12)


def test_another_unit_needs_two_dozen_presses() -> None:
    """With the first unit's response 24 presses do: in full, which takes 144, the angles are 0.29 degrees off."""
    made = all_round(4)
    some = np.zeros(len(made), dtype=bool)
    some[np.arange(24) * 6 + 3 * (np.arange(24) % 2) + 1] = True
    response = fit_response(made.picked(some), calibrated()[0])
    judged = presses([tip(at, 0.005, 0.025) for at in np.arange(12) / 2.0], np.random.default_rng(5), seed=4)
    off = list[float]()
    for angle, frame in zip(judged.angle, judged.displacements, strict=True):
        found = RingLocator(response, MARKERS, judged.noise).run(frame[None])
        assert found.counts[0] == 1
        off.append(abs(float(turned(found.states[0, 0, 0] - angle))))
    assert np.degrees(np.mean(off)) < 0.44


def test_truth_that_cannot_be_is_refused() -> None:
    """Shear of several times the force or against the skin, depth in m, and frames beside the truth of others."""
    before, made = calibrated()
    wrong = {"friction allows at most": {"shear": 8.0 * made.shear}, "sign is reversed": {"shear": -made.shear}}
    for what, one in {**wrong, "times as far": {"depth": 1e-3 * made.depth}}.items():
        with pytest.raises(InputError, match=f"{what}.*Write"):
            fit_response(replace(made, **one))
    with pytest.raises(InputError, match=r"do not move as angle, depth and force state.*Check"):
        fit_response(replace(made, displacements=np.roll(made.displacements, 1, axis=0)), before)


def test_errors_on_presses_left_out_are_those_that_were_expected() -> None:
    """Of 144 presses: the rms to 6 % by chance, and some for their common model."""
    angle, unsure, force, doubtful = calibrated()[0].left_out
    assert 0.6 < angle / unsure < 1.6
    assert 0.6 < force / doubtful < 1.6


def test_presses_that_say_too_little_are_refused() -> None:
    _, made = calibrated()
    with pytest.raises(InputError, match=r"truth: .*too few"):
        fit_response(made.picked(np.arange(len(made)) < 3))
    with pytest.raises(InputError, match=r"has no press.*Press"):
        fit_response(made.picked(made.angle < 3.0))


def test_a_response_of_another_shape_is_refused() -> None:
    response = calibrated()[0]
    with pytest.raises(InputError, match="odd"):
        replace(response, coefficients=np.zeros((3, 2, 4, 3)))
    with pytest.raises(InputError, match="width"):
        replace(response, width=np.array([1.0, 0.0]))
    for wrong in ([1.0, 0.1, 0.2], [-0.1, 0.1, 0.2], [0.1, 0.0, 0.2], [0.1, 0.3, 0.2], [0.1, 0.1, np.inf]):
        with pytest.raises(InputError, match="dragged"):
            replace(response, dragged=np.array(wrong))
