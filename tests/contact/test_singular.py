"""Where the equations have no solution or many: forces in the plane, none, tiny and huge ones, at edges and corners.

tau = F . M/(F . n) has no value where F . n = 0. Whatever the wrench, there is an answer, and what it says is so.
"""

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.contact import Locator, Status
from palpate.surfaces import Cylinder, Surface
from tests.support.bodies import BODIES, R

PRESSING = (1.0, 1e-2, 1e-6, 1e-12, 1e-15, 0.0, -1e-15, -1e-6, -1.0)  # -F . n/|F|
FORCES = (1.0, 5.0, 1e-9, 1e-100, 1e8)  # N
WEIGHTS = [(1, 0, 0), (0.5, 0.5, 0), (0, 0.25, 0.75), (0.2, 0.3, 0.5)]
NAMES = ("box", "L", "cylinder", "plane", "open patch", "equation")


@functools.cache
def surface(name: str) -> Surface:
    return Cylinder(R, 2 * R) if name == "equation" else BODIES[name].mesh


@functools.cache
def locator(name: str, method: str) -> Locator:
    return Locator(surface(name), method, friction=1.0, noise=np.array([0.02] * 3 + [5e-4] * 3), on=0.0, off=0.0)


@functools.cache
def facets(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners (f, 3, 3) and normals (f, 3), as plain arrays: nothing of Palpate runs while examples are drawn."""
    mesh = surface(name).drawn()
    return mesh.vertices[mesh.faces], mesh.normals


@st.composite
def grazing(draw: st.DrawFn, places: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """A wrench at a place inside a facet, on an edge or at a corner, more or less along one of the facets there."""
    facet = draw(st.integers(0, len(places) - 1))
    corners, normal = places[facet], normals[facet]
    point = np.array(draw(st.sampled_from(WEIGHTS))) @ corners
    along = corners[1] - corners[0]  # exactly along an edge, or turned out of it
    along = along / np.linalg.norm(along)
    turn = draw(st.sampled_from([0.0, 1e-9, 0.5, np.pi / 2]))
    along = np.cos(turn) * along + np.sin(turn) * np.cross(normal, along)
    press = draw(st.sampled_from(PRESSING))
    force = draw(st.sampled_from(FORCES)) * (np.sqrt(1 - press * press) * along - press * normal)
    twist = draw(st.sampled_from([0.0, 1e-12, 1e-3, 1.0])) * R * np.linalg.norm(force)
    return np.concatenate([force, np.cross(point, force) + twist * normal])


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_a_grazing_force_gets_an_answer_that_is_so(name: str, method: str, data: st.DataObject) -> None:
    """An answer lies on the surface, presses, keeps the bounds, and with its torque makes the wrench again.

    To 1e-6 of the body: of a force that presses by a millionth, rounding moves the point by a million times as much.
    """
    wrench = data.draw(grazing(*facets(name)))
    force, moment = wrench[:3], wrench[3:]
    size = np.linalg.norm(force)
    found = locator(name, method).run(wrench, sequential=False)
    assert found.status in (*Status.__members__.values(),)
    assert np.array_equal(found.force, force)
    if not found.answered:
        assert found.candidates == 0
        return
    assert found.candidates >= 1
    body = surface(name)
    off = body.project(found.point[None])[0] - found.point
    assert np.linalg.norm(off) < 1e-8 * body.size  # a place may lie so far outside its facet, by its sides
    assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-12)
    if found.residual > 0 or not (locator(name, method).candidates(wrench).point == found.point).all(axis=1).any():
        return  # within its noise of the bounds, or of an edge
    pressing = -(force @ found.normal) / size
    assert pressing > np.cos(np.arctan(1.0)) - 1e-9
    assert abs(found.torque) <= 5e-3 * pressing * size * (1 + 1e-9)
    left = moment - np.cross(found.point, force) - found.torque * found.normal
    if method == "soft_finger":
        assert np.linalg.norm(left) < 1e-8 * size * (body.size + np.linalg.norm(body.centre))
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize("name", NAMES)
@given(moment=st.lists(st.sampled_from([0.0, -0.0, 1e-300, 1e-3, 1e9]), min_size=3, max_size=3))
def test_without_a_force_there_is_no_contact(name: str, moment: list[float]) -> None:
    found = locator(name, "soft_finger").run([0.0, -0.0, 0.0, *moment])
    assert found.status == Status.NO_CONTACT
    assert np.isnan(found.point).all()
    assert len(locator(name, "soft_finger").candidates([0.0, 0.0, 0.0, *moment]).point) == 0
