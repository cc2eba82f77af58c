"""Two runs side by side, and drawings that turn: what is said of them follows from the contacts."""

import json
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.events import Events
from palpate.contact.touch_finder import find_touches
from palpate.errors import InputError
from palpate.viewer.drawing import FACETS, Drawing, simpler
from palpate.viewer.run_compare import compared, partners
from palpate.viewer.run_report import Run
from palpate.viewer.run_summary import RunSummary
from tests.support.pages import BODY, ellipsoid, session


def _moved(by: float, later: float = 0.0) -> Contacts:
    """The session with every point [m] and time [s] off."""
    found = session()
    off = replace(found.estimate, point=found.estimate.point + np.array([0.0, 0.0, by]))
    return replace(found.with_estimate(off), time=found.time + later)


def _summary(contacts: Contacts) -> RunSummary:
    made = RunSummary()
    made.add(contacts)
    return made


def test_a_run_of_another_time_is_refused() -> None:
    with pytest.raises(InputError, match=r"csv: .*no time in common"):
        compared(Run("log", "ours.csv", "done", _summary(session())), "late.csv", _summary(_moved(0.0, 100.0)))


def test_a_touch_without_a_partner_has_none() -> None:
    ours, theirs = find_touches(session()), find_touches(_moved(0.0, 3.0))
    assert partners(ours, theirs).tolist() == [-1]
    assert partners(ours, ours).tolist() == [0]


@pytest.mark.parametrize("off", [[], [3e-3], [3e-3, 1e-3], [-2e-3, 1e-3, 4e-3, 1e-3]])
def test_of_touches_at_the_same_time_the_nearest_is_the_partner(off: list[float]) -> None:
    """As of two contacts in a sample; of none it is none, and of equally near ones the first."""
    ours, one = find_touches(session()), find_touches(_moved(0.0))
    moved = [replace(one, point=one.point + np.array([0.0, 0.0, by])) for by in off]
    theirs = Events.joined(moved) if moved else find_touches(_moved(0.0)[:0])
    nearest = [int(np.argmin(np.abs(off)))] if off else [-1]
    assert partners(ours, theirs).tolist() == nearest
    assert partners(theirs, ours).tolist() == [0] * len(off)


def test_a_drawing_holds_the_body_and_the_touches() -> None:
    """Vertices come back to 1/65535 of the size; nothing in it is an address."""
    mesh, found = ellipsoid(500), session()
    html = found.plot(mesh).html()
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', html).group(1))
    packed = np.frombuffer(b64decode(data["vertices"]), np.uint16).reshape(-1, 3) / 65535 - 0.5
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    assert np.abs(packed * size + middle - mesh.vertices[np.unique(mesh.faces)]).max() < size / 65535
    (mark,) = data["marks"]
    assert mark["label"] == "1"
    assert np.linalg.norm(mark["force"]) == pytest.approx(0.3, abs=1e-3)
    assert "http" not in html
    single = found.estimate[200].plot()
    assert len(json.loads(re.search(r"json\">(.*?)</script>", single.html()).group(1))["marks"][0]["rim"]) == 48
    assert "<iframe srcdoc=" in mesh.plot()._repr_html_()
    assert Drawing.of(None).html()  # nothing at all is no error


def test_a_simpler_mesh_is_near_the_finer_one() -> None:
    vertices, faces = BODY.mesh(40_000)
    points, few = simpler(vertices, faces, FACETS)
    assert FACETS / 4 < len(few) <= FACETS
    assert np.abs((points / BODY.axes) ** 2 @ np.ones(3) - 1).max() < 0.05


def test_two_runs_are_set_side_by_side() -> None:
    """The same touch 2 mm higher and 0.5 s later, and one more that is the other's alone."""
    moved = _moved(2e-3, 0.5)
    alone = replace(moved, time=moved.time + 100.0, sample=moved.sample + 400)
    run = Run("log", "ours.csv", "done", _summary(session()), body=BODY.mesh(500))
    section = compared(run, "theirs.csv", _summary(Contacts.joined([moved, alone]))).sections[0]
    figures, touches = section.tables
    assert figures.header == ("", "ours.csv", "theirs.csv")
    assert figures.rows[:3] == (
        ("samples", "400", "800"),
        ("answered, of the loaded", "100.0 %", "100.0 %"),
        ("touches", "1", "2"),
    )
    assert figures.rows[3] == ("peak force [N]", "4.25", "4.25")
    assert figures.rows[4][1] == figures.rows[4][2] == f"{1e3 * run.kept.median_radius:.3g}"
    ((*row, apart, later),) = touches.rows
    assert (row, later) == (["1", "101.000", "4.248", "1", "4.248"], "+0.500")
    assert float(apart) == pytest.approx(2.0, abs=0.5)  # it moves, and another of its samples may be the middle
    assert touches.caption == "Touches of the other run that have no match here: 2."
    assert [each.caption.rpartition(" in ")[2] for each in section.pictures] == ["ours.csv.", "theirs.csv."] * 2
    none = compared(run, "theirs.csv", _summary(_moved(0.0)[:50])).sections[0].tables[1]
    assert none.rows[0][3:] == ("none", "-", "-", "-")
