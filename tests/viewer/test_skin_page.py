"""The page of a skin: cells where the map has them, touches where they are, a picture of the sheet unrolled."""

from __future__ import annotations

import urllib.request

import numpy as np
import pytest

from palpate.contact.several import Skin
from palpate.sensors.intensity import Curve, Intensity
from palpate.sensors.recording import CELLS, Recording
from palpate.sensors.skin import Health, Sheet
from palpate.simulation.skin_bench import Patch, Rolled, press
from palpate.viewer.skin import PIXELS, SkinPage, SkinScene, unrolled

SHEET = Rolled()


def _scene() -> SkinScene:
    """Nothing, then two touches."""
    none = np.zeros((6, 22), dtype=bool)
    curve = Curve("polynomial", np.array([10.0]), np.zeros((1, 1)), largest=20.0)
    health = Health(np.zeros((6, 22)), np.full((6, 22), 0.1), none, none)
    skin = Skin(SHEET.layout(), Intensity((curve,)), Sheet(6, 22, bits=None), health)
    loads = press(SHEET, [Patch(2.0, 5.0, 1.0, 4.0), Patch(3.0, 15.0, 1.0, 6.0)]).loads
    frames = Recording(np.array([0.0, 0.1]), {CELLS: 10.0 * np.stack([np.zeros((6, 22)), loads])})
    forces = np.empty((2, 6, 22))
    found = skin.run(frames, forces=forces)
    return SkinScene("bench", SHEET.layout(), None, frames.time, forces.astype(np.float32), found)


def test_cells_face_outward_and_lie_on_the_link() -> None:
    points, faces = _scene().quads()
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    outward = (a + b + c) * [1.0, 1.0, 0.0]
    assert (np.sum(normal * outward, axis=1) > 0).all()
    assert np.abs(np.linalg.norm(points[:, :2], axis=1) - SHEET.radius).max() < 0.4e-3  # lifted by 0.3 mm


def test_touches_belong_to_their_frame() -> None:
    scene = _scene()
    assert len(scene.at(0)) == 0
    assert len(scene.at(1)) == 2
    assert scene.most > 0


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


def test_the_page_can_be_opened() -> None:
    pytest.importorskip("viser")
    with SkinPage(_scene(), port=0) as page:
        page.show(1)
        page.show(0)
        with urllib.request.urlopen(page.address) as answer:
            assert answer.status == 200
