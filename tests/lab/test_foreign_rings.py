"""Rings of other mechanics: what contact and friction demand, and closed forms, are met."""

import numpy as np
import pytest

from palpate_lab.simulation import _foreign_rings
from palpate_lab.simulation.foreign_rings import FOREIGN, OUTER, Pressing


@pytest.mark.parametrize("name", FOREIGN)
def test_contact_and_friction_are_as_their_laws_demand(name: str) -> None:
    """Nothing pulls, nothing overlaps, friction stays in its cone, and the skin moves as its compliance has it."""
    compliance, friction, local = FOREIGN[name](1).outside, 0.4, 1e-6
    near = np.arange(100, 140)
    both = np.stack([2 * near, 2 * near + 1], axis=1).ravel()
    angles, around = 2.0 * np.pi * near / 720, np.ascontiguousarray(compliance[np.ix_(both, both)])
    body = np.array([2.0 * np.pi * 120 / 720, 0.005, 0.01, 0.005])
    normal, loads, moved = np.empty((3, len(near), 2))
    ways = np.array([[0.5, 0.0], [1.0, 0.0], [1.0, 1.0]])
    law = np.array([friction, local, OUTER])
    _foreign_rings.press(around, angles, np.tile(body, (len(near), 1)), ways, law, normal, loads, moved)
    force = loads[:, :1] * normal + loads[:, 1:] * np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    np.testing.assert_allclose(moved.ravel(), around @ force.ravel(), atol=1e-12)
    turn = np.exp(1j * angles)
    middle = (OUTER + 0.01 - 0.005 + 0.005j) * np.exp(1j * body[0])
    gap = np.abs((OUTER + moved @ (1.0, 1j)) * turn - middle) - 0.01
    assert loads[:, 0].min() == 0.0 < loads[:, 0].max()
    assert (gap + local * loads[:, 0]).min() > -1e-7
    assert np.abs((gap + local * loads[:, 0]) * loads[:, 0]).max() < 1e-7
    assert (np.abs(loads[:, 1]) <= friction * loads[:, 0] + 1e-12).all()
    assert loads[:, 1].sum() / loads[:, 0].sum() > 0.9 * friction  # dragged by 5 mm, nearly all of it slides


@pytest.mark.parametrize("name", FOREIGN)
def test_a_ring_answers_either_force_as_the_other(name: str) -> None:
    """Maxwell and Betti; and a plate without friction has neither shear nor, on average, a turned centre."""
    ring = FOREIGN[name](2)
    np.testing.assert_allclose(ring.outside, ring.outside.T, atol=1e-6 * np.abs(ring.outside).max())
    found = [ring.press([Pressing(angle, 0.004, np.inf)], 0.0) for angle in np.arange(8) * np.pi / 4]
    assert np.mean([each.shear[0] for each in found]) == pytest.approx(0.0, abs=0.01)
    assert all(each.force[0] > 0.3 for each in found)


def test_an_even_elastic_ring_under_even_pressure_is_a_spring() -> None:
    """Forces p outwards on all nodes: w = p / (E A / R + k R) per angle, by the ring's own uneven springs to 5 %."""
    ring = FOREIGN["elastic ring"](3)
    moved = ring.outside.reshape(720, 2, 720, 2)[:, 0, :, 0].sum(axis=1)
    radius, thick = 0.5 * (OUTER + ring.inner), OUTER - ring.inner
    expected = 720 / (2.0 * np.pi) / (1.5e6 * 0.03 * thick / radius + 6.6e3 * radius)
    assert moved.mean() == pytest.approx(expected, rel=0.12)  # stiffnesses of a unit differ by 5 %
