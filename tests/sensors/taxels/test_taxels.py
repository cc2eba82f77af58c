"""Taxels on the page: cells where the body has them, dark where they are pressed, a picture of the sheet unrolled."""

import urllib.request

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.sensors.taxels.layer import PIXELS, TaxelLayer, cell_mesh, unrolled
from palpate.sensors.taxels.model import TaxelBody
from palpate.viewer.scene import prepare
from palpate.viewer.server import Page
from palpate_lab.simulation.skin_bench import Rolled
from tests.support.pages import BODY, ellipsoid, two_contacts

SHEET = Rolled()
PLACE = SHEET.layout()
SHAPE = PLACE.areas.shape
SHEET_BODY = TaxelBody.sheet(PLACE)
CELLS = (PLACE.centres.reshape(-1, 3), PLACE.normals.reshape(-1, 3), PLACE.areas.ravel())


def _sheet_contacts() -> tuple[Contacts, np.ndarray]:
    """Nothing, then two contacts at once; and the forces of the cells."""
    forces = np.zeros((2, *SHAPE))
    forces[1, 2, 5], forces[1, 3, 15] = 4.0, 6.0
    rows = [(2, 5), (2, 5), (3, 15)]
    estimate = ContactEstimate(
        point=np.array([PLACE.centres[cell] for cell in rows]),
        normal=np.array([PLACE.normals[cell] for cell in rows]),
        force=np.array([-forces[k][cell] * PLACE.normals[cell] for k, cell in zip((0, 1, 1), rows, strict=True)]),
        torque=np.full(3, np.nan),
        covariance=np.full((3, 3, 3), np.nan),
        residual=np.zeros(3),
        candidates=np.ones(3, dtype=np.int64),
        status=np.array([2, 0, 0], dtype=np.int8),
    )
    features = {"row": np.array([np.nan, 2.0, 3.0]), "column": np.array([np.nan, 5.0, 15.0])}
    sample = np.array([0, 1, 1])
    return Contacts(sample, 0.1 * sample, np.array([0, 1, 2]), estimate, features), forces.reshape(2, -1)


def _corners(shape: tuple[int, int] | None) -> np.ndarray:
    """(k, 4, 3) around each cell."""
    vertices, faces = cell_mesh(TaxelBody.anywhere(*CELLS) if shape is None else SHEET_BODY)
    assert faces.shape == (2 * len(CELLS[0]), 3)
    return vertices.reshape(-1, 4, 3)


@pytest.mark.parametrize("shape", [SHAPE, None])
def test_cells_face_outward_have_their_area_and_touch_the_link(shape: tuple[int, int] | None) -> None:
    corners = _corners(shape)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    np.testing.assert_allclose(area, CELLS[2], rtol=1e-9)
    np.testing.assert_allclose(cross / area[:, None], CELLS[1], atol=1e-9)
    np.testing.assert_allclose(corners.mean(axis=1), CELLS[0], atol=1e-12)


def test_cells_of_a_sheet_lie_side_by_side() -> None:
    """Corners that neighbours share are at one place, up to what a chord of one cell hides: pitch^2/(8 radius)."""
    corners = _corners(SHAPE).reshape(*SHAPE, 4, 3)
    gaps = np.linalg.norm(corners[1:, :, 0] - corners[:-1, :, 1], axis=-1)
    assert gaps.max() < 0.1 * min(PLACE.pitch)


def test_the_unrolled_sheet_is_dark_where_it_is_pressed_and_has_its_last_row_on_top() -> None:
    force = np.zeros((6, 22))
    force[0, 3] = 1.0
    picture = unrolled(force, 1.0, np.array([[5.0, 20.0]]))
    assert picture.shape == (6 * PIXELS, 22 * PIXELS, 3)
    middle = PIXELS // 2
    pressed = picture[-middle, 3 * PIXELS + middle].sum()
    idle = picture[-middle, 8 * PIXELS + middle].sum()
    assert pressed < idle
    assert picture[middle, 20 * PIXELS + middle].tolist() == [0, 48, 120]


def test_the_page_of_a_sheet_shows_both_contacts_and_the_cells_below_them() -> None:
    contacts, forces = _sheet_contacts()
    layer = TaxelLayer(SHEET_BODY, forces)
    scene = prepare(None, contacts, "sheet", [layer])
    low, high = CELLS[0].min(axis=0), CELLS[0].max(axis=0)
    np.testing.assert_array_equal(scene.bounds, [low, high])
    with Page(scene, port=0, together=True) as page:
        assert page.session.index == 1  # the strongest
        assert len(page.session.scene3d._markers) == 2
        shade = layer._cells.batched_colors.astype(int).sum(axis=1)
        order = np.argsort(shade, kind="stable")[:2]
        assert [divmod(int(cell), SHAPE[1]) for cell in order] == [(3, 15), (2, 5)]
        assert layer.rows(scene, 1) == [("all cells, sum", "10.0 N"), ("strongest cell", "6.00 N")]
        assert f"{layer.most:.3g} N" in layer.legend()[0]
        layer.show(scene, 0)
        assert len(np.unique(layer._cells.batched_colors, axis=0)) == 1
        with urllib.request.urlopen(page.address) as answer:
            assert answer.status == 200


def test_cells_without_a_grid_are_drawn_on_the_body_and_have_no_sheet() -> None:
    rng = np.random.default_rng(5)
    points = BODY.on_ray(rng.normal(size=(50, 3)))
    contacts = two_contacts()
    layer = TaxelLayer(TaxelBody.anywhere(points, BODY.normals(points), np.full(50, 1e-5)), rng.random((100, 50)))
    with Page(prepare(ellipsoid(), contacts, "", [layer]), port=0, together=True):
        assert layer._sheet is None
        assert layer._cells.batched_colors.shape == (50, 3)


def test_contacts_of_a_file_are_shown_without_the_forces_of_cells() -> None:
    contacts, _ = _sheet_contacts()
    layer = TaxelLayer(SHEET_BODY)
    with Page(prepare(None, contacts, "", [layer]), port=0, together=True) as page:
        assert layer.rows(page.scene, page.session.index) == layer.legend() == []
        assert layer._sheet is None
