"""Surfaces that a user writes down: slips are found when the surface is made, and said."""

import numpy as np
import pytest

from palpate.contact import Locator
from palpate.errors import GeometryError, InputError
from palpate.surfaces import ImplicitSurface
from tests.support.equations import EQUATIONS

R = 0.01
LOW, HIGH = (-0.012, -0.012, -0.012), (0.012, 0.012, 0.012)


def value(p):
    return p[0] ** 2 + p[1] ** 2 + p[2] ** 2 - R**2


def gradient(p):
    return 2.0 * p


def hessian(p):
    return 2.0 * np.eye(3)


def test_a_sphere_written_down_is_a_sphere() -> None:
    surface = ImplicitSurface(value, gradient, hessian, LOW, HIGH)
    answer = Locator(surface).run(np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]))
    assert np.allclose(answer.point, [[0, 0, R]], atol=1e-15)
    assert np.allclose(np.linalg.norm(surface.mesh(200).vertices, axis=1), R, atol=1e-12)


def test_it_ends_at_its_box() -> None:
    """The box cuts the sphere's top off: a press on the pole is off the surface, and the rim is nearest."""
    surface = ImplicitSurface(value, gradient, hessian, LOW, (0.012, 0.012, 0.8 * R))
    answer = Locator(surface).run(np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    assert answer.answered.tolist() == [False, True]
    assert answer.point[0, 2] == pytest.approx(0.8 * R, abs=1e-12)
    assert np.linalg.norm(answer.point[0]) == pytest.approx(R, abs=1e-12)


def test_a_wrong_derivative_is_found() -> None:
    with pytest.raises(GeometryError, match="gradient"):
        ImplicitSurface(value, lambda p: p, hessian, LOW, HIGH)
    with pytest.raises(GeometryError, match="Hessian"):
        ImplicitSurface(value, gradient, lambda p: np.eye(3), LOW, HIGH)


def test_a_box_without_surface_is_refused() -> None:
    with pytest.raises(GeometryError, match="is zero nowhere in its box"):
        ImplicitSurface(value, gradient, hessian, (0.02, 0.02, 0.02), (0.03, 0.03, 0.03))
    with pytest.raises(GeometryError, match="must be finite, with low below high"):
        ImplicitSurface(value, gradient, hessian, HIGH, LOW)


def test_what_cannot_be_compiled_is_said() -> None:
    with pytest.raises(InputError, match=r"cannot be compiled.*Write"):
        ImplicitSurface(lambda p: open("x"), gradient, hessian, LOW, HIGH)  # noqa: SIM115 - it must not compile


def test_a_shape_that_hides_from_its_middle_is_not_drawn() -> None:
    with pytest.raises(GeometryError, match="drawn"):
        EQUATIONS["torus"].surface.drawn()
