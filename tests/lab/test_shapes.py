"""The bodies that truth is made of: checked against their own definitions by means that do not share code with them."""

import numpy as np
import pytest

from palpate_lab.simulation.shapes import Body, BumpySphere, EllipsoidBody, Superquadric, icosphere

R = 0.01
BODIES = {
    "ellipsoid": EllipsoidBody((R, 0.7 * R, 0.5 * R)),
    "superquadric": Superquadric((R, 0.7 * R, 0.5 * R), (0.7, 0.7)),
    "superquadric with two exponents": Superquadric((R, 0.7 * R, 0.5 * R), (0.7, 1.2)),
    "bumpy sphere": BumpySphere(R),
}


@pytest.fixture(params=BODIES.values(), ids=BODIES.keys())
def body(request: pytest.FixtureRequest) -> Body:
    return request.param


def test_rays_land_on_the_surface_and_along_themselves(body: Body) -> None:
    directions = np.random.default_rng(0).normal(size=(1000, 3))
    points = body.on_ray(directions)
    slope = np.linalg.norm(body.gradient(points), axis=1)
    assert np.all(np.abs(body.value(points)) / slope < 1e-14 * 10)  # metres: a few roundings of R
    cosine = np.sum(points * directions, axis=1) / np.linalg.norm(points, axis=1) / np.linalg.norm(directions, axis=1)
    assert np.allclose(cosine, 1.0, rtol=0, atol=1e-14)


def test_gradient_is_the_slope_of_the_value(body: Body) -> None:
    points = body.sample(500, np.random.default_rng(1)) * 1.1  # off the surface as well
    step = 1e-6 * R
    slopes = [(body.value(points + step * axis) - body.value(points - step * axis)) / (2 * step) for axis in np.eye(3)]
    # central differences of a step h are good to the rounding eps / h = 2e-10 R of the value and h^2 = 1e-12
    assert np.allclose(np.stack(slopes, axis=1), body.gradient(points), rtol=0, atol=1e-8 * body.gradient(points).max())


def test_normals_are_outward_and_finite_on_the_axes(body: Body) -> None:
    points = np.concatenate(
        [body.on_ray(np.eye(3)), body.on_ray(-np.eye(3)), body.sample(500, np.random.default_rng(2))]
    )
    normals = body.normals(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.all(np.sum(normals * points, axis=1) > 0)  # all four are star-shaped about the centre


def test_the_issue_s_definitions() -> None:
    u = np.array([1.0, 2.0, 2.0]) / 3.0
    bumpy = BumpySphere(R).on_ray(u)
    expected = R * (1 + 0.05 * np.sin(1.0) * np.sin(2.0) * np.sin(2.0))
    assert np.allclose(bumpy, expected * u, rtol=1e-14)
    x, y, z = np.abs(Superquadric((R, 0.7 * R, 0.5 * R)).on_ray(u)) / np.array([R, 0.7 * R, 0.5 * R])
    assert np.isclose((x ** (2 / 0.7) + y ** (2 / 0.7)) + z ** (2 / 0.7), 1.0, rtol=1e-13)


@pytest.mark.parametrize("frequency", [1, 2, 3, 10])
def test_icosphere_is_closed_outward_and_near_uniform(frequency: int) -> None:
    vertices, faces = icosphere(frequency)
    assert (len(vertices), len(faces)) == (10 * frequency**2 + 2, 20 * frequency**2)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)  # each directed edge once ...
    assert {tuple(e) for e in edges.tolist()} == {(b, a) for a, b in edges.tolist()}  # ... and its twin: closed
    volumes = np.linalg.det(vertices[faces]) / 6
    assert np.all(volumes > 0)
    assert volumes.max() / volumes.min() < 2.0  # 1.97 in the limit of many facets


@pytest.mark.parametrize("facets", [2_000, 20_000, 200_000])
def test_meshes_have_about_the_facets_asked_for_and_every_vertex_on_the_body(facets: int) -> None:
    body = BODIES["superquadric"]
    vertices, faces = body.mesh(facets)
    assert len(faces) == pytest.approx(facets, rel=0.03)  # the nearest 20 nu^2
    assert np.abs(body.value(vertices)).max() < 1e-13


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: EllipsoidBody((1.0, 0.0, 1.0)),
        lambda: Superquadric((1.0, 1.0, 1.0), (2.5, 1.0)),
        lambda: BumpySphere(-1.0),
    ],
)
def test_impossible_bodies_are_refused(wrong) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        wrong()
