"""The barrel: laws of elastic bodies and of contact, and Lame's cylinder."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import InputError

pytest.importorskip("skfem")

from palpate_lab.simulation.barrel import Barrel, Indenter
from palpate_lab.simulation.barrel_elasticity import COARSE_ROWS, BarrelSettings, compliance, solid

COARSE = BarrelSettings(around=48, rows=COARSE_ROWS)
EVEN = replace(COARSE, uneven=(0.0, 0.0))
BRICK = 2.0 * np.pi / COARSE.around


@pytest.fixture(scope="module")
def barrel() -> Barrel:
    return Barrel.built(COARSE)


@pytest.fixture(scope="module")
def even() -> Barrel:
    return Barrel.built(EVEN)


def test_compliance_is_reciprocal_and_stores_energy() -> None:
    """Maxwell and Betti, between the two surfaces: rows and columns are computed in different ways."""
    body = solid(replace(COARSE, around=16, rows=(0.0, 0.012, 0.045), band=0.012))
    some = np.concatenate([3 * body.node[:, :2, 2].ravel(), 3 * body.node[:, 1, 0].ravel() + 1])
    whole = compliance(body, some, some)
    np.testing.assert_allclose(whole, whole.T, atol=1e-9 * np.abs(whole).max())
    assert np.linalg.eigvalsh((whole + whole.T) / 2)[0] > 0


def test_stiffness_knows_no_rigid_motion() -> None:
    """Moved or turned as a whole, the unsupported body bears nothing."""
    body = solid(replace(COARSE, around=16, rows=(0.0, 0.045), band=0.045))
    x, y, z = body.place.T
    turn = np.stack([-y, x, 0 * z], axis=-1)
    tilt = np.stack([0 * x, -z, y], axis=-1)
    for motion in (np.ones_like(turn), turn, tilt):
        force = body.stiffness @ motion.ravel()
        assert np.abs(force).max() < 1e-9 * np.abs(body.stiffness).max()


def test_a_long_even_cylinder_under_pressure_is_lame_s() -> None:
    """Ends held along the axis only: plane strain.

    Outer pressure p on radii a < b moves the inner side by
    -2 (1 - nu^2) p a b^2/(E (b^2 - a^2)), and the outer by -(1 + nu) p b ((1 - 2 nu) b^2 + a^2)/(E (b^2 - a^2)).
    """
    settings = replace(EVEN, end_radius=0.055, around=24, rows=(0.0, 0.5, 1.0), band=0.5, thickness=0.01, poisson=0.3)
    body = solid(settings)
    a, b, nu, pressure = 0.045, 0.055, 0.3, 100.0
    columns = len(body.node)
    theta = 2.0 * np.pi * np.arange(columns) / columns
    line = np.where(np.arange(columns) % 2 == 0, 1 / 3, 2 / 3) * 2 * (2 * np.pi * b / columns)
    height = np.array([1 / 6, 4 / 6, 2 / 6, 4 / 6, 1 / 6]) * 0.5  # Simpson's weights of the rows
    force = np.zeros((len(body.place), 3))
    for row in range(5):
        node = body.node[:, row, 2]
        inward = -np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        force[node, :2] = pressure * height[row] * line[:, None] * inward
    # no clamp: only the axial movement is held, at both ends; the freedoms that turn or shift the whole carry no load
    held = np.concatenate([3 * body.node[:, [0, -1]].ravel() + 2, 3 * body.node[0, 0, [0]] + 1])
    held = np.concatenate([held, 3 * body.node[columns // 2, 0, [0]] + 1, 3 * body.node[columns // 4, 0, [0]]])
    free = np.setdiff1d(np.arange(force.size), held)
    from scipy.sparse.linalg import spsolve

    moved = np.zeros(force.size)
    moved[free] = spsolve(body.stiffness[free][:, free].tocsc(), force.ravel()[free])
    radial = moved.reshape(-1, 3)[body.node[0, 2, [0, 2]], 0]
    scale = pressure / (settings.modulus * (b**2 - a**2))
    exact = -scale * np.array([2 * (1 - nu**2) * a * b**2, (1 + nu) * b * ((1 - 2 * nu) * b**2 + a**2)])
    np.testing.assert_allclose(radial, exact, rtol=2e-3)  # the chord error of 24 quadratic bricks is 1e-4


def test_forces_on_the_skin_add_up(barrel: Barrel) -> None:
    """The nodes bear what the body presses: nothing is lost between points of contact and nodes."""
    from palpate_lab.simulation.barrel_contact import settle

    body = Indenter("tip", 0.7, 0.004, slide=0.001)
    found = settle(barrel.band, [body])[-1]
    total = 2.0 * found.nodal.reshape(-1, 2).sum(axis=0)
    out = np.array([np.cos(found.angle[0]), np.sin(found.angle[0])])
    assert -total @ out == pytest.approx(found.force[0], abs=1e-3)
    assert total @ [-out[1], out[0]] == pytest.approx(found.shear[0], abs=1e-3)


@pytest.mark.parametrize("kind", ["plate", "tip", "cylinder"])
def test_an_even_barrel_turned_by_a_brick_is_the_same(even: Barrel, kind: str) -> None:
    here, there = (even.press([Indenter(kind, 2 * BRICK * at, 0.004)]) for at in (0, 1))
    assert there.force == pytest.approx(here.force, rel=1e-4)
    assert there.angle - here.angle == pytest.approx(2 * BRICK, abs=1e-5)
    shift = np.roll(np.hypot(*here.markers[:, :2].T), 1)  # 24 markers: one stands two bricks from the next
    np.testing.assert_allclose(np.hypot(*there.markers[:, :2].T), shift, atol=1e-7)


def test_the_mirror_image_is_pressed_back(even: Barrel) -> None:
    left, right = (even.press([Indenter("tip", side * 0.3, 0.004, slide=side * 0.002)]) for side in (-1, 1))
    assert left.angle == pytest.approx(-right.angle, abs=1e-4)
    assert left.shear == pytest.approx(-right.shear, abs=1e-3)
    assert right.shear[0] > 0.05  # dragged towards rising angles, it drags the skin along


def test_force_hardly_ripples_between_nodes(even: Barrel) -> None:
    angles = np.linspace(0.0, BRICK, 6)
    found = [even.press([Indenter("tip", at, 0.004)]) for at in angles.tolist()]
    force = np.array([each.force[0] for each in found])
    assert np.ptp(force) < 0.02 * force.mean()
    assert np.abs([each.angle[0] for each in found] - angles).max() < np.radians(0.3)


@pytest.mark.parametrize("slide", [0.0, 0.001, -0.004])
def test_friction_stays_in_its_cone(barrel: Barrel, slide: float) -> None:
    """On a plate, whose normal is the same everywhere; shear is told at the centre of pressure, so turn it back."""
    found = barrel.press([Indenter("plate", 1.0, 0.003, slide=slide)], friction=0.3)
    apart = found.angle[0] - 1.0
    normal = found.force[0] * np.cos(apart) + found.shear[0] * np.sin(apart)
    tangent = found.shear[0] * np.cos(apart) - found.force[0] * np.sin(apart)
    assert abs(tangent) <= 0.3 * normal * (1 + 1e-4)
    if abs(slide) > 0.003:
        assert tangent == pytest.approx(np.sign(slide) * 0.3 * normal, rel=0.02)  # all of it slips


def test_without_friction_a_plate_drags_nothing(barrel: Barrel) -> None:
    found = barrel.press([Indenter("plate", 1.0, 0.003, slide=0.002)], friction=0.0)
    apart = found.angle[0] - 1.0
    assert found.shear[0] * np.cos(apart) - found.force[0] * np.sin(apart) == pytest.approx(0.0, abs=1e-6)


def test_far_contacts_add_up(even: Barrel) -> None:
    """Half a turn apart the skin answers by less than 0.2 %: each is as if alone."""
    one, two = Indenter("tip", 0.2, 0.003), Indenter("tip", 0.2 + np.pi, 0.005, radius=0.02)
    both, first, second = even.press([one, two]), even.press([one]), even.press([two])
    assert both.force == pytest.approx([first.force[0], second.force[0]], rel=0.01)
    added = first.markers + second.markers - even.rest[:, 0]
    np.testing.assert_allclose(both.markers, added, atol=5e-5)


def test_deeper_is_harder_and_what_is_unloaded_rests(barrel: Barrel) -> None:
    steps = [(0.0, 0.0), (0.25, 0.0), (0.5, 0.0), (1.0, 0.0)]
    path = barrel.follow([Indenter("plate", 2.0, 0.008)], steps)
    force = [each.force[0] for each in path]
    assert force[0] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(path[0].angle[0])
    np.testing.assert_allclose(path[0].markers, barrel.rest[:, 0])
    assert np.all(np.diff(force) > 0)
    assert path[-1].force[0] == pytest.approx(barrel.press([Indenter("plate", 2.0, 0.008)]).force[0], rel=0.03)


def test_a_far_marker_bulges_where_the_near_one_dents(even: Barrel) -> None:
    moved = even.press([Indenter("tip", 0.0, 0.004)]).markers
    out = np.hypot(*moved[:, :2].T) - np.hypot(*even.rest[:, 0, :2].T)
    assert out[0] < -0.003
    assert out[3] > 0.0002  # 45 degrees off: a ring that is hardly longer must bulge


@pytest.mark.parametrize(
    "bad", [Indenter("tip", 0.0, 0.04), Indenter("tip", 0.0, -0.001), Indenter("tip", 0.0, 0.001, 0.0)]
)
def test_what_cannot_be_pressed_is_said(barrel: Barrel, bad: Indenter) -> None:
    with pytest.raises(InputError):
        barrel.press([bad])


def test_without_scikit_fem_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(InputError, match=r"palpate\[simulation\]"):
        solid(EVEN)


def test_rings_above_and_below_the_equator_are_mirrored_and_the_middle_one_is_as_alone(barrel: Barrel) -> None:
    several = Barrel.built(replace(COARSE, rings=(0.0, 0.01, -0.01)))
    one, more = (each.press([Indenter("tip", 1.0, 0.006)]) for each in (barrel, several))
    middle, above, below = np.split(more.markers - several.rest[:, 0], 3)
    np.testing.assert_allclose(middle, one.markers - barrel.rest[:, 0], atol=1e-12)
    np.testing.assert_allclose(above, below * (1.0, 1.0, -1.0), atol=1e-12)
    k = round(24 / (2.0 * np.pi))
    assert 0.3 < np.linalg.norm(above[k, :2]) / np.linalg.norm(middle[k, :2]) < 0.95  # a dent is deepest in its middle
    np.testing.assert_allclose(several.rest[24:48, 0, 2], 0.01)


def test_a_marker_on_a_node_goes_where_the_node_goes() -> None:
    """At heights of the mesh's own rows, in the second brick: the inner side's compliance, straight from the body."""
    settings = replace(COARSE, around=24, rings=(0.0, 0.006, 0.016), markers=24)
    barrel, body = Barrel.built(settings), solid(settings)
    levels = np.unique(np.round(body.place[:, 2], 9))
    loaded = 3 * body.node[:, : int(np.searchsorted(levels, settings.band + 1e-9)), 2].ravel()
    for ring, height in enumerate(settings.rings):
        node = body.node[4, int(np.searchsorted(levels, height)), 0]  # of marker 2: two columns a brick
        straight = compliance(body, np.concatenate([loaded, 3 * node + np.arange(3)]), loaded)[-3:]
        np.testing.assert_allclose(
            barrel.answer.reshape(72, -1, 3, 2 * len(loaded))[24 * ring + 2, 0][:, ::2], straight, atol=1e-12
        )
