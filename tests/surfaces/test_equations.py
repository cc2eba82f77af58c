"""Surfaces by equations: charts of quadrics close and hold their volume; slips in what a user writes down are found."""

from collections.abc import Callable

import numpy as np
import pytest

from palpate.contact import Locator
from palpate.errors import GeometryError, InputError
from palpate.spatial.pose import Pose
from palpate.surfaces import (
    Cylinder,
    Ellipsoid,
    EllipticCylinder,
    ImplicitSurface,
    Mesh,
    Paraboloid,
    Sphere,
    superquadric,
)
from palpate.surfaces.geodesic import walk
from tests.support.equations import EQUATIONS

R = 0.01


def flux(mesh: Mesh) -> float:
    """Integral of p . n / 3: the volume, where the mesh is closed."""
    corners = mesh.vertices[mesh.faces]
    return float(np.einsum("fk,fk->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


@pytest.mark.parametrize(
    ("make", "volume"),
    [
        (lambda: Sphere(R), 4 / 3 * np.pi * R**3),
        (lambda: Ellipsoid((R, 2 * R, 0.5 * R)), 4 / 3 * np.pi * R**3),
        (lambda: superquadric((R, R, R), (1.0, 1.0)), 4 / 3 * np.pi * R**3),  # exponents of 1: the sphere
        (
            lambda: Cylinder(R, 2 * R),
            np.pi * R**2 * 4 * R * 2 / 3,
        ),  # without lids: of the flux, two thirds go out at the side
        (lambda: EllipticCylinder(R, 3 * R, R), np.pi * R * 3 * R * 2 * R * 2 / 3),
        (lambda: EllipticCylinder(R, 3 * R, R, upper=True), np.pi * R * 3 * R * 2 * R / 3),
    ],
    ids=["sphere", "ellipsoid", "superquadric", "cylinder", "elliptic", "half"],
)
def test_its_mesh_faces_out_and_holds_its_volume(make: Callable[[], Ellipsoid], volume: float) -> None:
    assert flux(make().mesh(20000)) == pytest.approx(volume, rel=2e-3)  # chords of 1/100 of a turn: (2 pi/100)^2/6


def test_paraboloid_opens_downward_from_its_apex() -> None:
    """Its outward flux about the apex, where z = -(x^2/r_x + y^2/r_y)/2: a third of (V + A height) of the cup."""
    bowl = Paraboloid((R, 2 * R), R)
    volume, rim = np.pi * R * np.sqrt(2) * R * R, 2 * np.pi * R * np.sqrt(2) * R  # half of the cylinder around it; area
    assert flux(bowl.mesh(20000)) == pytest.approx(volume - rim * R / 3, rel=2e-3)
    assert np.allclose(bowl.gradient(np.zeros((1, 3))), [[0, 0, 1]])


def test_pose_places_it() -> None:
    pose = Pose.from_rotation_vector((0.3, 0.1, -0.7), (0.1, 0.2, 0.3))
    placed = EllipticCylinder(R, 2 * R, 3 * R).transformed(pose)
    assert np.allclose(placed.centre, [0.1, 0.2, 0.3])
    assert abs(placed.value(pose.apply(np.array([R, R, 0.0])))) < 1e-12
    assert np.allclose(placed.drawn().centre, placed.centre, atol=1e-6)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Sphere(0.0),
        lambda: Ellipsoid((R, -R, R)),
        lambda: Cylinder(R, float("nan")),
        lambda: EllipticCylinder(float("inf"), R, R),
        lambda: Paraboloid((R, R), 0.0),
        lambda: superquadric((R, R, R), (1.5, 1.0)),
        lambda: superquadric((R, 0.0, R), (1.0, 1.0)),
    ],
)
def test_lengths_that_are_none_are_refused(make: object) -> None:
    with pytest.raises(GeometryError, match="positive"):
        make()  # pyright: ignore[reportCallIssue] - a lambda


def test_a_walk_is_a_great_circle_of_a_sphere_and_a_helix_of_a_cylinder() -> None:
    """Up to 60 degrees: four steps err by (length / 4)^3 / (24 R^2) each at most; four times along a helix."""
    rng, angle = np.random.default_rng(0), np.linspace(0.0, np.pi / 3, 20)[:, None]
    start = rng.normal(size=(20, 3))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    way = np.cross(start, rng.normal(size=(20, 3)))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    end, normal, heading = walk(Sphere(R), R * start, R * angle * way)
    most = 4 * (R * angle.max() / 4) ** 3 / (24 * R**2)
    np.testing.assert_allclose(end, R * (np.cos(angle) * start + np.sin(angle) * way), atol=most)
    np.testing.assert_allclose(normal, end / R, atol=1e-9)
    assert np.isnan(heading[0]).all()
    np.testing.assert_allclose(heading[1:], (np.cos(angle) * way - np.sin(angle) * start)[1:], atol=most / R)
    end, _, heading = walk(Cylinder(R, 4 * R), R * np.array([[0.6, 0.0, 0.8]]), R * np.array([[0.8, 0.5, -0.6]]))
    turned = np.array([[np.cos(1.0), 0, np.sin(1.0)], [0, 1.0, 0], [-np.sin(1.0), 0, np.cos(1.0)]])
    np.testing.assert_allclose(end, R * ([[0.6, 0.0, 0.8]] @ turned.T + [0, 0.5, 0]), atol=4 * most)
    np.testing.assert_allclose(heading, [[0.8, 0.5, -0.6] @ turned.T / np.sqrt(1.25)], atol=4 * most / R)


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
