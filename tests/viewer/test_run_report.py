"""The report of a run and of two side by side: its figures are those of the contacts, and so is what it suggests."""

import json
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

from palpate.cli.report import judged, status_advice
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.events import Events
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.locate import Locator
from palpate.contact.origins import Origins
from palpate.contact.touch_finder import find_touches
from palpate.errors import InputError
from palpate.sensors.force_torque.view import force_torque, wrench_advice
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.view import load_cells
from palpate.sensors.taxels.view import taxel_section
from palpate.setup import Rig
from palpate.setup.tables import RigEstimate, RigPair, RigSurface, RigThresholds
from palpate.setup.wrench_table import RigForceTorque, RigNoise
from palpate.setup.wrench_view import wrench_settings
from palpate.spatial.pose import Pose
from palpate.viewer.batch_summary import LogResult, figures
from palpate.viewer.batch_summary import compose as compose_batch
from palpate.viewer.captions import MEANING
from palpate.viewer.drawing import FACETS, Drawing, Mark, simpler
from palpate.viewer.heat import FineMesh
from palpate.viewer.report import ReportTable, Section, render
from palpate.viewer.robot_report import EstimatedRobot, compose_robot
from palpate.viewer.run_compare import compared, partners
from palpate.viewer.run_report import Run, compose
from palpate.viewer.run_summary import RunSummary
from palpate_lab.simulation.cell_array import LAYOUTS
from tests.support.pages import BODY, ellipsoid, session

RIG = Rig(
    RigSurface(kind="plane", half_width=0.1),
    sensors={"force_torque": RigForceTorque(noise=RigNoise(0.02, 0.001), range=RigPair(200.0, 10.0))},
    estimate=RigEstimate(contact=RigThresholds(0.5, 0.3)),
)
N = 1_000
TIME = np.arange(N) / 100.0
TRUTH = np.column_stack([0.01 * np.sin(TIME), np.zeros(N), np.zeros(N)])


def _rows(status: int = Status.CONTACT) -> np.ndarray:
    """Points 3 mm off along x, with ellipses of 1 mm (one standard deviation); the strongest push at 7 s."""
    rows = np.zeros((N, ROW.length))
    rows[:, ROW.point] = TRUTH + np.array([3e-3, 0.0, 0.0])
    rows[:, ROW.normal] = rows[:, ROW.force] = [0.0, 0.0, 1.0]
    rows[700, ROW.force] = [0.0, 0.0, 42.0]
    rows[:, ROW.covariance] = np.diag([1e-6, 1e-6, 0.0]).reshape(-1)
    rows[:, ROW.status] = status
    return rows


def _run(rows: np.ndarray | None = None, **more: object) -> Run:
    kept = RunSummary()
    kept.add(Contacts.single(TIME, ContactEstimate.from_rows(_rows() if rows is None else rows)))
    return Run("log.csv", "contacts.csv", "located on a plane", kept, **more)


def _section(run: Run, title: str) -> Section:
    return next(section for section in compose(run).sections if section.title == title)


def _tiles(run: Run) -> dict[str, str]:
    return {tile.name: tile.value for tile in compose(run).tiles}


def test_the_tiles_are_the_run() -> None:
    """By construction: all answered, 42 N at most, 3 mm off, and 95 % of a 1 mm normal within 2.448 mm."""
    truth = TrueSamples(TIME, TRUTH)
    tiles = _tiles(judged(_run(), truth))
    assert tiles == {
        "samples": "1,000",
        "answered": "100.0 %",
        "peak force": "42 N",
        "touches": "1",
        "95 % radius": "2.4 mm",
        "location error": "3.00 mm",
        "truth in the ellipse": "0.0 %",
    }


def test_touches_are_compared_with_their_marks() -> None:
    rows = _rows()
    rows[:, ROW.point] = [3e-3, 0.0, 0.0]
    truth = TrueTouches(np.array([1.0, 5.0]), np.array([2.0, 6.0]), np.zeros((2, 3)), ("one", "two"))
    found = _section(judged(_run(rows), truth), "Against the ground truth")
    assert len(found.pictures) == 2
    assert found.tables[0].rows[0][1:] == ("3.000", "3.000", "3.000", "3.000", "2")


def test_a_truth_of_another_time_is_said() -> None:
    found = _section(judged(_run(), TrueSamples(TIME + 1e6, TRUTH)), "Against the ground truth")
    assert "No sample matches" in found.text[0]


@pytest.mark.parametrize("kind", [Status.AMBIGUOUS, Status.TOO_LIGHT, Status.NO_POSE])
def test_a_log_of_one_status_makes_a_page_that_explains_it(kind: Status) -> None:
    """A log of which every sample ended the same way, as the chain would leave its numbers."""
    rows = _rows(kind)
    if kind not in (Status.CONTACT, Status.AMBIGUOUS):
        rows[:, ROW.point] = rows[:, ROW.covariance] = np.nan
    if kind in (Status.SATURATED, Status.INVALID, Status.NO_POSE):
        rows[:, ROW.force] = np.nan
    assert f"1,000 samples. {MEANING[kind]}" in render(compose(judged(_run(rows))))
    assert set(MEANING) == set(Status)


def test_advice_follows_from_what_is_missing() -> None:
    said = " ".join(wrench_advice(RIG.resolve(), payload=False, filtered=False, radius=2e-3))
    assert "Identify the payload" in said
    assert "Calibrate the mounting" in said
    assert "no filter is in force" in said
    covariance = tuple(tuple(row) for row in (1e-6 * np.eye(6)).tolist())
    better = replace(RIG, surface=replace(RIG.surface, pose_covariance=covariance))
    assert wrench_advice(better.resolve(), payload=True, filtered=True, radius=2e-3) == ()
    assert judged(_run()).advice == ("Nothing stands out: models are calibrated, and the samples are answered.",)


def test_settings_are_those_of_the_rig() -> None:
    noise = np.diag([0.02**2] * 3 + [0.001**2] * 3)
    locator = Locator(RIG.resolve().link.surface(), noise=noise, on=0.5, off=0.3)
    facts = dict(wrench_settings(RIG.resolve(), locator, noise, "butterworth, 5 Hz"))
    assert facts["method"] == "soft finger"
    assert facts["surface"].startswith("a plane, ")
    tube = RigSurface(kind="elliptic_cylinder", a=0.02, b=0.01, half_length=0.03)
    assert replace(RIG, surface=tube).resolve().link.name == "an elliptic cylinder"
    assert facts["a contact"] == "begins at 0.5 N, ends at 0.3 N"
    assert facts["noise of a reading"].startswith("0.02 N and 0.001 N m")
    assert facts["filter"] == "butterworth, 5 Hz"
    models = dict(force_torque(RIG.resolve(), None, Pose.identity()).settings)
    assert models["payload"].startswith("none")
    assert models["mounting"] == "(0.00, 0.00, 0.00) mm, not calibrated"


def test_load_cells_say_which_are_left_out_and_what_is_wrong() -> None:
    cells = nominal_cells(LAYOUTS[4], 10.0, 1e-4)
    found = load_cells(cells, excluded=(3,), warnings=("no zero was taken", "cell 3 is dead"))
    assert dict(found.settings)["left out"] == "cell 3"
    assert dict(found.settings)["noise"].startswith("0.1 mV")
    assert found.points[:2] == ("no zero was taken", "cell 3 is dead")


def _two_at_once() -> Contacts:
    """10 samples, each with a contact at the truth and a stronger one 20 mm beside it."""
    rows = np.zeros((20, ROW.length))
    rows[1::2, ROW.point] = [0.02, 0.0, 0.0]
    rows[:, ROW.normal] = [0.0, 0.0, 1.0]
    rows[:, ROW.force] = np.where(np.arange(20)[:, None] % 2, [0.0, 0.0, -2.0], [0.0, 0.0, -1.0])
    rows[:, ROW.covariance] = np.diag([1e-6, 1e-6, 0.0]).reshape(-1)
    sample, identity = np.repeat(np.arange(10), 2), np.tile([1, 2], 10)
    features = {"row": np.tile([1.0, 2.0], 10), "column": np.tile([3.0, 4.0], 10), "area": np.full(20, 2e-4)}
    return Contacts(sample, sample / 10, identity, ContactEstimate.from_rows(rows), features)


def test_of_two_contacts_at_once_the_one_at_the_truth_is_judged() -> None:
    kept = RunSummary()
    kept.add(_two_at_once())
    run = judged(Run("log.csv", "contacts.csv", "", kept), TrueSamples(np.arange(10) / 10, np.zeros((10, 3))))
    tiles = _tiles(run)
    assert tiles["location error"] == "0.00 mm"
    assert (tiles["samples"], tiles["contacts at once"], tiles["peak force"]) == ("10", "2", "2 N")
    table = _section(run, "Touches").tables[0]
    assert table.header[:2] == ("touch", "contact")
    assert table.header[-1] == "contact area [cm²]"
    assert [row[1] for row in table.rows] == ["1", "2"]
    assert [row[-1] for row in table.rows] == ["2", "2"]


def test_taxels_show_contacts_on_the_unrolled_sheet_where_there_is_one() -> None:
    found = taxel_section(_two_at_once(), (("dead", "cell (0, 1)"),), (6, 22), ("a note",))
    assert len(found.pictures) == 1
    assert (found.settings, found.points) == ((("dead", "cell (0, 1)"),), ("a note",))
    assert taxel_section(_two_at_once(), (), None, ()).pictures == ()


@pytest.mark.parametrize("kind", [Status.NO_POSE, Status.SATURATED, Status.INVALID, Status.OFF_SURFACE])
def test_advice_follows_from_what_went_wrong(kind: Status) -> None:
    counts = np.zeros(len(Status), dtype=np.int64)
    counts[[Status.CONTACT, kind]] = 900, 100
    said = status_advice(counts)
    assert any(sentence.startswith("10.0 % of the") and kind.words in sentence for sentence in said)


def test_the_page_holds_inputs_warnings_and_the_time_budget() -> None:
    made = {"palpate": "0.1.0", "log": "log.csv sha256:abc"}
    run = _run(provenance=made, notes=("a note",), warnings=("careful <b>",), stages={"read": 0.001, "locate": 0.003})
    page = render(compose(judged(run)))
    assert "careful &lt;b&gt;" in page
    assert "log.csv, SHA-256 abc" in page
    assert all(f">{cell}</td>" in page for cell in ("locate", "0.003", "3.00", "75.0 %", "4.00", "100.0 %"))
    assert len(page) < 2_000_000


@pytest.mark.parametrize("frame", ["base", "surface"])
def test_a_robot_s_report_has_its_sensors_and_touches(frame: str) -> None:
    """By construction one touch of 42 N, whose deviation is 1 mm, and a sensor that nothing touches."""
    felt, still = (_run(_rows(status)).summary for status in (Status.CONTACT, Status.NO_CONTACT))
    touched, facets = frame == "base", np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    touches = (felt if touched else still).finder.touches()
    touches = replace(touches, origins=Origins.of_names(["a"] * touched, ["link"] * touched))
    body, mark = FineMesh(np.eye(4, 3), -np.eye(4, 3), facets), Mark(np.zeros(3), np.array([0.0, 0, 1]), "it was here")
    table, summaries = ReportTable(("sensor",), (("a",), ("b",))), {"a": felt, "b": still}
    drawn = (body, (mark,)) if touched else (None, ())
    made = compose_robot(EstimatedRobot("l", "o", frame, (), table, summaries, touches, *drawn, "No touch was found."))
    tiles = [(tile.value, tile.word) for tile in made.tiles]
    known = [("42 N", "a, touch 1"), ("1 mm", "median of the touches")]
    assert tiles == [("2", ""), (f"{+touched}", f"of {+touched} sensors"), *known[: 2 * touched]]
    assert ("No touch was found." in render(made)) != touched
    assert ("in the base frame" in made.footer) == touched
    assert made.summary.startswith("2,000 readings of 2 sensors were read from l;")


def test_the_report_of_a_batch_counts_its_logs() -> None:
    """One that is whole, one that is cut off, of the same warning, and one that failed."""
    counts = tuple(900 * (kind == Status.CONTACT) + 100 * (kind == Status.NO_POSE) for kind in Status)
    whole = LogResult("a.csv", "a.parquet", 1000, 900, 2, 1.5, counts, ("careful",))
    torn = replace(whole, log="b.csv", peak=4.25, warnings=("careful", "hot"), ended="torn")
    made = compose_batch([whole, torn, LogResult("c.csv", failure="is empty.")], (("rig", "r.toml"),))
    assert [tile.value for tile in made.tiles] == ["2", "1", "2,000", "4", "4.25 N", "2"]
    assert (made.tiles[0].word, made.tiles[0].tone, made.tiles[1].tone) == ("of 3", "poor", "poor")
    sections = {each.title: each for each in made.sections}
    assert sections["Logs that failed"].tables[0].rows == (("c.csv", "is empty."),)
    assert sections["All logs"].tables[0].rows == (
        ("a.csv", "1,000", "900", "2", "1.50", "contact 90.0 %, no pose 10.0 %", "1", "a.parquet"),
        ("b.csv", "1,000", "900", "2", "4.25", "contact 90.0 %, no pose 10.0 %", "2", "a.parquet (the log is cut off)"),
        ("c.csv", "0", "0", "0", "-", "", "0", "is empty."),
    )
    assert sections["Warnings"].tables[0].rows == (("careful", "2", "a.csv, b.csv"), ("hot", "1", "b.csv"))
    assert sections["Samples of all logs"].settings == (("contact", "90.0 %, 1,800"), ("no pose", "10.0 %, 200"))
    assert sections["Settings"].settings == (("rig", "r.toml"),)
    assert ("cut off", "1", 1.0) in figures([whole, torn])


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
