"""A soft layer on any surface: M' = M + d n x F, in closed form, by differences, and rigid at depth 0."""

import numpy as np
import pytest

from palpate import Locator, Surface
from palpate.contact.indentation import Indentation
from palpate.errors import InputError
from palpate.surfaces import EllipticCylinder, Sphere
from palpate_lab.simulation.contacts import contact_wrenches
from tests.support.bodies import BODIES

R = 0.02
LAW = Indentation(6e-4, 0.5)
NOISE = np.diag(np.array([0.01] * 3 + [1e-4] * 3) ** 2)
TUBE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3)


def on_sphere(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, and forces within a friction cone of 0.6, with torques about the normal."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.cross(normal, rng.normal(size=(count, 3)))
    side *= 0.6 * rng.uniform(size=(count, 1)) / np.linalg.norm(side, axis=1, keepdims=True)
    return normal, rng.uniform(1.0, 5.0, (count, 1)) * (side - normal), rng.uniform(-1e-3, 1e-3, count)


@pytest.mark.parametrize("body", ["sphere", "mesh"])
def test_a_force_below_a_sphere_is_located_on_it(body: str) -> None:
    """Closed form: (R - d) n x F + tau n, d = depth |F . n|^e; a smooth mesh is off by its chord error."""
    normal, force, torque = on_sphere(300)
    depth = LAW.depth * np.abs(np.sum(force * normal, axis=1)) ** LAW.exponent
    wrench = contact_wrenches((R - depth)[:, None] * normal, normal, force, torque)
    sphere = Sphere(radius=R)
    surface: Surface = sphere if body == "sphere" else sphere.drawn()
    found = Locator(surface, torsion=1.0, indentation=LAW).run(wrench, sequential=False)
    assert found.answered.all()
    assert np.linalg.norm(found.point - R * normal, axis=1).max() < (1e-9 if body == "sphere" else 0.02 * R)
    rigid = Locator(surface, torsion=1.0).run(wrench, sequential=False)
    if body == "sphere":
        assert np.linalg.norm(rigid.point - R * normal, axis=1).max() > 1e-4  # it matters


@pytest.mark.parametrize("method", ["soft_finger", "wrench_axis"])
@pytest.mark.parametrize("surface", [Sphere(radius=R), TUBE], ids=["sphere", "tube"])
def test_the_covariance_is_that_of_differences(surface: Surface, method: str) -> None:
    """dp/dW by central differences: steps of 1e-6 N and 1e-8 N m are good to 1e-6 of it."""
    locator = Locator(surface, method, friction=2.0, torsion=1.0, noise=NOISE, on=0.0, off=0.0, indentation=LAW)
    rng = np.random.default_rng(1)
    wrenches = np.column_stack([rng.uniform(-0.5, 0.5, (20, 2)), np.full(20, -2.0), 1e-3 * rng.normal(size=(20, 3))])
    wrenches += np.cross([0.003, 0.002, 0.0], wrenches[:, :3]) @ np.eye(3, 6, 3)
    found = locator.run(wrenches, sequential=False)
    assert found.answered.all()
    steps = np.diag([1e-6] * 3 + [1e-8] * 3)
    slopes = [
        (locator.run(wrenches + step, sequential=False).point - locator.run(wrenches - step, sequential=False).point)
        / (2 * step.max())
        for step in steps
    ]
    slope = np.stack(slopes, axis=2)
    expected = slope @ NOISE @ slope.transpose(0, 2, 1)
    assert np.abs(found.covariance - expected).max() < 1e-4 * np.abs(expected).max()


def test_a_layer_of_no_depth_changes_no_bit() -> None:
    rng = np.random.default_rng(2)
    wrenches = np.column_stack([rng.normal(size=(500, 3)), 0.01 * rng.normal(size=(500, 3))])
    for surface in (BODIES["ellipsoid"].mesh, TUBE):
        bare = Locator(surface, noise=NOISE, on=0.0).run(wrenches)
        none = Locator(surface, noise=NOISE, on=0.0, indentation=Indentation(0.0, 0.5)).run(wrenches)
        for name, values in vars(bare).items():
            assert np.array_equal(values, getattr(none, name), equal_nan=True), name


def test_a_wanted_accuracy_must_be_one() -> None:
    with pytest.raises(InputError, match=r"accuracy.*Write"):
        Locator(TUBE, accuracy=-1.0)


def test_a_layer_gives_way_as_a_power_of_what_presses() -> None:
    """Its depth at 1 N, by twice that at 4 N if the exponent is a half; whichever way the force has its sign."""
    np.testing.assert_allclose(LAW(np.array([0.0, 1.0, 4.0, -4.0])), [0.0, 6e-4, 12e-4, 12e-4])
    assert LAW(np.zeros((2, 0))).shape == (2, 0)
