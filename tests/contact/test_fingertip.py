"""Voltages to contacts in one step, against closed forms, differences and the general locator."""

from __future__ import annotations

import numpy as np
import pytest

from palpate import ContactEstimate, Locator, Status
from palpate.contact.fingertip import Fingertip
from palpate.errors import InputError
from palpate.sensors.load_cell_zero import Zero
from palpate.sensors.load_cells import Indentation, LoadCells, with_changes
from palpate.simulation.cell_array import LAYOUTS, random_cells
from palpate.simulation.contacts import contact_wrenches
from palpate.surfaces import EllipticCylinder, Sphere

A, B, HALF = 14e-3, 5e-3, 16e-3
SURFACE = EllipticCylinder(a=A, b=B, half_length=HALF, upper=True)
ARRAY = random_cells(LAYOUTS[4], np.random.default_rng(1))
NOISE = 1e-4  # V
CELLS = LoadCells(ARRAY.forward(), np.full(12, NOISE))


def tip(cells: LoadCells = CELLS, **options: object) -> Fingertip:
    made = Fingertip(cells, SURFACE, **{"on": 0.0, "off": 0.0, **options})  # pyright: ignore[reportArgumentType] - any
    made.set_zero(Zero(np.zeros(12)))
    return made


def touches(count: int = 2000, torque: float = 5e-3) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals, forces within a friction cone of 0.8, torques about the normal."""
    rng = np.random.default_rng(3)
    turn, y = rng.uniform(-1.3, 1.3, count), rng.uniform(-HALF, HALF, count)
    point = np.stack([A * np.sin(turn), y, B * np.cos(turn)], axis=1)
    normal = point * [A**-2, 0.0, B**-2]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = rng.normal(size=(count, 3))
    side -= np.sum(side * normal, axis=1, keepdims=True) * normal
    side *= 0.8 * rng.uniform(size=(count, 1)) / np.linalg.norm(side, axis=1, keepdims=True)
    return point, normal, rng.uniform(0.5, 5.0, (count, 1)) * (side - normal), rng.uniform(-torque, torque, count)


def read(wrench: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(ARRAY.voltages(wrench))


def test_a_wrench_made_at_a_point_is_located_there() -> None:
    point, normal, force, torque = touches()
    found = tip(torsion=np.inf).run(read(contact_wrenches(point, normal, force, torque)))
    assert np.all(found.status == Status.CONTACT)
    np.testing.assert_allclose(found.point, point, atol=1e-12)  # rounding, of some millimetres
    np.testing.assert_allclose(found.normal, normal, atol=1e-9)
    np.testing.assert_allclose(found.force, force, atol=1e-11)
    np.testing.assert_allclose(found.torque, torque, atol=1e-13)


def test_it_agrees_with_the_general_locator() -> None:
    point, normal, force, torque = touches(200)
    wrench = contact_wrenches(point, normal, force, torque)
    _, spread, _ = CELLS.inverse()
    general = Locator(SURFACE, noise=spread, torsion=np.inf, on=0.0, off=0.0).run(wrench, sequential=False)
    found = tip(torsion=np.inf).run(read(wrench))
    np.testing.assert_allclose(found.point, general.point, atol=1e-9)
    np.testing.assert_allclose(found.covariance, general.covariance, rtol=1e-6, atol=1e-16)


@pytest.mark.parametrize("law", [None, Indentation(3e-4, 0.5), Indentation(4e-4, 0.7)])
def test_a_force_that_acts_below_the_surface_is_located_above(law: Indentation | None) -> None:
    point, normal, force, torque = touches()
    depth = 0.0 if law is None else law(np.sum(force * normal, axis=1))[:, None]
    wrench = contact_wrenches(point - depth * normal, normal, force, torque)
    found = tip(with_changes(CELLS, indentation=law), torsion=np.inf).run(read(wrench))
    np.testing.assert_allclose(found.point, point, atol=1e-10)  # Newton's last step is below 1e-9 of the size


@pytest.mark.parametrize("law", [None, Indentation(3e-4, 0.5)])
def test_slopes_are_those_of_differences(law: Indentation | None) -> None:
    fingertip = tip(with_changes(CELLS, indentation=law), torsion=np.inf)
    point, normal, force, torque = touches(20)
    for wrench in contact_wrenches(point, normal, force, torque):
        row, slopes = fingertip.empty(), np.zeros((2, 6))
        spread, doubts = np.zeros((1, 6, 6)), np.zeros((36, 0))
        fingertip._single(wrench.copy(), spread, doubts, fingertip._settings, row, slopes)
        along = np.array([[row[5], 0.0, -row[3]], [0.0, 1.0, 0.0]])
        for k, step in enumerate([1e-6] * 3 + [1e-8] * 3):
            ends = [fingertip.empty(), fingertip.empty()]
            for end, sign in zip(ends, (1, -1), strict=True):
                moved = wrench + sign * step * np.eye(6)[k]
                fingertip._single(moved, spread, doubts, fingertip._settings, end, np.zeros((2, 6)))
            np.testing.assert_allclose(
                slopes[:, k], along @ (ends[0][:3] - ends[1][:3]) / (2 * step), rtol=1e-4, atol=1e-6
            )


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
def test_the_ellipse_holds_the_truth(method: str) -> None:
    rng = np.random.default_rng(5)
    point, normal, force, torque = touches(4000, torque=0.0)
    doubt = (
        3e-4
        * rng.normal(size=(36, 36))
        / 6
        * np.outer([1, 1, 1, 0.01, 0.01, 0.01], [1, 1, 1, 100, 100, 100]).reshape(36, 1)
    )
    cells = with_changes(CELLS, covariance=doubt @ doubt.T)
    wrench = contact_wrenches(point, normal, force, torque)
    errors = (rng.normal(size=(len(wrench), 36)) @ doubt.T).reshape(-1, 6, 6)
    truth = wrench + np.einsum("nij,nj->ni", errors, wrench)
    found = tip(cells, method=method, torsion=np.inf, friction=np.inf).run(
        read(truth) + NOISE * rng.normal(size=(len(wrench), 12))
    )
    good = found.status == Status.CONTACT
    assert good.mean() > 0.98  # a few lie near an end
    values, vectors = np.linalg.eigh(found.covariance[good])
    off = np.einsum("nij,ni->nj", vectors, (found.point - point)[good])
    share = np.mean(np.sum(off[:, 1:] ** 2 / values[:, 1:], axis=1) <= 5.991)
    assert 0.93 < share < 0.97


def test_a_force_alone_is_located_more_surely() -> None:
    point, normal, force, torque = touches(2000, torque=0.0)
    volts = read(contact_wrenches(point, normal, force, torque))
    volts += NOISE * np.random.default_rng(7).normal(size=volts.shape)
    soft, pure = tip(torsion=np.inf).run(volts), tip(method="wrench_axis").run(volts)
    assert np.abs(pure.torque).max() < 1e-9
    trace = [np.einsum("nii->n", found.covariance) for found in (soft, pure)]
    assert np.nanmax(trace[1] / trace[0]) <= 1 + 1e-9
    errors = [np.nanmean(np.sum((found.point - point) ** 2, axis=1)) for found in (soft, pure)]
    assert errors[1] < errors[0]


def test_blocks_and_single_samples_are_the_same_to_the_last_bit() -> None:
    point, normal, force, torque = touches(300)
    volts = read(contact_wrenches(point, normal, force, torque)) + NOISE * np.random.default_rng(9).normal(
        size=(300, 12)
    )
    volts[100:200, 3:6] = 0.0  # a dead cell on the way
    whole, parts, single = tip().empty(300), tip().empty(300), tip().empty(300)
    tip().run_into(whole, volts)
    cut, one = tip(), tip()
    for begin in range(0, 300, 37):
        cut.run_into(parts[begin : begin + 37], volts[begin : begin + 37])
    for k in range(300):
        one(volts[k], single[k])
    np.testing.assert_array_equal(whole, parts)
    np.testing.assert_array_equal(whole, single)


def test_a_dead_cell_is_left_out_from_its_first_sample_on() -> None:
    point, normal, force, torque = touches(500)
    volts = read(contact_wrenches(point, normal, force, torque))
    volts[250:, 6:9] = 0.0
    rows, which = tip(torsion=np.inf).run_into(Fingertip.empty(500), volts)
    assert np.all(which[:250] == 0)
    assert np.all(which[250:] == 3)
    np.testing.assert_allclose(rows[:, :3], point, atol=1e-10)


def test_what_cannot_be_located_says_so() -> None:
    volts = np.zeros((6, 12))
    up, aside = np.array([0.0, 0.0, 1.0, 0, 0, 0]), np.array([0.0, 0.0, -1.0, 0.1, 0.0, 0.0])
    volts[0] = read(up)  # pulls
    volts[1] = read(aside)  # its line passes 100 mm off
    volts[2] = np.nan
    volts[3] = read(-up)
    volts[3, [0, 4]] = 3.0  # two cells at their range
    volts[4] = read(-0.01 * up)
    limited = with_changes(CELLS, limits=np.tile([-2.5, 2.5], (12, 1)))
    found = tip(limited, on=0.1, off=0.02).run(volts)
    wanted = ["off_surface", "off_surface", "invalid", "saturated", "no_contact", "no_contact"]
    assert [Status(status).label for status in found.status] == wanted


def test_one_cell_at_its_range_is_left_out() -> None:
    volts = read(np.array([[0.0, 0.0, -1.0, 0.002, 0.001, 0.0]]))
    largest = np.abs(volts).reshape(4, 3).max(axis=1)
    second, first = np.sort(largest)[-2:]
    limit = (first + second) / 2
    limited = with_changes(CELLS, limits=np.tile([-limit, limit], (12, 1)))
    rows, which = tip(limited).run_into(Fingertip.empty(1), np.clip(volts, -limit, limit))
    assert which[0] == 1 + largest.argmax()
    np.testing.assert_allclose(rows[0, :3], tip().run(volts).point[0], atol=1e-10)


def test_too_light_for_the_accuracy_and_the_smallest_force() -> None:
    point, normal = np.array([0.0, 0.0, B]), np.array([0.0, 0.0, 1.0])
    fingertip = tip(accuracy=1e-3)
    least = fingertip.smallest_force(point, -normal, 1e-3)
    for share, status in ((0.99, Status.TOO_LIGHT), (1.01, Status.CONTACT)):
        wrench = contact_wrenches(point[None], normal[None], -share * least * normal[None], np.zeros(1))
        assert fingertip.run(read(wrench)).status[0] == status
    assert fingertip.smallest_force(point, -normal, 5e-4) == pytest.approx(2 * least)  # noise errs as 1/F
    unsure = tip(with_changes(CELLS, covariance=np.eye(36)))
    assert unsure.smallest_force(point, -normal, 1e-3) == np.inf


def test_the_zero_is_taken_and_counts() -> None:
    rng = np.random.default_rng(11)
    fingertip = tip()
    volts = 0.02 + NOISE * rng.normal(size=(500, 12))
    said = fingertip.tare(volts)
    assert "500 samples" in said.said
    wrench = contact_wrenches(
        np.array([[0.0, 0.0, B]]), np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]]), np.zeros(1)
    )
    found: ContactEstimate = fingertip.run(read(wrench) + 0.02)
    assert np.linalg.norm(found.point - [0.0, 0.0, B]) < 1e-4
    assert found.covariance[0, 0, 0] > tip().run(read(wrench)).covariance[0, 0, 0]


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(InputError, match="elliptic cylinder"):
        Fingertip(CELLS, Sphere(radius=0.01))
    with pytest.raises(InputError, match="unknown method"):
        tip(method="guess")
    with pytest.raises(InputError, match="accuracy"):
        tip(accuracy=-1.0)
    with pytest.raises(InputError, match="thresholds"):
        tip(on=0.1, off=0.2)
