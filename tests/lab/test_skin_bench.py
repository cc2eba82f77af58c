"""The bench: forces balance, fields are those of the formulas, poses those of the markers."""

import numpy as np
import pytest

from palpate.signals.recording import CELLS
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.skin_bench import Patch, Rolled, Wand, paper_sheet, press, read_out, wand_poses

SHEET = Rolled()


@pytest.mark.parametrize("flat", [False, True])
def test_cells_together_bear_the_whole_force(flat: bool) -> None:
    true = press(SHEET, [Patch(2.4, 10.3, 1.5, 7.0, flat)])
    assert true.loads.sum() == pytest.approx(7.0, rel=1e-12)


def test_a_cell_bears_the_pressure_over_its_square() -> None:
    """The middle cell of Hertz's patch of radius 2: the integral of 3F/(2 pi a^2) sqrt(1 - r^2/a^2) over the square."""
    grid = (np.arange(400) + 0.5) / 400 - 0.5
    x, y = np.meshgrid(grid, grid)
    exact = 3 * 5.0 / (2 * np.pi * 4.0) * np.sqrt(1 - (x**2 + y**2) / 4.0).mean()
    assert press(SHEET, [Patch(3.0, 9.0, 2.0, 5.0)]).loads[3, 9] == pytest.approx(exact, rel=0.01)


def test_force_of_a_patch_round_the_link_is_shortened_as_its_normals_spread() -> None:
    """Flat pressure over a disc of angle b: the mean of cos is 2 J1(b)/b."""
    from scipy.special import j1

    angle = 2.5 * SHEET.pitch / SHEET.radius
    true = press(SHEET, [Patch(2.5, 8.0, 2.5, 10.0, flat=True)])
    assert np.linalg.norm(true.force[0]) == pytest.approx(10.0 * 2 * j1(angle) / angle, rel=1e-3)
    assert true.force[0] @ true.normal[0] < 0


def test_torque_is_that_of_the_force_through_the_middle() -> None:
    """By symmetry: no torque is left about the patch's middle."""
    true = press(SHEET, [Patch(1.5, 8.0, 1.0, 10.0)])
    np.testing.assert_allclose(true.torque[0], np.cross(true.point[0], true.force[0]), atol=1e-4)


def test_a_map_of_the_sheet_is_on_the_cylinder() -> None:
    place = SHEET.layout()
    np.testing.assert_allclose(np.linalg.norm(place.centres[..., :2], axis=-1), SHEET.radius, rtol=1e-12)
    arc = 2 * SHEET.radius * np.arcsin(np.linalg.norm(np.diff(place.centres, axis=1), axis=-1) / (2 * SHEET.radius))
    np.testing.assert_allclose(arc, SHEET.pitch, rtol=1e-9)


def test_readings_are_whole_stay_in_range_or_wrap() -> None:
    rng = np.random.default_rng(1)
    model = paper_sheet(SHEET, rng)
    loads = np.full((5, 6, 22), 30.0)
    kept, wrapped = (read_out(model, loads, rng, wraps=wraps).channels[CELLS] for wraps in (False, True))
    assert kept.max() == kept.min() == 255
    assert wrapped.max() < 256
    assert wrapped.mean() < 255
    assert (kept == np.rint(kept)).all()


def test_the_wand_is_where_its_markers_are() -> None:
    """Without noise and with all markers seen its axis is the normal and its tip touches the point."""
    sheet = SHEET.layout()
    point, normal = sheet.centres[2, ::7], sheet.normals[2, ::7]
    wand = Wand(noise=0.0, occlusion=0.0)
    found = wand_poses(wand, point, normal, np.random.default_rng(2))
    turn = rotation_from_quaternion(found[:, 3:])
    np.testing.assert_allclose(turn[..., 2], normal, atol=1e-12)
    np.testing.assert_allclose(found[:, :3] - wand.radius * normal, point, atol=1e-12)


def test_hidden_markers_lose_the_pose() -> None:
    point, normal = np.zeros((200, 3)), np.tile([0.0, 0.0, 1.0], (200, 1))
    found = wand_poses(Wand(occlusion=0.5), point, normal, np.random.default_rng(3))
    lost = np.isnan(found).any(axis=1).mean()
    assert lost == pytest.approx(1 - (5 / 16) ** 2, abs=0.08)  # three or four of four seen, for both bodies
