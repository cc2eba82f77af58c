"""B-spline surfaces: scipy is the oracle of values and derivatives; normals, geodesics and knots keep their laws."""

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from palpate.errors import GeometryError
from palpate.surfaces.bspline import BSplineSurface, basis_matrices, greville, open_knots, periodic_knots

ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]


def bumpy(degree: tuple[int, int], periodic: bool) -> BSplineSurface:
    """Random control points: any surface will do."""
    u, v = open_knots(np.linspace(0, 1, 6), degree[0]), np.linspace(0, 2 * np.pi, 9)
    knots = periodic_knots(v, degree[1]) if periodic else open_knots(v, degree[1])
    control = np.random.default_rng(4).normal(size=(len(u) - degree[0] - 1, len(knots) - degree[1] - 1, 3))
    if periodic:
        control[:, -degree[1] :] = control[:, : degree[1]]
    return BSplineSurface(u, knots, control, degree, periodic)


def ring(radius: float = 0.04, around: int = 24, degree: int = 5) -> BSplineSurface:
    """A cylinder, nearly: control points on a circle, which a spline rounds off alike everywhere."""
    v, u = periodic_knots(np.linspace(0, 2 * np.pi, around + 1), degree), open_knots(np.array([0.0, 0.1]), 1)
    angle = greville(v, degree)
    place = np.stack([np.cos(angle), -np.sin(angle), 0 * angle], axis=-1)
    control = radius * place + np.array([0, 0, 1.0]) * np.array([0.0, 0.1])[:, None, None]
    return BSplineSurface(u, v, control, (1, degree), True)


@pytest.mark.parametrize("degree", [(3, 3), (3, 5), (1, 5), (2, 4)])
@pytest.mark.parametrize("periodic", [False, True])
def test_compiled_values_and_derivatives_are_scipys(degree: tuple[int, int], periodic: bool) -> None:
    surface = bumpy(degree, periodic)
    uv = np.random.default_rng(1).uniform([0, 0], [1, 2 * np.pi], (200, 2))
    oracle = NdBSpline((surface.knots_u, surface.knots_v), surface.control, degree)
    found = surface.derivatives(uv)
    for k, order in enumerate(ORDERS):
        if order[0] <= degree[0] and order[1] <= degree[1]:
            size = np.abs(found[:, k]).max()
            assert np.allclose(found[:, k], oracle(uv, nu=order), rtol=0, atol=1e-12 * size)  # rounding
        else:
            assert np.all(found[:, k] == 0)


def test_a_closed_surface_comes_round() -> None:
    surface = bumpy((3, 3), True)
    uv = np.random.default_rng(2).uniform([0, 0], [1, 2 * np.pi], (50, 2))
    turned = surface.derivatives(uv + np.array([0.0, 4 * np.pi]))
    assert np.allclose(turned, surface.derivatives(uv), rtol=0, atol=1e-10)  # the parameter's own rounding
    assert surface.points == surface.control.shape[0] * 8


def test_beyond_an_open_end_it_goes_on_straight() -> None:
    surface = bumpy((3, 3), False)
    edge = surface.derivatives(np.array([1.0, 2.0]))
    beyond = surface.derivatives(np.array([1.3, 2.0]))
    assert np.allclose(beyond[0], edge[0] + 0.3 * edge[1], rtol=1e-12)
    assert np.allclose(beyond[1], edge[1], rtol=1e-12)


def test_normals_are_outward_unit_and_across() -> None:
    surface = ring()
    points, normals = surface.at(np.random.default_rng(3).uniform([0, 0], [0.1, 6], (100, 2)))
    out = points * [1, 1, 0]
    assert np.allclose(normals, out / np.linalg.norm(out, axis=1, keepdims=True), atol=1e-5)  # quintic: h^5 of 24


def test_nearest_finds_the_foot_of_the_normal() -> None:
    surface = ring()
    uv = np.random.default_rng(5).uniform([0, 0], [0.1, 6], (50, 2))
    points, normals = surface.at(uv)
    found = surface.nearest(points + 0.003 * normals, uv + 0.01)
    assert np.allclose(surface.at(found)[0], points, atol=1e-9)


def test_a_compiled_geodesic_is_a_helix_on_a_cylinder() -> None:
    surface = ring()
    start = surface.derivatives(np.array([0.01, 0.5]))
    radius = float(np.linalg.norm(start[0, :2]))
    slant = np.array([0.6, 0.8 / radius])  # 0.6 along, 0.8 round, of unit speed
    states, _ = surface.geodesics(np.concatenate([[0.01, 0.5], slant, [1.0, 0.0]])[None], 1e-3, 80)
    length = 1e-3 * np.arange(81)
    assert np.allclose(states[:, 0, 0], 0.01 + 0.6 * length, atol=1e-7)
    assert np.allclose(states[:, 0, 1], 0.5 + 0.8 / radius * length, atol=1e-6)  # radius and speed vary by h^5
    assert np.allclose(states[:, 0, 4], 1.0, atol=1e-6)  # no Gaussian curvature: neighbours stay side by side


def test_linear_functions_have_their_coefficients_at_greville_places() -> None:
    knots = open_knots(np.array([0.0, 0.1, 0.5, 0.6, 1.0]), 3)
    x = np.linspace(0, 1, 33)
    values, slopes = basis_matrices(knots, 3, x)
    assert np.allclose(values @ greville(knots, 3), x, atol=1e-14)
    assert np.allclose(slopes @ greville(knots, 3), 1.0, atol=1e-12)


def test_a_mesh_of_it_lies_on_it() -> None:
    surface = ring()
    mesh = surface.mesh(4, 90)
    assert np.allclose(np.linalg.norm(mesh.vertices[:, :2], axis=1).std(), 0, atol=1e-7)
    outward = np.einsum("ij,ij->i", mesh.normals[:, :2], mesh.vertices[mesh.faces].mean(axis=1)[:, :2])
    assert np.all(outward > 0)


@pytest.mark.parametrize(
    "change",
    [
        {"knots_u": np.zeros(10)},
        {"knots_u": np.linspace(0, 1, 9)},
        {"degree": (6, 3)},
        {"control": np.full((8, 11, 3), np.nan)},
    ],
)
def test_numbers_that_do_not_belong_together_are_refused(change: dict[str, object]) -> None:
    good = bumpy((3, 3), False)
    parts = {"knots_u": good.knots_u, "knots_v": good.knots_v, "control": good.control, "degree": good.degree}
    with pytest.raises(GeometryError):
        BSplineSurface(**{**parts, **change})
