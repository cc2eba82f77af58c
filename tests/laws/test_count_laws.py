"""Law 4: what is done to many is what is done to each alone, and nothing is nothing, in the right shape and type.

Functions of batches stand in a table, walked from the source by their annotations (`*batch`): one that is missing is
noticed. Then rows of contacts: several of a sample, samples of equal times, rows without a point, in every file.
"""

import ast
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.contact.contacts import Contacts
from palpate.contact.ellipse import ellipse
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.optical.fisheye import Fisheye, RingView, flat_pixels
from palpate.optical.markers import MarkerColour
from palpate.optical.ring_response import RingResponse, ring_basis
from palpate.sensors.force_torque import ForceTorque
from palpate.sensors.load_cells.explanations import Explanations, explanations
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import position_slope
from palpate.sensors.load_cells.view import loads
from palpate.sensors.marker_ring.locator import RingLocator
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.taxels.intensity import Curve
from palpate.sensors.taxels.skin_map.chart import Chart, wrapped
from palpate.sensors.taxels.skin_map.shell import Shell
from palpate.spatial.pose import Pose, quaternion_from_rotation, rotation_from_quaternion, skew
from palpate.spatial.pose_track import slerp
from palpate.surfaces import Cylinder, superquadric
from palpate.surfaces.bspline import BSplineSurface, open_knots, solve_tangent
from palpate.viewer.scene import Scene
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from tests.support.payloads import known_payload
from tests.support.walked import public

RNG = np.random.default_rng(1)
TURNS = Rotation.random(6, random_state=2)
QUATERNIONS, ROTATIONS = TURNS.as_quat(), TURNS.as_matrix()
VECTORS, WRENCHES, NUMBERS = RNG.normal(size=(6, 3)), RNG.normal(size=(6, 6)), RNG.normal(size=6)
PIXELS = [300.0, 240.0] + 60.0 * RNG.normal(size=(6, 2))
PLACES = RNG.uniform(0.5, 2.5, (6, 2))
CELLS = LoadCells(
    random_cells(LAYOUTS[4], RNG).forward(), np.full(12, 1e-4), positions=LAYOUTS[4], covariance=1e-4 * np.eye(36)
)
LENS = Fisheye(204.0, 203.0, 318.7, 241.3, 0.03, -0.01, 0.002, -0.0005)
VIEW = RingView(LENS, Pose(np.diag([1.0, -1.0, -1.0]), [0.002, -0.001, 0.04]), 0.051, np.arange(24) * np.pi / 12)
CURVE = Curve("polynomial", np.array([30.0, -0.6]), np.diag([1.0, 0.01]), 12.0)
CHART = Chart(True, np.array([0.01, 0.02, 0.03]), ROTATIONS[0])
SECTIONS = SimpleNamespace(u=np.arange(4.0), v=np.arange(4.0), facet=np.arange(16).reshape(4, 4) - 5)
GRID = np.stack([*np.meshgrid(np.arange(6.0), np.arange(7.0), indexing="ij"), RNG.normal(size=(6, 7))], axis=-1)
SPLINE = BSplineSurface(open_knots(np.arange(4.0)), open_knots(np.arange(5.0)), GRID)
ROWS = np.concatenate([RNG.normal(size=(6, 20)), np.arange(6)[:, None], np.arange(6)[:, None] % 3], axis=1)
MATRICES = np.tile(np.eye(4), (6, 1, 1))
MATRICES[:, :3, :3], MATRICES[:, :3, 3] = ROTATIONS, VECTORS
TWO, SIX = np.ones(2), np.ones((2, 6))
PRESSED = RingResponse(np.zeros((3, 2, 9, 5)), TWO, SIX, TWO, np.array([0.01, 5.1]), np.ones(3), 0.1)
RING = MarkerRing(0.055, VIEW, MarkerColour(), VIEW.from_plane(VIEW.rest), np.full(24, 150.0), 0.2, PRESSED)
SHELL = SimpleNamespace(surface=SimpleNamespace(periodic=False), sections=SECTIONS)
FITS = RNG.uniform(size=(6, 16)) < 0.5
BLOB = cache(lambda: superquadric((1.0, 0.7, 0.5), (0.9, 0.8)))  # compiled where a test asks for it
BATCHED: dict[str, tuple[Callable[..., Any], tuple[np.ndarray, ...]]] = {
    "ellipse": (ellipse, (VECTORS[:, :, None] * VECTORS[:, None] + np.eye(3), ROTATIONS[:, 0])),
    "ContactEstimate.from_rows": (lambda rows: tuple(vars(ContactEstimate.from_rows(rows)).values()), (ROWS,)),
    "Fisheye.project": (LENS.project, (VECTORS + np.array([0, 0, 5.0]),)),
    "Fisheye.rays": (LENS.rays, (PIXELS,)),
    "Fisheye.rays_with_slope": (LENS.rays_with_slope, (PIXELS,)),
    "RingView.to_plane": (VIEW.to_plane, (PIXELS,)),
    "RingView.to_plane_with_slope": (VIEW.to_plane_with_slope, (PIXELS,)),
    "RingView.from_plane": (VIEW.from_plane, (0.02 * VECTORS[:, :2],)),
    "flat_pixels": (lambda pixels: flat_pixels(pixels).reshape(pixels.shape), (PIXELS,)),
    "ring_basis": (lambda angle: ring_basis(angle, 3), (NUMBERS,)),
    "ForceTorque.saturated": (ForceTorque(limits=np.ones(6)).saturated, (WRENCHES,)),
    "Explanations.simplest": (lambda fits: Explanations.simplest(explanations(CELLS), fits), (FITS,)),
    "LoadCells.wrenches": (CELLS.wrenches, (WRENCHES @ CELLS.matrix.T,)),
    "LoadCells.calibration_covariance": (CELLS.calibration_covariance, (WRENCHES,)),
    "LoadCells.chi_square": (CELLS.chi_square, (RNG.normal(size=(6, 12)),)),
    "position_slope": (position_slope, (VECTORS, ROTATIONS[:, 0], VECTORS[::-1])),
    "loads": (lambda *given: loads(CELLS, *given), (VECTORS, ROTATIONS[:, 0], VECTORS[::-1], NUMBERS)),
    "RingLocator.depth": (
        lambda states: RingLocator.depth(SimpleNamespace(response=SimpleNamespace(width=(1e-3, 2e-4))), states),
        (RNG.normal(size=(6, 9)),),
    ),
    "MarkerRing.displacements": (RING.displacements, (VIEW.rest + RNG.normal(size=(6, 24, 2)),)),
    "Curve.intensity": (CURVE.intensity, (5.0 * NUMBERS,)),
    "Curve.force": (CURVE.force, (50.0 * NUMBERS,)),
    "Curve.deviation": (CURVE.deviation, (5.0 * NUMBERS,)),
    "Curve.jacobian": (CURVE.jacobian, (5.0 * NUMBERS,)),
    "Curve.slope": (CURVE.slope, (5.0 * NUMBERS,)),
    "Chart.local": (CHART.local, (VECTORS,)),
    "Chart.coordinates": (CHART.coordinates, (VECTORS,)),
    "wrapped": (wrapped, (5.0 * NUMBERS,)),
    "Parametric.derivatives": (SPLINE.derivatives, (PLACES,)),
    "Shell.there": (lambda uv: Shell.there(SHELL, uv), (2.0 * PLACES - 1.0,)),
    "Payload.compensate": (known_payload().compensate, (WRENCHES, ROTATIONS, VECTORS)),
    "Payload.load_jacobian": (known_payload().load_jacobian, (ROTATIONS, VECTORS)),
    "skew": (skew, (VECTORS,)),
    "rotation_from_quaternion": (rotation_from_quaternion, (QUATERNIONS,)),
    "quaternion_from_rotation": (quaternion_from_rotation, (ROTATIONS,)),
    "Pose.from_matrix": (lambda matrix: ((made := Pose.from_matrix(matrix)).rotation, made.translation), (MATRICES,)),
    "slerp": (slerp, (QUATERNIONS, QUATERNIONS[::-1].copy(), RNG.uniform(size=6))),
    "Analytic.evaluate": (Cylinder(0.01, 0.02).evaluate, (VECTORS,)),
    "Quadric.evaluate": (Cylinder(0.01, 0.02).evaluate, (VECTORS,)),
    "ImplicitSurface.evaluate": (lambda points: BLOB().evaluate(points), (VECTORS,)),
    "solve_tangent": (solve_tangent, (ROTATIONS[:, :2], VECTORS)),
    "Scene.placed": (lambda points: Scene.placed(SimpleNamespace(_middle=VECTORS[0], size=0.2), points), (VECTORS,)),
}
SHAPES = ((), (0,), (1,), (6,), (2, 3), (3, 0), (1, 1, 4))


def batched() -> Iterator[str]:
    """Every public function and method of `palpate` whose arguments are batches, by its annotations."""
    for name, node in public():
        given = node.args.args if isinstance(node, ast.FunctionDef) else []
        if any("*batch" in ast.unparse(each.annotation) for each in given if each.annotation is not None):
            yield name


def arrays(answer: Any) -> list[np.ndarray]:
    return [np.asarray(part) for part in (answer if isinstance(answer, tuple) else (answer,))]


def test_every_function_of_batches_is_in_the_table() -> None:
    assert set(batched()) == set(BATCHED)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("name", BATCHED)
def test_a_batch_is_answered_as_each_of_it_alone(name: str, shape: tuple[int, ...]) -> None:
    function, given = BATCHED[name]
    count, each = int(np.prod(shape)), [arrays(function(*(part[k : k + 1] for part in given))) for k in range(6)]
    if not shape and min(part.ndim for part in (*given, *each[0])) == 1:
        return  # a number alone is no array
    found = arrays(function(*(part[:count].reshape(*shape, *part.shape[1:]) for part in given)))
    for part, *singles in zip(found, *each, strict=True):
        expected = np.concatenate(singles)
        assert part.shape == (*shape, *expected.shape[1:])
        assert part.dtype == expected.dtype
        np.testing.assert_allclose(part.reshape(count, *expected.shape[1:]), expected[:count], rtol=1e-9, atol=1e-12)
    assert any(np.ptp(np.concatenate(part).astype(float), axis=0).any() for part in zip(*each, strict=True))


def contacts(samples: list[int]) -> Contacts:
    """A row for each number, which is its sample: pairs of samples have equal times, and some rows no point."""
    count, sample = len(samples), np.array(samples, dtype=np.int64)
    rows = np.random.default_rng(count).normal(size=(count, 24))
    rows[:, ROW.candidates], rows[:, ROW.status] = 1, np.arange(count) % 2
    bare = np.arange(count) % 5 == 3
    rows[np.ix_(bare, [*range(6), *range(9, 20)])], rows[bare, ROW.status] = np.nan, Status.TOO_LIGHT
    rows[:, 23] = np.arange(count) % 3
    return Contacts.of_rows(sample, (sample // 2).astype(float), rows, ("felt",))


SAMPLES = {"none": [], "one": [4], "several of one": [7, 7, 7, 7], "many": [0, 1, 1, 2, 3, 3, 3, 5, 8, 8]}


@pytest.mark.parametrize("samples", SAMPLES.values(), ids=SAMPLES)
def test_rows_come_back_from_arrays_parts_tables_and_files(tmp_path: Path, samples: list[int]) -> None:
    known = contacts(samples)
    ways = [Contacts.of_rows(known.sample, known.time, known.rows(), ("felt",)), known[:], known[np.arange(len(known))]]
    ways.append(Contacts.joined([contacts([])[:0], *(known[k : k + 1] for k in range(len(known))), contacts([])]))
    for suffix in (".csv", ".parquet", ".mcap"):
        known.save(tmp_path / f"rows{suffix}")
        found = Contacts.load(tmp_path / f"rows{suffix}")
        assert found.features.keys() == ({"felt"} if len(known) else found.features.keys())
        ways.append(replace(found, features=known.features) if not len(known) else found)
    expected = known.to_polars()
    for found in ways:
        assert found.to_polars().equals(expected, null_equal=True)
        assert found.to_polars().schema == expected.schema
        assert np.array_equal(found.located, known.located)
    assert expected["px"].null_count() == int((~known.located).sum())
