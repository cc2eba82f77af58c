"""The report of a run: its figures are those of the run, and what it suggests follows from what went wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.cli.report import Run, compose, write_report
from palpate.cli.report_advice import MEANING, advice
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.events import find_touches
from palpate.contact.truth import Samples, Touches
from palpate.io.rig import Rig, build
from palpate.io.rig.surface import RigSurface
from palpate.io.rig.tables import RigEstimate, RigFilter, RigForceTorque, RigPair, RigThresholds
from palpate.sensors.force_torque import Payload
from palpate.viewer.report import Section
from palpate.viewer.thinned import Thinned

RIG = Rig(
    RigSurface(kind="plane", half_width=0.1),
    force_torque=RigForceTorque(noise=RigPair(0.02, 0.001), range=RigPair(200.0, 10.0)),
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


def _run(rows: np.ndarray | None = None, rig: Rig = RIG, **more: object) -> Run:
    thinned = Thinned()
    thinned.add(TIME, ContactEstimate.from_rows(_rows() if rows is None else rows))
    return Run("log.csv", "contacts.csv", rig, build(rig, rate=100.0), thinned, **more)


def _advice(rig: Rig) -> tuple[str, ...]:
    """For 1,000 located samples, and ellipses of 2 mm; with a payload where the mounting is calibrated."""
    counts = np.zeros(len(Status), dtype=np.int64)
    counts[Status.CONTACT] = N
    estimator = build(rig, rate=100.0)
    if rig.surface.pose_covariance is not None:
        estimator.sensor.payload = Payload(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3))
    return advice(rig, estimator, counts, None, 2e-3)


def _section(run: Run, title: str) -> Section:
    return next(section for section in compose(run).sections if section.title == title)


def _tiles(run: Run) -> dict[str, str]:
    return {tile.name: tile.value for tile in compose(run).tiles}


def test_the_tiles_are_the_run() -> None:
    """By construction: all answered, 42 N at most, 3 mm off, and 95 % of a 1 mm normal within 2.448 mm."""
    truth = Samples(TIME, TRUTH)
    estimate = ContactEstimate.from_rows(_rows())
    tiles = _tiles(_run(truth=truth, touches=find_touches(TIME, estimate)))
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
    truth = Touches(np.array([1.0, 5.0]), np.array([2.0, 6.0]), np.zeros((2, 3)), ("one", "two"))
    found = _section(_run(rows, truth=truth), "Against the truth")
    assert len(found.pictures) == 2
    assert found.tables[0].rows[0][1:] == ("3.000", "3.000", "3.000", "3.000", "2")


def test_a_truth_of_another_time_is_said() -> None:
    found = _section(_run(truth=Samples(TIME + 1e6, TRUTH)), "Against the truth")
    assert "No sample matches" in found.text[0]


@pytest.mark.parametrize("kind", [Status.AMBIGUOUS, Status.TOO_LIGHT, Status.NO_POSE])
def test_a_log_of_one_status_makes_a_page_that_explains_it(kind: Status, tmp_path: Path) -> None:
    """A log of which every sample ended the same way, as the chain would leave its numbers."""
    rows = _rows(kind)
    if kind not in (Status.CONTACT, Status.AMBIGUOUS):
        rows[:, ROW.point] = rows[:, ROW.covariance] = np.nan
    if kind in (Status.SATURATED, Status.INVALID, Status.NO_POSE):
        rows[:, ROW.force] = np.nan
    write_report(tmp_path / "report.html", _run(rows))
    assert f"1,000 samples. {MEANING[kind]}" in (tmp_path / "report.html").read_text()
    assert set(MEANING) == set(Status)


def test_advice_follows_from_what_is_missing() -> None:
    said = " ".join(_advice(RIG))
    assert "Identify the payload" in said
    assert "Calibrate the mounting" in said
    assert "no filter is in force" in said  # the ellipses are 2.4 mm
    covariance = tuple(tuple(row) for row in (1e-6 * np.eye(6)).tolist())
    better = replace(
        RIG,
        surface=replace(RIG.surface, pose_covariance=covariance),
        filter=RigFilter(kind="butterworth", cutoff=5.0),
    )
    assert _advice(better) == ("Nothing stands out: models are calibrated, and the samples are answered.",)
    assert "5 Hz" in dict(_section(_run(rig=better), "Settings in force").facts)["filter"]


@pytest.mark.parametrize("kind", [Status.NO_POSE, Status.SATURATED, Status.INVALID, Status.OFF_SURFACE])
def test_advice_follows_from_what_went_wrong(kind: Status) -> None:
    counts = np.zeros(len(Status), dtype=np.int64)
    counts[[Status.CONTACT, kind]] = 900, 100
    said = advice(RIG, build(RIG), counts, None, 0.0)
    assert any(sentence.startswith("10.0 % of the") and kind.label in sentence for sentence in said)


def test_the_page_holds_inputs_warnings_and_the_time_budget(tmp_path: Path) -> None:
    made = {"palpate": "0.1.0", "log": "log.csv sha256:abc"}
    run = _run(provenance=made, notes=("a note",), warnings=("careful <b>",), stages={"read": 0.001, "locate": 0.003})
    write_report(tmp_path / "report.html", run)
    page = (tmp_path / "report.html").read_text()
    assert "careful &lt;b&gt;" in page
    assert "log.csv, SHA-256 abc" in page
    assert all(f"<td>{cell}</td>" in page for cell in ("locate", "0.003", "3.00", "75.0 %", "4.00", "100.0 %"))
    assert len(page) < 2_000_000
