"""A torsion beyond the bound is said with how far a patch that makes it reaches; true for patches of known size."""

from dataclasses import replace

import numpy as np
import pytest

import palpate
from palpate.contact.contacts import Contacts
from palpate.contact.plausibility import RequiredBounds

RADIUS, FRICTION, PUSH = 0.015, 0.6, 4.0  # m, of the patch, N
MIDDLE = np.array([0.004, -0.003, 0.0])


def _turned(radii: np.ndarray, share: float) -> np.ndarray:
    """(6,) of rings [m] pressed evenly on z = 0 about MIDDLE, each place at a share of its friction, all one way."""
    turn = np.arange(60) * np.pi / 30
    out = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    arms = (radii[:, None, None] * out).reshape(-1, 3)
    weight = np.repeat(radii, len(turn)) / np.repeat(radii, len(turn)).sum()  # rings of equal width
    ways = np.cross([0.0, 0.0, 1.0], np.tile(out, (len(radii), 1)))
    forces = PUSH * weight[:, None] * (share * FRICTION * ways - [0.0, 0.0, 1.0])
    return np.concatenate([forces.sum(axis=0), np.cross(MIDDLE + arms, forces).sum(axis=0)])


def _asked(wrench: np.ndarray) -> tuple[RequiredBounds, Contacts]:
    mesh = palpate.Mesh.from_arrays(
        np.array([[-0.05, -0.05, 0.0], [0.05, -0.05, 0.0], [0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    found = palpate.Locator(mesh, friction=FRICTION, torsion=5e-3).run(np.tile(wrench, (5, 1)))
    contacts = Contacts.single(np.arange(5.0), found)
    return RequiredBounds.of(contacts, (FRICTION, 5e-3)), contacts


@pytest.mark.parametrize(
    ("radii", "share"),
    [(np.array([RADIUS]), 1.0), ((np.arange(200) + 0.5) / 200 * RADIUS, 2 / 3)],
    ids=["ring", "disc"],
)
def test_reach_of_a_patch_that_slips_all_round(radii: np.ndarray, share: float) -> None:
    asked, contacts = _asked(_turned(radii, 1.0))
    assert contacts.point == pytest.approx(np.tile(MIDDLE, (5, 1)), abs=1e-12)  # the pressure's centre
    reach = asked.reach(float(np.median(asked.torsion)))
    assert reach == pytest.approx(share * RADIUS, rel=1e-4)  # 200 rings for the disc's integral
    assert f"extends {1e3 * share * RADIUS:.3g} mm or more" in asked.exceeded
    assert "extends" in asked.proposal


def test_nothing_is_said_of_a_patch_where_a_point_would_do() -> None:
    asked, contacts = _asked(_turned(np.array([RADIUS]), 0.5))
    assert contacts.answered.all()
    assert asked.exceeded == ""
    assert "extends" not in asked.proposal


def test_forces_along_the_surface_have_no_bounds() -> None:
    _, contacts = _asked(_turned(np.array([RADIUS]), 0.5))
    along = replace(contacts.estimate, force=np.tile([1.0, 0.0, 0.0], (5, 1)), torque=np.zeros(5))
    asked = RequiredBounds.of(replace(contacts, estimate=along), (FRICTION, 5e-3))
    assert "no bounds that a real contact can have" in asked.proposal
