"""Every number on a page, in a report, on the terminal and in a file is the value it comes from, with its unit."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

import palpate
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95, Status
from palpate.contact.origins import Origin
from palpate.viewer import captions, live, notebook, run_compare, run_report
from palpate.viewer.batch_summary import LogResult
from palpate.viewer.batch_summary import compose as compose_batch
from palpate.viewer.captions import caption, comparison, touch_list
from palpate.viewer.live import StreamFigures
from palpate.viewer.report import Report, ReportTable, Section, render
from palpate.viewer.robot_report import EstimatedRobot, compose_robot
from palpate.viewer.run_compare import compared
from palpate.viewer.run_report import Run, compose
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.samples import sheet_places
from palpate.viewer.scene import prepare
from tests.conformance.fields import run
from tests.support.felt import FEATURES, FREE, START, TOUCHES, felt, known
from tests.support.pages import ellipsoid
from tests.support.shown import assert_columns, assert_told, plain, tables

K, ROWS, LATE = known(), len(felt()), sum(each.late for each in TOUCHES)
FELT = sum(each.count for each in TOUCHES)
LOADED = ROWS - sum(FREE[kind] for kind in (Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID, Status.NO_POSE))
WORDS = (  # of each of FEATURES, in words, and what a person counts it in
    "contact area [cm²]",
    "its cells, sum [N]",
    "peak pressure [kPa]",
    "mean pressure [kPa]",
    "spread, long axis [mm]",
    "spread, short axis [mm]",
    "spread, angle [°]",
    "cells pressed",
    "sheet row, from 0 [cells]",
    "sheet column, from 0 [cells]",
)
SCALES = (1e4, 1.0, 1e-3, 1e-3, 1e3, 1e3, 180.0 / np.pi, 1.0, 1.0, 1.0)
VALUES = {words: scale * K[name] for words, scale, name in zip(WORDS, SCALES, FEATURES, strict=True)}
OF_TOUCHES = {
    "touch": np.arange(1.0, 4.0),
    "contact": K["identity"],
    "start [s]": K["start"],
    "end [s]": K["end"],
    "lasts [s]": K["end"] - K["start"],
    "peak [N]": K["peak_force"],
    **{f"{axis} [mm]": 1e3 * K["point"][:, k] for k, axis in enumerate("xyz")},
    "sd [mm]": 1e3 * K["deviation"],
    "+- [mm]": 1e3 * K["deviation"],
    "slid [mm]": 1e3 * K["slid"],
    "ambiguous [%]": 1e2 * K["ambiguous"],
    **VALUES,
    **{f"{name}{words.partition(' [')[1]}{words.rpartition(' [')[2]}" if " [" in words else name: values
       for name, (words, values) in zip(FEATURES, VALUES.items(), strict=True)},
}  # fmt: skip


def _summary(contacts: Contacts) -> RunSummary:
    made = RunSummary()
    made.add(contacts)
    return made


def _section(report: Report, title: str) -> Section:
    return next(each for each in report.sections if each.title == title)


def _table(table: ReportTable, values: dict[str, np.ndarray]) -> None:
    assert_columns(table.header, table.rows, values)


def test_touches_are_those_that_were_made() -> None:
    """What the other tests hold the shown numbers against."""
    found = felt().touches()
    for name, values in K.items():
        there = found.features[name] if name in FEATURES else getattr(found, name)
        np.testing.assert_allclose(there, values, rtol=1e-12, err_msg=name)


@pytest.fixture(scope="module")
def report() -> Report:
    stages = {"reading": 1.5, "locating": 0.25}
    return compose(Run("log.csv", "out.csv", "at once", _summary(felt()), stages=stages))


def test_a_report_says_what_was_felt(report: Report) -> None:
    tiles = {tile.name: (f"{tile.value}; {tile.word}") for tile in report.tiles}
    peak = int(np.argmax(K["peak_force"]))
    assert_told(report.summary, ROWS)
    assert_told(tiles.pop("samples"), ROWS, (ROWS - 1) / 128.0, 128.0)
    assert_told(tiles.pop("answered"), 1e2 * FELT / LOADED, LOADED)
    assert_told(tiles.pop("peak force"), K["peak_force"][peak], K["peak_time"][peak])
    assert_told(tiles.pop("touches"), 3)
    radii = np.repeat(K["deviation"], [each.count for each in TOUCHES])
    assert_told(tiles.pop("95 % radius"), 1e3 * np.sqrt(CHI2_95) * np.median(radii))
    assert not tiles
    counted = {kind.words: number for kind, number in (FREE | {Status.AMBIGUOUS: LATE}).items()}
    stated = dict(_section(report, "Statuses").settings)
    assert stated.keys() == counted.keys() | {"contact"}
    for words, said in stated.items():
        assert_told(said.partition(".")[0], counted.get(words, FELT - LATE))
    _table(_section(report, "Touches").tables[0], OF_TOUCHES)
    spent = np.array([1.5, 0.25, 1.75])
    budget = _section(report, "Time budget").tables[0]
    assert [row[0] for row in budget.rows] == ["reading", "locating", "all"]
    shares = {"time [s]": spent, "per sample [µs]": 1e6 * spent / ROWS, "share": 1e2 * spent / 1.75}
    assert_columns(budget.header[1:], [[cell.removesuffix(" %") for cell in row[1:]] for row in budget.rows], shares)


def test_a_page_has_every_cell_and_tile_of_its_report(report: Report) -> None:
    page = render(report)
    stated = [table for section in report.sections for table in section.tables]
    assert tables(page) == [[list(table.header), *map(list, table.rows)] for table in stated]
    for tile in report.tiles:
        assert re.search(rf'name">{tile.name}</div>.*?value">{tile.value}</div>.*?word">{tile.word}</div>', page)
    for section in report.sections:
        for name, value in section.settings:
            assert f"<dt>{name}</dt><dd>{value}</dd>" in page


def _other() -> Contacts:
    """The same, off by 1 to 3 mm and 0.05 s, and a fifth harder; touches 1 and 2 come in the other order of places."""
    found = felt()
    off = 1e-3 * found.identity[:, None] * np.array([0.0, 0.6, 0.8])
    moved = replace(found.estimate, point=found.estimate.point + off, force=1.2 * found.estimate.force)
    return replace(found.with_estimate(moved), time=found.time + 0.05)


def test_a_comparison_is_of_each_touch_with_its_partner() -> None:
    ours, theirs = _summary(felt()), _summary(_other())
    figures, touches = compared(Run("log", "ours", "at once", ours), "theirs", theirs).sections[0].tables
    rows, radius = {row[0]: " ".join(row[1:]) for row in figures.rows}, 1e3 * np.sqrt(CHI2_95)
    assert_told(rows.pop("samples"), ROWS, ROWS)
    assert_told(rows.pop("answered, of the loaded"), *2 * [1e2 * FELT / LOADED])
    assert_told(rows.pop("touches"), 3, 3)
    assert_told(rows.pop("peak force [N]"), *(K["peak_force"].max() * np.array([1.0, 1.2])))
    assert_told(
        rows.pop("95 % radius, median [mm]"), *2 * [radius * np.median(np.repeat(K["deviation"], [30, 50, 40]))]
    )
    assert not rows
    there = {"there": np.arange(1.0, 4.0), "peak there [N]": 1.2 * K["peak_force"], "apart [mm]": np.arange(1.0, 4.0)}
    _table(touches, OF_TOUCHES | there | {"later there [s]": np.full(3, 0.05)})


def test_of_partners_that_share_as_long_the_nearer_one_is_taken() -> None:
    """Two contacts at once, of which the first of the other run is farther away."""
    ours = felt().touches()
    pick = {name: value[:1] for name, value in vars(ours).items() if isinstance(value, np.ndarray)}
    twice = {name: np.repeat(value, 2, axis=0) for name, value in pick.items()}
    twice["point"] = twice["point"] * [[-0.5], [1.05]]
    one = replace(ours, **pick, paths=ours.paths[:1], features={})
    two = replace(ours, **twice, paths=ours.paths[:1] * 2, features={})
    assert run_compare.partners(one, two).tolist() == [1]


def test_long_lists_say_how_many_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in ((captions, "LISTED"), (run_report, "SHOWN"), (run_compare, "SHOWN"), (notebook, "_SHOWN")):
        monkeypatch.setattr(module, name, 2)
    found, summary = felt(), _summary(felt())
    assert "and 1 more" in plain(touch_list(prepare(ellipsoid(), found), START))
    assert "and 1 more touches" in plain(notebook.table_of(found))
    run_ = Run("log", "ours", "at once", summary)
    assert_told(_section(compose(run_), "Touches").tables[0].caption, 2, 3)
    assert_told(compared(run_, "theirs", summary).sections[0].tables[1].caption, 2, 3)


@pytest.mark.parametrize("touch", TOUCHES, ids=lambda touch: touch.number)
def test_a_page_says_of_a_moment_what_the_sample_has(touch: object) -> None:
    scene, k = prepare(ellipsoid(), felt()), touch.number
    scene = replace(scene, other=prepare(ellipsoid(), replace(_other(), time=felt().time), title="there"))
    row = touch.first + 20
    said = caption(scene.at(row), 3, [("a < b", "8.125 V")])
    assert_told(said.partition("<table>")[0], touch.force)
    rows = dict(tables(said)[0])
    place = np.column_stack([1e3 * touch.at, 1e3 * _deviations(touch)])
    assert_told(rows.pop("place [mm]").replace("±", " "), *place.ravel())
    assert_told(rows.pop("95 % half-axes"), *(1e3 * np.sqrt(CHI2_95) * touch.deviations), 3)
    assert_told(rows.pop("torque"), 1e3 * touch.torque)
    assert_told(rows.pop("time"), touch.time(row), row)
    assert rows.pop("a < b") == "8.125 V"
    for words, values in VALUES.items():
        name, _, unit = words.removesuffix("]").partition(" [")
        shown = rows.pop(name)
        assert_told(shown.replace(name, ""), values[k])
        assert shown.endswith(unit)
    assert not rows
    ((title, there),) = comparison(scene, scene.at(row))
    assert title == "there"
    off = 1e-3 * (k + 1) * np.array([0.0, 0.6, 0.8])
    assert_told(there, 1.2 * touch.force, *(1e3 * (touch.at + off)), k + 1, 0.2 * touch.force)


def _deviations(touch: object) -> np.ndarray:
    """[m] along x, y, z."""
    covariance = felt().covariance[touch.first]
    return np.sqrt(np.diag(covariance))


def test_lists_and_labels_of_touches_say_their_values() -> None:
    scene, found = prepare(ellipsoid(), felt()), felt()
    where = np.column_stack([found.features["row"], found.features["column"]])
    np.testing.assert_array_equal(sheet_places(found), where)
    header, *rows = tables(touch_list(scene, K["start"][1]))[0]
    shown = dict(zip(header, zip(*rows, strict=True), strict=True))
    for k, place in enumerate(shown.pop("x y z [mm]")):
        assert_told(place, *(1e3 * K["point"][k]))
    since = {"at [s]": K["peak_time"] - START}
    assert_columns(list(shown), list(zip(*shown.values(), strict=True)), OF_TOUCHES | since)
    header, *rows = tables(notebook.table_of(found))[0]
    assert_columns(header, rows, OF_TOUCHES)
    for k, mark in enumerate(notebook.marks_of(found.touches(), 9, START)):
        times = K["start"][k] - START, K["end"][k] - START
        place = 1e3 * K["point"][k]
        assert_told(mark.tooltip, k + 1, *times, K["peak_force"][k], *place, 1e3 * K["deviation"][k])
        assert mark.label == str(k + 1)
        np.testing.assert_array_equal(mark.point, K["point"][k])
    drawn = json.loads(re.search(r'json">(.*?)</script>', found.plot(ellipsoid()).html()).group(1))
    forces = [np.linalg.norm(mark["force"]) for mark in drawn["marks"]]
    assert np.argsort(forces).tolist() == np.argsort(K["peak_force"]).tolist()


def test_live_figures_are_those_of_the_stream() -> None:
    figures = StreamFigures(1234.0, (1.5e-4, 2.5e-3, 3.5e-2), 7, 11, 13.0, 17_017, tare="0.25 N")
    rows = dict(tables(live._described(figures))[0])
    assert_told(rows.pop("rate"), 1234)
    assert_told(rows.pop("latency").replace("99\xa0%", ""), 150, 2500, 35_000)
    assert_told(rows.pop("samples"), 17_017, 7, 11)
    assert rows == {"tare": "0.25 N"}
    assert_told(live._alarm(figures), 13)


def test_a_robots_report_names_the_sensor_of_each_touch() -> None:
    names = ("left", "right")
    parts = [felt().touches().with_origin(Origin(name, f"{name} hand")) for name in names]
    touches = type(parts[0]).joined(parts)
    summaries = {name: _summary(felt()) for name in names}
    made = compose_robot(EstimatedRobot("log", "out", "base", (), ReportTable((), ()), summaries, touches))
    assert_told(made.summary, 2 * ROWS, 2)
    tiles = {tile.name: f"{tile.value}; {tile.word}" for tile in made.tiles}
    best = int(np.argmax(np.repeat(K["peak_force"], 2)))
    assert_told(tiles["sensors"], 2)
    assert_told(tiles["touches"], 6, 2)
    assert_told(tiles["peak force"], K["peak_force"].max(), best + 1)
    assert_told(tiles["standard deviation"], 1e3 * np.median(K["deviation"]))
    table = _section(made, "Touches").tables[0]
    assert [row[:2] for row in table.rows] == [(name, f"{name} hand") for _ in range(3) for name in names]
    values = {name: np.repeat(value, 2) for name, value in OF_TOUCHES.items()} | {"touch": np.arange(1.0, 7.0)}
    assert_columns(table.header[2:], [row[2:] for row in table.rows], values)


def test_a_batch_counts_each_log() -> None:
    counts = [tuple(3 + 7 * k + j for j in range(len(Status))) for k in range(2)]
    results = [LogResult(f"{k}.csv", samples=100 + k, contacts=50 + k, touches=5 + k, peak=2.5 + k,
                         statuses=counts[k], warnings=("w",) * (k + 1)) for k in range(2)]  # fmt: skip
    made = compose_batch([*results, LogResult("bad.csv", failure="torn")], ())
    tiles = {tile.name: f"{tile.value}; {tile.word}" for tile in made.tiles}
    for name, values in {"logs done": (2, 3), "failed": (1,), "samples": (201,), "touches": (11,),
                         "largest force": (3.5,), "with warnings": (2,)}.items():  # fmt: skip
        assert_told(tiles.pop(name), *values)
    assert not tiles
    rows = {row[0]: dict(zip(_section(made, "All logs").tables[0].header, row, strict=True))
            for row in _section(made, "All logs").tables[0].rows}  # fmt: skip
    for k, each in enumerate(results):
        row = rows[each.log]
        for name, value in {"samples": 100 + k, "contacts": 50 + k, "touches": 5 + k, "peak [N]": 2.5 + k,
                            "warnings": k + 1}.items():  # fmt: skip
            assert_told(row[name], value)
        assert_told(row["statuses"], *(1e2 * np.array(counts[k]) / sum(counts[k])))
    both = np.sum(counts, axis=0)
    for (words, said), kind in zip(_section(made, "Samples of all logs").settings, Status, strict=True):
        assert words == kind.words
        assert_told(said, 1e2 * both[kind] / both.sum(), both[kind])


def test_commands_print_what_is_in_the_file(tmp_path: Path) -> None:
    path, touches = tmp_path / "contacts.csv", tmp_path / "touches.csv"
    felt().save(path)
    header, *rows = (re.split(r"\s{2,}", line.strip()) for line in run("events", str(path)).splitlines()[1:5])
    assert_columns(header, rows, OF_TOUCHES)
    assert_told(run("events", str(path)).splitlines()[0].rpartition(": ")[2], 3, ROWS)
    run("events", str(path), "-o", str(touches))
    written = pl.read_csv(touches)
    vectors = {f"{head}{axis}": K[name][:, k] for head, name in (("p", "point"), ("n", "normal"))
               for k, axis in enumerate("xyz")}  # fmt: skip
    for name in written.columns:
        value = np.arange(1, 4) if name == "label" else K["identity"] if name == "contact" else {**K, **vectors}[name]
        np.testing.assert_allclose(written[name].to_numpy(), value, rtol=1e-12, err_msg=name)
    lines = dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in run("inspect", str(path)).splitlines()[1:])
    assert_told(lines["rows"], ROWS, ROWS, 3)
    assert_told(lines["time"], START, START + (ROWS - 1) / 128.0)
    for kind, count in (FREE | {Status.AMBIGUOUS: LATE, Status.CONTACT: FELT - LATE}).items():
        assert_told(lines[kind.label], 1e2 * count / ROWS, count)


def test_a_log_is_inspected_as_it_is(tmp_path: Path) -> None:
    """Its rows, clock and columns, of which each has a median, extremes, noise and missing cells of its own."""
    rng, time, path = np.random.default_rng(2), np.arange(501) / 250.0, tmp_path / "log.csv"
    noise = np.array([0.01, 0.02, 0.03, 1e-3, 2e-3, 3e-3])
    values = 2.0 + np.arange(6.0) + noise * rng.normal(size=(501, 6))
    values[[5, 9, 100], 1] = np.nan
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    pl.DataFrame({"time": time, **dict(zip(names, values.T, strict=True))}).write_csv(path)
    said = [re.split(r"\s{2,}", line.strip()) for line in run("inspect", str(path)).splitlines()[1:]]
    facts = {row[0]: " ".join(row[1:]) for row in said}
    assert_told(facts["rows"], 501)
    assert_told(facts["time"], 0.0, 2.0, 0.004, 250.0)
    begin = next(k for k, row in enumerate(said) if row[0] == "least")
    assert said[begin] == ["least", "median", "most", "noise", "missing"]
    for k, (name, *row) in enumerate(said[begin + 1 : begin + 7]):
        assert name.startswith(f"{names[k]} [")
        gone = np.isnan(values[:, k])
        sound = values[~gone, k]
        for shown, value in zip(row, [sound.min(), np.median(sound), sound.max(), noise[k], gone.sum()], strict=True):
            assert float(shown.replace(",", "")) == pytest.approx(value, rel=0.1 if value == noise[k] else 1e-3)


def test_a_calibration_prints_what_is_in_its_file(tmp_path: Path) -> None:
    log, path = tmp_path / "free.csv", tmp_path / "payload.toml"
    turns = Rotation.random(12, rng=3)
    weight, bias = turns.inv().apply([0.0, 0.0, -4.9]), np.array([1.0, -2.0, 3.0, 0.01, -0.02, 0.03])
    load = np.column_stack([weight, np.cross([0.003, -0.002, 0.04], weight)]) + bias
    still = np.repeat(np.column_stack([load, turns.as_quat()]), 100, axis=0)
    still[:, :6] += np.random.default_rng(4).normal(size=(1200, 6)) * np.repeat([0.02, 1e-3], 3)
    names = ("fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
    pl.DataFrame({"time": np.arange(1200) / 100.0, **dict(zip(names, still.T, strict=True))}).write_csv(log)
    lines = dict(
        re.split(r"\s{2,}", line.strip(), maxsplit=1)
        for line in run("calibrate", "payload", str(log), "-o", str(path)).splitlines()[1:]
    )
    made = palpate.Payload.load(path)
    spread = np.sqrt(np.diag(made.covariance))
    down = made.weight / np.linalg.norm(made.weight)
    mass = np.sqrt(down @ made.covariance[:3, :3] @ down) / made.magnitude
    assert_told(lines["mass"], made.mass, mass)
    assert_told(lines["gravity"], *down)
    assert_told(lines["centre of mass"], *(1e3 * made.center_of_mass), *(1e3 * spread[6:9]))
    assert_told(lines["force bias"], *made.force_bias, *spread[3:6])
    assert_told(lines["torque bias"], *made.torque_bias, *spread[9:12])
    assert_told(lines["residual"], *(1e3 * made.residual))
    assert_told(lines["left out"], *map(float, re.findall(r"[\d.]+", made.provenance["left_out"])))


def test_errors_are_those_by_which_a_truth_is_off(tmp_path: Path) -> None:
    path, truth = tmp_path / "contacts.csv", tmp_path / "truth.csv"
    felt().save(path)
    off = np.array([1.1, 3.3, 2.3])
    point = K["point"] + 1e-3 * off[:, None] * np.cross(K["normal"], [0.0, 0.0, 1.0])
    apart = 1e3 * np.linalg.norm(point - K["point"], axis=1)
    columns = {"start": K["start"] - 5.0 / 128.0, "end": K["end"]} | {
        f"p{axis}": point[:, k] for k, axis in enumerate("xyz")
    }
    pl.DataFrame(columns).write_csv(truth)
    said = json.loads(run("evaluate", str(path), str(truth), "--json"))
    touches, errors = said["tables"]
    stated = {"touch": np.arange(1, 4), "error [mm]": apart, "answered": K["samples"], "samples": K["samples"] + 5}
    for k, row in enumerate(touches):
        for name, values in stated.items():
            assert row[name] == pytest.approx(values[k], abs=6e-4), name
    (row,) = errors
    whole = {"mean": apart.mean(), "median": np.median(apart), "95 %": np.percentile(apart, 95), "worst": apart.max()}
    assert {name: row[name] for name in whole} == pytest.approx(whole, abs=6e-4)
    assert row["count"] == 3
    assert said["facts"]["contacts"] == {"samples": ROWS, "matched": FELT + 15, "answered": FELT, "unmatched": 0,
                                         "missed": 0, "outside": 0}  # fmt: skip


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_file_has_each_value_in_its_column(suffix: str, tmp_path: Path) -> None:
    found, path = felt(), tmp_path / f"contacts{suffix}"
    found.save(path)
    table = pl.read_csv(path) if suffix == ".csv" else pl.read_parquet(path)
    vectors = {f"{head}{axis}": getattr(found, name)[:, k] for head, name in (("p", "point"), ("n", "normal"),
               ("f", "force")) for k, axis in enumerate("xyz")}  # fmt: skip
    pairs = {f"var_{'xyz'[i]}{'xyz'[j]}": found.covariance[:, i, j] for i in range(3) for j in range(i, 3)}
    plain_ = {name: getattr(found, name) for name in ("sample", "time", "torque")}
    values = vectors | pairs | plain_ | dict(found.features) | {"contact": found.identity}
    values |= {"candidates": found.estimate.candidates}
    for name in table.columns:
        if name == "status":
            assert table[name].to_list() == [Status(code).label for code in found.status.tolist()]
        else:
            there = table[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
            np.testing.assert_array_equal(there, values.pop(name).astype(float), err_msg=name)
    assert not values
