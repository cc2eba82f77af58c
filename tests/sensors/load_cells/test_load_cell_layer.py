"""Load cells in the page's space: what they carry is what the model says, and the arc turns as the torque does."""

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.sensors.load_cells.model import with_changes
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.view import LoadCellLayer, loads
from palpate.surfaces import EllipticCylinder
from palpate.viewer.marker import arc, barbs
from palpate.viewer.scene import prepare
from palpate.viewer.scene3d import DrawSettings
from palpate.viewer.server import Page
from palpate_lab.simulation.ball_on_ellipse import FINGERTIP
from palpate_lab.simulation.cell_array import LAYOUTS

CELLS = nominal_cells(LAYOUTS[4], 10.0, 1e-4)
TIP = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)


def _contacts(count: int = 20) -> Contacts:
    """A ball that is pushed along the middle, from one pair of cells to the other, and twisted to and fro."""
    point, normal = FINGERTIP.foot(np.zeros(count), np.linspace(-10e-3, 10e-3, count))
    estimate = ContactEstimate(
        point=point,
        normal=normal,
        force=-2.0 * normal,
        torque=np.linspace(-3e-3, 3e-3, count),
        covariance=np.zeros((count, 3, 3)),
        residual=np.zeros(count),
        candidates=np.ones(count, dtype=np.int64),
        status=np.zeros(count, dtype=np.int8),
    )
    return Contacts.single(0.01 * np.arange(count), estimate)


def test_a_push_above_a_pair_of_cells_loads_that_pair() -> None:
    found = _contacts()
    carried = loads(CELLS, found.point, found.normal, found.force, np.zeros(20))
    assert np.all(carried[0, :2] > 5 * carried[0, 2:])
    np.testing.assert_allclose(carried, carried[::-1][:, [2, 3, 0, 1]], atol=1e-15)  # it goes as far as it came
    middle = loads(CELLS, *(np.array(v) for v in ([0, 0, 5e-3], [0, 0, 1.0], [0, 0, -2.0], 0.0)))
    np.testing.assert_allclose(middle, 0.5 / 10.0)  # V: a quarter of 2 N, at 10 N/V


@pytest.mark.parametrize("share", [0.5, -0.5])
def test_an_arc_turns_the_way_of_the_torque_and_as_far(share: float) -> None:
    segments = arc(share)
    np.testing.assert_array_equal(segments[1:, 0], segments[:-1, 1])
    axis = np.cross(segments[:, 0] * [1, 1, 0], segments[:, 1] * [1, 1, 0])[:, 2]
    assert np.all(np.sign(axis) == np.sign(share))
    ends = [np.arctan2(place[1], place[0]) for place in (segments[0, 0], segments[-1, 1])]
    assert (ends[1] - ends[0]) == pytest.approx(0.75 * np.pi * np.sign(share))
    full = arc(9.0)
    np.testing.assert_allclose(full[0, 0], full[-1, 1], atol=1e-15)  # never more than once round


@pytest.mark.parametrize("share", [0.5, -0.5])
def test_an_arc_ends_in_an_arrow(share: float) -> None:
    """Four barbs from its tip, as long as each other, back against its way, and together no way aside."""
    last = arc(share)[-1]
    way = (last[1] - last[0]) / np.linalg.norm(last[1] - last[0])
    head = barbs(last)
    np.testing.assert_array_equal(head[:, 0], np.tile(last[1], (4, 1)))
    back = head[:, 1] - head[:, 0]
    np.testing.assert_allclose(back @ way, -0.03)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), np.hypot(0.03, 0.014))
    np.testing.assert_allclose(back.mean(axis=0), -0.03 * way, atol=1e-12)
    assert len(np.unique(back.round(6), axis=0)) == 4


def test_the_page_colours_the_cell_that_carries_most_and_shows_the_torque() -> None:
    layer = LoadCellLayer(CELLS)
    scene = prepare(TIP, _contacts(), "fingertip", [layer])
    settings = DrawSettings(heat=True, trail=1.0, magnification=1)
    with Page(scene, port=0, together=True) as page:
        page.session.scene3d.show(scene.at(0), settings)
        near, far = (sum(layer._drawn[cell].color) for cell in (0, 3))
        assert near < far  # darker
        assert [name for name, _ in layer.rows(scene, 0)] == ["cell 1", "cell 2", "cell 3", "cell 4"]
        assert layer.rows(scene, 0)[0][1].endswith(" mV")
        arrow = page.session.scene3d._markers[0]._arc
        assert arrow.visible
        assert arrow.points[0, 1, 1] < 0  # against the clock about the normal is positive
        page.session.scene3d.show(scene.at(10), settings)
        assert arrow.points[0, 1, 1] > 0


def test_cells_whose_places_are_not_known_are_not_drawn() -> None:
    layer = LoadCellLayer(with_changes(CELLS, positions=np.full((4, 3), np.nan)))
    with Page(prepare(TIP, _contacts(), "", [layer]), port=0, together=True):
        assert layer._drawn == []
