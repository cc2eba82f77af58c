"""Contacts from the markers of a ring, against a barrel's mechanics that the response was learned from elsewhere."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.errors import InputError
from palpate.optical.markers import MarkerColour
from palpate.optical.ring_response import RingResponse, ring_basis
from palpate.sensors.marker_ring import view as views
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.files import of_marker_ring
from palpate.sensors.marker_ring.layer import RingLayer
from palpate.sensors.marker_ring.locator import RingFound, RingLocator, RingSettings, turned
from palpate.sensors.marker_ring.model import MarkerRing

pytest.importorskip("skfem")

from tests.support.dice import agree, rolled
from tests.support.drawn_markers import drawn, nominal_view
from tests.support.ring_presses import MARKERS, NOISE, barrel, calibrated, moved, presses, tip

SKIN = (0.055, 0.051)  # m, outer radius and that of the markers


@pytest.fixture(scope="module")
def response() -> RingResponse:
    return calibrated()[0]


def _located(response: RingResponse, frames: np.ndarray, **settings: float) -> RingFound:
    """Each frame alone."""
    locator = RingLocator(response, MARKERS, NOISE, RingSettings(**settings))
    found = list[RingFound]()
    for frame in frames:
        locator.reset()
        found.append(locator.run(frame[None]))
    return RingFound(
        *(np.concatenate([getattr(each, name) for each in found]) for name in ("states", "counts", "residual"))
    )


@pytest.fixture
def ring(response: RingResponse) -> MarkerRing:
    view = nominal_view()
    return MarkerRing(0.055, view, MarkerColour(), view.from_plane(view.rest), np.full(24, 150.0), 0.2, response)


def test_a_ring_s_words_are_those_of_its_calibration(ring: MarkerRing) -> None:
    pressed, words = calibrated()[1], dict(of_marker_ring(ring))
    assert words["calibrated"] == f"to {1e3 * pressed.depth.max():.3g} mm, {pressed.force.max():.3g} N; shear, too"


def test_images_are_shown_four_times_a_second_while_somebody_looks(
    ring: MarkerRing, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown, now = list[tuple[float, np.ndarray]](), 0.0
    monkeypatch.setattr(views, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(RingLayer, "feed", lambda self, frame, pixels: shown.append((now, pixels)))
    feed, slots = (
        views._Frames(RingEstimator(ring), RingLayer(ring)),
        np.zeros(2, [("values", np.uint8, (480, 640, 3))]),
    )
    slots["values"][1] = drawn(ring.rest, 7.0)
    for now in np.arange(0.0, 2.0, 0.05).tolist():
        feed(slots, now < 0.99)
    np.testing.assert_allclose([at for at, _ in shown], [0.0, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(shown[0][1], ring.rest, atol=0.5)


def test_from_pixels_is_from_their_displacements(response: RingResponse, ring: MarkerRing) -> None:
    view = ring.view
    pressed = moved(barrel().press([tip(0.3, 0.006), tip(3.0, 0.004)]), np.random.default_rng(7))
    frames = np.stack([0.0 * pressed, pressed, pressed])
    pixels = view.from_plane(view.rest + np.einsum("mak,nmk->nma", ring.axes(), frames))
    pixels[1, 3, 0] = pixels[2, :20] = np.nan
    locators = [RingLocator(response, view.angles, ring.noise()) for _ in range(2)]
    found, seen = locators[0].run_pixels(pixels, ring)
    plain = locators[1].run(ring.displacements(pixels))
    np.testing.assert_allclose(ring.displacements(pixels)[0], 0.0, atol=1e-12)
    assert seen.tolist() == [24, 23, 4]
    assert found.counts.tolist() == [0, 2, -1]
    for name in ("states", "counts", "residual"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))


def test_a_contact_without_end_and_markers_without_sense_are_named(ring: MarkerRing) -> None:
    rng, made = np.random.default_rng(7), RingEstimator(ring)
    pressed = moved(barrel().press([tip(0.3, 0.006)]), rng)
    pixels = ring.view.from_plane(ring.view.rest + np.einsum("mak,mk->ma", ring.axes(), pressed))
    shaken, rows = pixels + rng.normal(0.0, 4.0, pixels.shape), made.empty(made.most)
    images = [ring.rest, pixels, pixels, shaken, ring.rest]
    for time, (seen, said) in enumerate(zip(images, ["", "", "from 1.00 s", "in 33% of", "in 33% of"], strict=True)):
        made.update_markers_into(float(time), seen, rows)
        assert said in " ".join(made.warnings())
        assert bool(said) == bool(made.warnings())


def test_a_tip_that_was_not_calibrated_is_found(response: RingResponse) -> None:
    """Between the calibration's plate and tip, from 2 mm on: 0.5 degrees, 8 % of the force, and intervals that hold."""
    rng = np.random.default_rng(5)
    bodies = [tip(at, depth, 0.025) for at in rng.uniform(0.0, 2.0 * np.pi, 12) for depth in (0.002, 0.004, 0.008)]
    made = presses(bodies, rng)
    found = _located(response, made.displacements)
    assert (found.counts == 1).all()
    off = np.degrees(np.abs(turned(found.states[:, 0, 0] - made.angle)))
    wrong = np.abs(found.states[:, 0, 1] - made.force)
    assert off.mean() < 0.5
    assert (wrong / made.force).mean() < 0.08
    assert np.mean(off <= 2.6 * np.degrees(found.states[:, 0, 4])) > 0.9  # 99 % intervals: 36 of them are few


def test_two_and_three_contacts_are_told_apart(response: RingResponse) -> None:
    rng = np.random.default_rng(6)
    for angles in ([0.3, 1.0], [2.0, 4.5], [0.1, 1.2, 3.3]):
        pressed = barrel().press([tip(at, 0.006) for at in angles])
        found = _located(response, moved(pressed, rng)[None])
        assert found.counts[0] == len(angles)
        states = found.states[0, : len(angles)]
        for angle, force in zip(pressed.angle, pressed.force, strict=True):
            nearest = int(np.argmin(np.abs(turned(states[:, 0] - angle))))
            assert np.degrees(abs(turned(states[nearest, 0] - angle))) < 2.0
            assert abs(states[nearest, 1] - force) < 0.15 * force


def test_two_tips_are_not_one_contact_wider_than_any_of_the_calibration(response: RingResponse) -> None:
    """Where the misfit is so large that no single marker shows the second: widths of the calibration do."""
    unsure = replace(response, misfit=5.0 * response.misfit, usual=response.usual * [1.0, 0.55, 1.0])
    pressed = barrel().press([tip(3.0, 0.006), tip(3.0 + np.radians(30.0), 0.006)])
    assert _located(unsure, moved(pressed, np.random.default_rng(1))[None]).counts.tolist() == [2]


def test_nothing_is_found_where_nothing_touches(response: RingResponse) -> None:
    """Of 500 frames of noise alone none shows a contact: 5.5 deviations are one in a million."""
    noise = NOISE * np.random.default_rng(7).standard_normal((500, 24, 2))
    assert not _located(response, noise).counts.any()


def test_shear_has_its_sign(response: RingResponse) -> None:
    for slide in (0.002, -0.002):
        pressed = barrel().press([tip(1.0, 0.006, slide=slide)])
        state = _located(response, moved(pressed)[None], friction=0.5).states[0, 0]
        assert np.sign(state[3]) == np.sign(pressed.shear[0])
        assert abs(state[1] * state[3] - pressed.shear[0]) < 0.4 * abs(pressed.shear[0])


def _residuals(
    response: RingResponse, frame: np.ndarray, start: np.ndarray, held: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Whose squares the kernel minimises, at angle, force, width and shear of each contact; variances as at `start`."""
    (middle, wide, _), parts = response.usual, response.misfit.shape[1]
    variance = NOISE**2
    for phi, force, _, t in start:
        where = (np.mod(MARKERS - phi, 2 * np.pi) / (2 * np.pi) * parts).astype(int) % parts
        variance = variance + (force * response.misfit[:, where].T) ** 2 * (1.0 + (response.sheared[3] * t) ** 2)

    def residual(x: np.ndarray) -> np.ndarray:
        left, prior = frame.copy(), list[float]()
        for (phi, force, z, t), (own, usual) in zip(x.reshape(-1, 4), held, strict=True):
            shapes = response.at(MARKERS - phi, np.full(24, phi))
            left -= force * shapes @ np.array([1.0, z, z * z, t])
            prior += [(z - middle) / wide, (t - own) / usual]
        return np.concatenate([(left / np.sqrt(variance)).ravel(), prior])

    return residual


def _pressed(response: RingResponse, found: np.ndarray, others: bool) -> np.ndarray:
    """Angle, force, width and shear / force of contacts (c, 4) along the axes of the skin that each of them presses.

    That skin is turned by the contact's shear and, if `others`, by its neighbours.
    """
    start = found.copy()
    for _ in range(20):
        deep = response.width[0] + response.width[1] * start[:, 2]
        along = _dents(response, start)[0] if others else np.zeros(len(start))
        carry = response.carried[0] + response.carried[1] * deep
        turn = along / (SKIN[0] - start[:, 1] * deep) + carry * start[:, 1] * start[:, 3]
        push = found[:, 1] * np.exp(1j * turn) * (1.0 - 1j * found[:, 3])
        start[:, 0], start[:, 1], start[:, 3] = found[:, 0] - turn, push.real, -push.imag / push.real
    return start


def test_the_sum_of_squares_is_at_its_least(response: RingResponse) -> None:
    """scipy, with the sum written in NumPy and begun there, finds no less: the kernel's twin."""
    frame = moved(barrel().press([tip(0.4, 0.005), tip(2.0, 0.007)]), np.random.default_rng(8))
    found = _located(response, frame[None])
    assert found.counts[0] == 2
    start = _pressed(response, found.states[0, :2, :4], others=False)
    residual = _residuals(response, frame, start, np.array([[0.0, response.usual[2]]] * 2))
    best = least_squares(residual, start.ravel())
    assert np.sum(residual(start) ** 2) - 2.0 * best.cost < 0.02  # of about 90: Hermite's table and last steps
    assert np.abs(best.x - start.ravel())[[0, 4]].max() < np.radians(0.05)


def _mixed(response: RingResponse, frame: np.ndarray, plain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of angle, force, width and shear, whose posterior is summed up over a fine grid."""
    (share, *kinds), held = response.dragged.tolist(), np.array([[0.0, response.dragged[2]]])
    jac = least_squares(_residuals(response, frame, plain[None], held), plain, max_nfev=1).jac
    covariance, usual = np.linalg.inv(jac.T @ jac), kinds[1]
    t = np.linspace(-3.0, 3.0, 60001)

    def normal(at: np.ndarray, deviation: float) -> np.ndarray:
        return np.exp(-0.5 * (at / deviation) ** 2) / deviation

    expected = (1.0 - share) * normal(t, kinds[0]) + share * normal(t, kinds[1])
    log = -0.5 * (t - plain[3]) ** 2 / covariance[3, 3] + 0.5 * (t / usual) ** 2
    density = expected * np.exp(log - log[np.abs(t) < 1.0].max())
    density /= density.sum()
    mean = (t * density).sum()
    gain = covariance[:, 3] / covariance[3, 3]
    left = ((t - mean) ** 2 * density).sum() - covariance[3, 3]
    return plain + gain * (mean - plain[3]), covariance + np.outer(gain, gain) * left


@pytest.mark.parametrize(("depth", "slide"), [(0.002, 0.0), (0.006, 0.0), (0.004, 0.001), (0.006, 0.002)])
def test_a_shear_of_two_kinds_is_told_as_its_posterior_summed_up(
    response: RingResponse, depth: float, slide: float
) -> None:
    """By quadrature of the mixture, not by formulas of normal distributions; light and heavy, plain and dragged."""
    none = {"spread": np.zeros(2), "sheared": np.zeros(4), "carried": np.zeros(2)}
    bare = replace(response, **none, dragged=np.array([0.2, 0.03, 0.35]))
    frame = moved(barrel().press([tip(0.4, depth, slide=slide)]), np.random.default_rng(8))
    wide = replace(bare, dragged=np.zeros(3), usual=np.array([*bare.usual[:2], 0.35]))
    plain = _located(wide, frame[None]).states[0, 0]
    told = _located(bare, frame[None]).states[0, 0]
    mean, covariance = _mixed(bare, frame, plain[:4])
    wide = plain[[4, 5]]
    assert (np.abs(told[:2] - mean[:2]) < 0.03 * wide).all()
    assert abs(told[3] - mean[3]) < 0.005
    _, force, z, t = told[:4]
    deep = force * np.array([0.0, (bare.width[0] + z * bare.width[1]) / force, bare.width[1], 0.0])  # depth's slope
    slopes = np.stack([*np.eye(4)[:2], deep, [0.0, t, 0.0, force]])  # and that of force times shear
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    np.testing.assert_allclose(told[[4, 5, 6, 8]], deviations, rtol=0.02)
    assert slide or abs(told[3] - plain[3]) > 0.004  # the kinds make a difference


def test_kinds_are_those_of_the_calibration_s_friction(response: RingResponse) -> None:
    """Not where another friction is stated."""
    frame, one = (
        moved(barrel().press([tip(0.3, 0.006)]), np.random.default_rng(8)),
        replace(response, dragged=np.zeros(3)),
    )
    for friction, same in ((0.1, True), (None, False)):
        pair = [
            RingLocator(each, MARKERS, NOISE, RingSettings(friction=friction), SKIN).run(frame[None]).states
            for each in (response, one)
        ]
        assert np.array_equal(*pair) == same


def test_a_dragged_contact_is_one(response: RingResponse) -> None:
    """At twice the calibration's friction: the search takes dragged contacts for usual."""
    frames = [moved(barrel().press([tip(angle, 0.005, 0.015, 0.003)], 0.8)) for angle in (0.2, 2.2, 4.2)]
    assert _located(response, np.stack(frames)).counts.tolist() == [1, 1, 1]


def _dents(response: RingResponse, states: np.ndarray) -> np.ndarray:
    """(2, c) along [m] and slope [m/rad] of the skin under each contact by the others: the sum written out."""
    skin, orders, found = response.skin(*SKIN), response.orders, np.zeros((2, len(states)))
    for c, (phi, _, _, _) in enumerate(states):
        for other, force, z, t in np.delete(states, c, axis=0):
            basis = ring_basis(np.array(phi - other), orders[0]), ring_basis(np.array(other), orders[1])
            found[:, c] += force * np.einsum("ebkm,k,m,b->e", skin, *basis, np.array([1.0, z, z * z, t]))
    return found


def test_neighbours_say_what_shear_is_to_be_expected(response: RingResponse) -> None:
    """The twin again; shears are about what the others' dents leave: tilt of the skin, 0.4 of what would stick."""
    pressed = barrel().press([tip(0.4, 0.005), tip(0.95, 0.007), tip(1.5, 0.006)])
    frame = moved(pressed, np.random.default_rng(8))
    found = RingLocator(response, MARKERS, NOISE, skin=SKIN).run(frame[None])
    assert found.counts[0] == 3
    start = _pressed(response, found.states[0, :3, :4], others=True)
    (along, slope), turn = _dents(response, start), turned(found.states[0, :3, 0] - start[:, 0])
    basis = ring_basis(np.zeros(3), response.orders[0]), ring_basis(start[:, 0], response.orders[1])
    gives = start[:, 1] * np.einsum("km,ck,cm->c", response.skin(*SKIN)[0, 3], *basis)
    assert response.grip == pytest.approx(0.4, abs=0.1)  # of the simulation, and what a dragged tip's flank adds
    most = np.clip(-along / gives, -response.grip, response.grip)
    assert np.abs(slope / SKIN[0]).max() > 0.08  # both parts are seen
    assert np.abs(most).max() > 0.2
    held = np.stack([slope / SKIN[0] - turn + 0.4 * most, np.full(3, response.usual[2])], axis=1)
    residual = _residuals(response, frame, start, held)
    best = least_squares(residual, start.ravel())
    assert np.sum(residual(start) ** 2) - 2.0 * best.cost < 0.02
    assert np.abs(best.x - start.ravel())[3::4].max() < 0.01


def _forces_off(response: RingResponse, *friction: float) -> np.ndarray:
    """Mean error of the forces of two tips 40 degrees apart, by the calibration's friction and by nearly none."""
    off = np.zeros((2, 6))
    for k in range(6):
        pressed = barrel().press([tip(1.0 * k, 0.006), tip(1.0 * k + np.radians(40.0), 0.005)], *friction)
        for which, stated in enumerate((None, 0.01)):
            locator = RingLocator(response, MARKERS, NOISE, RingSettings(friction=stated), SKIN)
            found = locator.run(moved(pressed)[None])
            assert found.counts[0] == 2
            off[which, k] = found.states[0, :2, 1].sum() / pressed.force.sum() - 1.0
    return off.mean(axis=1)


def test_forces_of_neighbours_are_not_biased_by_their_friction(response: RingResponse) -> None:
    """Tips 40 degrees apart pull at the skin between them: with no shear allowed, forces are told too small."""
    rubbed, free = _forces_off(response)
    assert free < -0.05
    assert abs(rubbed) < 0.02


def test_bodies_that_are_said_to_be_slippery_are_not_held(response: RingResponse) -> None:
    """Tips 40 degrees apart, without friction: what the calibration's friction would hold makes forces too large.

    Where less friction is stated, neighbours leave less shear; more than the calibration's changes nothing of it.
    """
    rubbed, free = _forces_off(response, 0.0)
    assert rubbed > 0.02
    assert abs(free) < 0.4 * rubbed
    sticky = RingLocator(response, MARKERS, NOISE, RingSettings(friction=10.0 * response.usual[2]), SKIN)
    assert sticky.grip == response.grip


def test_markers_that_are_missing_or_wrong_cost_little(response: RingResponse) -> None:
    rng = np.random.default_rng(9)
    pressed = barrel().press([tip(2.5, 0.006)])
    frame = moved(pressed, rng)
    hidden = frame.copy()
    hidden[[3, 9, 10, 20]] = np.nan
    wrong = frame.copy()
    wrong[15] += (0.004, -0.003)
    for each in (hidden, wrong):
        found = _located(response, each[None])
        assert found.counts[0] == 1
        assert np.degrees(abs(turned(found.states[0, 0, 0] - pressed.angle[0]))) < 1.0
    gone = frame.copy()
    gone[:13] = np.nan
    assert _located(response, gone[None]).counts[0] == -1


def test_a_neighbour_s_dent_carries_the_skin_along(response: RingResponse) -> None:
    """Two tips 30 degrees apart, without noise: the centre of pressure is where the skin was carried to.

    By about 0.7 degrees, which a response to single contacts does not know; with it the error is less than half.
    """
    off = np.zeros((2, 2, 8))
    for k in range(8):
        pressed = barrel().press([tip(0.8 * k, 0.006), tip(0.8 * k + np.radians(30.0), 0.005 + 0.0002 * k)])
        for which, skin in enumerate((None, SKIN)):
            found = RingLocator(response, MARKERS, NOISE, skin=skin).run(moved(pressed)[None])
            assert found.counts[0] == 2
            angle = found.states[0, :2, 0]
            off[which, :, k] = [np.abs(turned(angle - each)).min() for each in pressed.angle]
    assert np.degrees(off[0].mean()) > 0.5
    assert off[1].mean() < 0.5 * off[0].mean()


def test_the_carried_angle_is_the_sum_written_out(response: RingResponse) -> None:
    pressed, slippery = barrel().press([tip(0.2, 0.006), tip(0.9, 0.005), tip(3.0, 0.007)]), replace(response, grip=0.0)
    plain, carried = (
        RingLocator(slippery, MARKERS, NOISE, skin=skin).run(moved(pressed)[None]).states[0, :3]
        for skin in (None, SKIN)
    )
    pressed_skin = _pressed(response, plain[:, :4], others=False)
    np.testing.assert_allclose(_pressed(response, carried[:, :4], others=True), pressed_skin, rtol=0, atol=1e-9)
    assert np.abs(plain[:, :2] - carried[:, :2]).min() > 1e-5
    np.testing.assert_array_equal(plain[:, 4:], carried[:, 4:])


def test_a_second_ring_that_sees_the_same_halves_the_variance(response: RingResponse) -> None:
    """Of twice the displacements with twice the noise and the misfit: as much told as by the first."""
    bare = replace(response, spread=np.zeros(2), sheared=np.zeros(4), dragged=np.zeros(3))
    twice = replace(
        bare,
        coefficients=np.concatenate([bare.coefficients, 2.0 * bare.coefficients], axis=1),
        misfit=np.concatenate([bare.misfit, 2.0 * bare.misfit]),
    )
    frame = moved(barrel().press([tip(0.7, 0.007)]), np.random.default_rng(11))
    one = RingLocator(bare, MARKERS, NOISE).run(frame[None])
    noise = np.concatenate([NOISE, 2.0 * NOISE])
    both = RingLocator(twice, np.tile(MARKERS, 2), noise).run(np.concatenate([frame, 2.0 * frame])[None])
    assert both.counts[0] == one.counts[0] == 1
    np.testing.assert_allclose(both.states[0, 0, :2], one.states[0, 0, :2], rtol=2e-3)  # the priors weigh half
    np.testing.assert_allclose(both.states[0, 0, 4:7], one.states[0, 0, 4:7] / np.sqrt(2.0), rtol=0.02)


def test_settings_that_mean_nothing_are_refused() -> None:
    for wrong in ({"on": 3.0, "off": 4.0}, {"apart": 0.0}, {"friction": 0.0}, {"patience": -1.0}):
        with pytest.raises(InputError, match=next(iter(wrong)) if "on" not in wrong else "off"):
            RingSettings(**wrong)


def test_a_contact_is_as_sure_as_its_angle_and_its_height() -> None:
    """At any angle: round the ring by the angle's deviation, along its axis by that of the height."""
    ring = SimpleNamespace(radius=0.03, response=SimpleNamespace(shears=True))
    for angle in (0.0, np.pi / 4, 2.0, -2.5):
        state = [angle, 3.0, 0.2, 0.1, 0.05, 0.2, 1e-4, 0.1, 0.02]
        row = RingEstimator._row(
            SimpleNamespace(ring=ring), state, (np.cos(angle), np.sin(angle), 1e-3, 2e-3), 0.5, 9.0
        )

        def place(off: np.ndarray, angle: float = angle) -> np.ndarray:
            return np.array([0.03 * np.cos(angle + off[0]), 0.03 * np.sin(angle + off[0]), off[1]])

        np.testing.assert_allclose(row[:3], place(np.zeros(2)))
        agree(np.reshape(row[10:19], (3, 3)), rolled(place, np.diag([0.05, 2e-3]) ** 2))
        across = np.array([-np.sin(angle), np.cos(angle), 0.0])
        np.testing.assert_allclose(row[6:9], -3.0 * np.array(row[3:6]) + 0.3 * across)
