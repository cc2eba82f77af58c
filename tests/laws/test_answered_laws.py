"""Laws of existence, number and continuity: a wrench that presses on a closed body has a contact, and it slides."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from claims.evidence.laws import largest_steps
from palpate.contact import Locator
from palpate.surfaces import Mesh
from palpate_lab.simulation import EllipsoidBody
from tests.support.bodies import BODIES, CLOSED, R, box, on_mesh, pressing

SIZES = (0.0, 1e-9, 1e-3, 0.05, 0.3, 1.0, 3.0, 100.0)  # of the pitch, over R
STEPS = [*np.eye(3), *-np.eye(3), (0, 1, 1), (1, 0, -1), (-1, 1, 1), (3, -1, 2)]


@functools.cache
def locator(name: str) -> Locator:
    return Locator(BODIES[name].mesh, friction=2.0, torsion=1e3)


@st.composite
def aims(draw: st.DrawFn, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """A place on the mesh (inside a facet, on an edge, at a vertex) and the facet's own normals there, mixed."""
    facet = draw(st.integers(0, len(mesh.faces) - 1))
    weights = draw(st.sampled_from([(1, 0, 0), (0, 1, 0), (0.5, 0.5, 0), (0, 0.25, 0.75), (0.2, 0.3, 0.5)]))
    point = weights @ mesh.vertices[mesh.faces[facet]]
    normal = weights @ mesh.corner_normals[facet]
    return point, normal / np.linalg.norm(normal)


@pytest.mark.parametrize("name", CLOSED)
@settings(max_examples=60)
@given(data=st.data())
def test_a_wrench_that_a_contact_made_has_a_candidate_there(name: str, data: st.DataObject) -> None:
    """Also along axes and edges, at edges and vertices hit exactly, without pitch and with a huge one.

    In 1e-9 of the body, but where the torsion is so large that rounding of the torque alone moves the point further.
    """
    mesh = BODIES[name].mesh
    point, normal = data.draw(aims(mesh))
    force = -normal + 0.5 * np.array(data.draw(st.sampled_from(STEPS)), dtype=float) / np.sqrt(14)
    step = np.array(data.draw(st.sampled_from(STEPS)), dtype=float)
    if data.draw(st.booleans()) and step @ normal < -0.3 * np.linalg.norm(step):
        force = step  # exactly along an axis or a diagonal: in the plane of other facets, along edges
    pitch = R * data.draw(st.sampled_from(SIZES)) * data.draw(st.sampled_from([-1, 1]))
    found = locator(name).candidates(pressing(point, normal, force, pitch))
    assert len(found.point) > 0
    apart = np.linalg.norm(found.point - point, axis=1).min()
    assert apart < 1e-9 * mesh.size * max(1.0, abs(pitch) / R)


@pytest.mark.parametrize("name", CLOSED)
def test_a_line_into_a_closed_body_is_answered_whatever_the_pitch(name: str) -> None:
    """What goes in must press somewhere: from one side of the tree's every crack to the other nothing is lost."""
    mesh, rng = BODIES[name].mesh, np.random.default_rng(0)
    inside = mesh.centre * 0.98 + 0.02 * on_mesh(mesh, 80, rng)[0]
    if name == "L":
        inside = inside - np.array([0.3 * R, 0.3 * R, 0])  # the middle of its box is its inner edge
    for pitch in (0.0, 1e-6 * R, 0.05 * R, 0.3 * R, R, 3 * R):
        for point in inside:
            force = rng.normal(size=3)
            wrench = np.concatenate([force, np.cross(point, force) + pitch * force])
            assert len(locator(name).candidates(wrench).point) > 0


@pytest.mark.parametrize("name", [name for name in CLOSED if not name.startswith("faceted")])
def test_a_pitched_wrench_has_an_odd_number_of_contacts_on_a_closed_body(name: str) -> None:
    """Wherever it passes; an even number is a lost or a doubled contact.

    The shift grows without bound towards the silhouette, so the pressed side, shifted, covers the plane across the
    force with degree one. Not told at saddle corners of facets: their cone of normals is folded, and what lies on two
    of its sheets is one candidate.
    """
    mesh, rng = BODIES[name].mesh, np.random.default_rng(1)
    for pitch in (0.1 * R, 0.3 * R, R):
        for _ in range(150):
            force, beside = rng.normal(size=3), mesh.centre + rng.normal(size=3) * R
            wrench = np.concatenate([force, np.cross(beside, force) + pitch * force])
            count = len(locator(name).candidates(wrench).point)
            assert count % 2 == 1 or count >= 16  # beyond the sixteen that are kept it cannot be told


@pytest.mark.parametrize("name", [name for name, row in BODIES.items() if row.convex and name != "cylinder"])
def test_a_convex_body_has_exactly_one(name: str) -> None:
    """1 + h^2 K/cos^4(theta) keeps its sign where K >= 0: no folds, one contact.

    A mesh with interpolated normals is convex but for its chord error, which counts near the silhouette, and all along
    the cylinder's rims, where the normals of the sides are not across the chord.
    """
    mesh, rng = BODIES[name].mesh, np.random.default_rng(2)
    for pitch in (0.05 * R, 0.3 * R):
        for _ in range(200):
            force = rng.normal(size=3)
            point = mesh.centre + 0.2 * R * rng.normal(size=3)
            wrench = np.concatenate([force, np.cross(point, force) + pitch * force])
            found = locator(name).candidates(wrench)
            assert np.sum(found.friction < 2.0) <= 1
            if mesh.crease == 0.0 or name == "box":
                assert len(found.point) == 1


def test_on_a_smooth_body_the_answer_slides_without_a_jump() -> None:
    """Ten times smaller steps of the finger make the answer's largest step ten times smaller; a jump would stay.

    Here without a pitch; with one, and at creases, `laws` of claims/evidence has it.
    """
    body = EllipsoidBody((R, 0.7 * R, 0.5 * R))
    mesh = Mesh.from_arrays(*body.mesh(1280))
    for step in (10e-6, 1e-6):
        assert largest_steps(body, mesh, 2000, step, 0.0) < 2.0


@pytest.mark.parametrize("pitch", [1e-3, -2e-3])
def test_both_ends_of_the_jump_are_candidates_where_a_crease_is_hit_exactly(pitch: float) -> None:
    mesh = Mesh.from_arrays(*box((2 * R, 1.4 * R, 4 * R)))  # tall: the jump stays on the edge
    one, two = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    corner, force = np.array([R, 0.7 * R, 0.1 * R]), np.array([-2.0, -1.5, 0.4])
    f = force / np.linalg.norm(force)
    jump = -pitch * np.cross(one, two) / ((f @ one) * (f @ two))
    exact = Locator(mesh, friction=5.0, torsion=1.0).candidates(pressing(corner, one, force, pitch)).point
    for end in (corner, corner + jump):
        assert np.linalg.norm(exact - end, axis=1).min() < 1e-9 * R
