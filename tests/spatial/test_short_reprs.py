"""What a person prints fits on a line, says what it is in its units, and never spills an array."""

import numpy as np
import pytest

import palpate
from palpate.signals.recording import FORCE, TORQUE
from palpate.spatial.shown import one_line

LINE = 200  # characters: a line of a wide terminal


@pytest.fixture(scope="module")
def cube() -> palpate.Mesh:
    """20 mm a side."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.01
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return palpate.Mesh.from_arrays(corners, faces)


@pytest.fixture(scope="module")
def contacts(cube: palpate.Mesh) -> palpate.Contacts:
    """Two touches of the upper side, 0.1 s each, a sample in 5 ms; the second 3 mm along x, with twice the force."""
    time = 0.005 * np.arange(80)
    pressed = np.where((time > 0.095) & (time < 0.2), 1.0, np.where(time > 0.295, 2.0, 0.0))
    force = pressed[:, None] * [0.0, 0.0, -1.0]
    point = np.where(pressed[:, None] == 2.0, [0.003, 0.0, 0.01], [0.0, 0.0, 0.01])
    wrenches = np.hstack([force, np.cross(point, force)])
    estimate = palpate.Locator(cube, noise=[0.01] * 3 + [1e-4] * 3).run(wrenches)
    return palpate.Contacts.single(time, estimate)


def _is_short(text: str, *words: str) -> None:
    assert "\n" not in text
    assert len(text) <= LINE
    assert "array(" not in text
    assert [word for word in words if word not in text] == []


def test_a_payload_prints_no_covariance() -> None:
    weight = [0.0, 0.0, -9.80665]
    payload = palpate.Payload(*np.array([weight, [1, 2, 3], [0, 0, 0.05], [0.1, 0, 0]]), samples=1200)
    _is_short(repr(payload), "1 kg", "(0.0, 0.0, 50.0) mm", "(1.000, 2.000, 3.000) N", "1,200 samples")
    _is_short(repr(palpate.Payload(*np.zeros((4, 3)))), "no weight")


def test_a_mesh_and_what_holds_it_say_how_large_it_is(cube: palpate.Mesh) -> None:
    _is_short(repr(cube), "8 vertices", "12 facets", "20 x 20 x 20 mm")
    _is_short(repr(palpate.Locator(cube)), "Mesh(", "soft_finger", "no noise")


def test_candidates_say_where_they_are() -> None:
    points, ones = 0.001 * np.arange(15.0).reshape(5, 3), np.ones(5)
    found = palpate.Candidates(points, points.copy(), ones, ones.copy(), np.array([True, False, False, False, False]))
    _is_short(repr(found), "1 of 5 plausible: (0.0, 1.0, 2.0)", "and 2 more mm")


def test_a_recording_and_its_sensor_name_channels_and_zero() -> None:
    recording = palpate.Recording(
        0.1 * np.arange(5), {FORCE: np.zeros((5, 3)), TORQUE: np.zeros((5, 3))}, source="a.csv"
    )
    _is_short(repr(recording), "5 samples", "0.000 to 0.400 s", FORCE, "'a.csv'")
    sensor = palpate.Compensation(palpate.ForceTorque([0.1] * 6), palpate.Payload(*np.zeros((4, 3))))
    _is_short(repr(sensor), "ForceTorque(", "no weight")


def test_contacts_count_and_a_notebook_lists_touches(contacts: palpate.Contacts) -> None:
    _is_short(repr(contacts), "80 rows", "0.000 to 0.395 s", "40 contact")
    shown = contacts.noted(["a <note>"])._repr_html_()
    assert shown.count("<tr>") == 3  # a header and two touches
    assert "<td>3.00</td>" in shown
    assert "a &lt;note&gt;" in shown
    assert len(shown) < 2000
    assert repr(contacts[:0]) == "Contacts(no rows)"
    assert "<table>" not in contacts[:0]._repr_html_()


def test_a_value_leaves_out_what_is_empty_and_says_the_shape_of_the_rest() -> None:
    mounting = palpate.Mounting(palpate.Pose.identity(), np.eye(6), 0.9, ("x",), (), np.arange(12))
    _is_short(repr(mounting), "covariance=<6 x 6>", "residual=0.9", "touches=<12>")
    assert "unobservable" not in repr(mounting)
    with pytest.raises(TypeError, match="no fields"):
        one_line(3)
