"""Every command, for three sensors of one robot: load cells and two skins on the fingers of a hand that moves."""

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import palpate
from palpate.cli import main
from palpate.cli.estimate_log import TORN
from palpate.files.contacts import read_contacts
from palpate.files.logs.robot_motion import RobotMotion
from palpate.setup.load import load_robot
from palpate.spatial.pose import rotation_from_quaternion
from tests.conformance.fields import Refused, run, same
from tests.conformance.test_options import OPTIONS
from tests.support.blocks import unserved
from tests.support.robots import small_hand

pytest.importorskip("mujoco")

NAMES = ("thumb", "ring", "little")
THREE = ("--sensor", ",".join(NAMES))
SAMPLES = {"thumb": 4000, "ring": 800, "little": 800}
PLACE = 1.0  # mm


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_hand(tmp_path_factory)


@pytest.fixture(scope="module")
def words(hand: Path) -> tuple[str, ...]:
    """Log and rig, as words of a command."""
    return str(hand / "run.mcap"), "--rig", str(hand / "robot.toml")


@pytest.fixture(scope="module")
def contacts(hand: Path, words: tuple[str, ...]) -> Path:
    """Those of the three sensors in the base, with a report."""
    output = hand / "contacts.parquet"
    run("estimate", *words, *THREE, "--frame", "base", "-o", output, "--report", hand / "report.html")
    return output


def test_inspect_shows_log_rig_and_contacts(hand: Path, words: tuple[str, ...], contacts: Path) -> None:
    said = run("inspect", *words, *THREE)
    for name, count in SAMPLES.items():
        assert re.search(rf"sensor +{name}\n +samples +{count:,}", said)
    assert all(name in run("inspect", words[-1]) for name in NAMES)
    assert f"{sum(SAMPLES.values()):,}" in run("inspect", contacts)
    assert "voltage 12" in run("inspect", *words, "--sensor", "thumb")


def test_a_new_rig_has_every_sensor_of_the_log(hand: Path, tmp_path: Path) -> None:
    """On the link that its messages name; load cells' name none, which is asked for."""
    rig = tmp_path / "new.toml"
    said = run("rig", "new", hand / "run.mcap", hand / "robot.urdf", "-o", rig)
    robot = load_robot(rig)
    assert {*robot.sensors, *robot.faulty} >= set(NAMES)
    assert [robot.sensors[name].link for name in NAMES[1:]] == ["ring_tip", "little_tip"]
    assert "thumb: its messages name no frame: write its link" in said


def test_every_format_and_python_have_the_same_contacts(hand: Path, words: tuple[str, ...], contacts: Path) -> None:
    known = pl.read_parquet(contacts)
    for suffix in (".csv", ".mcap"):
        output = hand / f"again{suffix}"
        run("estimate", *words, *THREE, "--frame", "base", "-o", output)
        found = read_contacts(output)
        assert set(found.sensor) == set(NAMES)
        same(found.to_polars().select(known.columns), known)
    same(palpate.estimate(words[0], words[2], sensor=THREE[1], frame="base").to_polars(), known)
    counts = {name: int((known["sensor"] == name).sum()) for name in NAMES}
    assert all(counts[name] >= SAMPLES[name] for name in NAMES)  # a row each at least


def test_frames_are_each_other_moved(hand: Path, words: tuple[str, ...], contacts: Path) -> None:
    robot, base = load_robot(words[2]), read_contacts(contacts)
    links = [f"{name}_tip" for name in NAMES]
    motion = RobotMotion.read(hand / "run.mcap", robot.urdf, robot.base, links, joints=robot.table.joints)
    own = palpate.estimate(words[0], words[2], sensor=THREE[1])
    for name in NAMES:
        here, there = own.of(name), base.of(name)
        turns, moves = motion.at(f"{name}_tip", here.time)
        expected = np.einsum("nij,nj->ni", rotation_from_quaternion(turns), here.point) + moves
        known = np.isfinite(there.point).all(axis=1)
        assert known.sum() > 50
        np.testing.assert_allclose(there.point[known], expected[known], atol=1e-9)


def test_evaluate_events_and_report_know_the_sensors(hand: Path, contacts: Path) -> None:
    said = run("evaluate", contacts, hand / "truth.csv", "--tolerance", "0.001")
    for name in NAMES:
        line = re.search(rf"(?m)^ +{name} +[\d,]+ +[\d,]+ +([\d.]+)", said)
        assert line is not None, said
        assert float(line[1]) <= PLACE
    run("events", contacts, "-o", hand / "touches.csv")
    touches = pl.read_csv(hand / "touches.csv")
    assert set(touches["sensor"]) == set(NAMES)
    page = (hand / "report.html").read_text()
    assert all(name in page for name in NAMES)


def test_the_log_and_its_contacts_can_be_viewed(words: tuple[str, ...], contacts: Path) -> None:
    with unserved() as scenes:
        run("view", *words, *THREE, "--port", "0")
    assert set(scenes[0].contacts.sensor) == set(NAMES)
    with pytest.raises(Refused, match="joint states"):
        run("view", contacts, "--rig", words[2], "--port", "0")


def test_a_batch_writes_what_estimate_writes(
    hand: Path, words: tuple[str, ...], contacts: Path, tmp_path: Path
) -> None:
    """And again nothing; then only the log that has changed; one without a sensor's topic ends with 4."""
    logs, output = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    for name in ("a", "b"):
        shutil.copy(hand / "run.mcap", logs / f"{name}.mcap")
    call = ("batch", logs, "--rig", words[2], *THREE, "--frame", "base", "-o", output, "--workers", "1")
    run(*call)
    for name in ("a", "b"):
        same(pl.read_parquet(output / f"{name}.parquet"), pl.read_parquet(contacts))
    before = (output / "a.parquet").stat().st_mtime_ns
    (logs / "b.mcap").write_bytes((hand / "free.mcap").read_bytes())
    run(*call)
    assert (output / "a.parquet").stat().st_mtime_ns == before
    assert not read_contacts(output / "b.parquet").touches()
    lines = [json.loads(line) for line in (output / "batch.jsonl").read_text().splitlines()[1:]]
    assert {each["output"] for each in lines} == {"a.parquet", "b.parquet"}
    rig = hand / "lost.toml"
    rig.write_text((hand / "robot.toml").read_text().replace('"/ring/skin"', '"/nowhere"'))
    assert main(["batch", str(logs), "--rig", str(rig), "-o", str(tmp_path / "lost"), "--workers", "1"]) == 4


def test_a_log_that_is_cut_off_is_answered_up_to_there_and_said(
    hand: Path, words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The exit code, the record of the contacts and a batch state it."""
    logs = tmp_path / "logs"
    logs.mkdir()
    content = Path(words[0]).read_bytes()
    (logs / "cut.mcap").write_bytes(content[: len(content) // 2])
    output = tmp_path / "cut.parquet"
    assert main(["estimate", str(logs / "cut.mcap"), *words[1:], *THREE, "-o", str(output)]) == TORN
    assert "complete messages were read" in capsys.readouterr().out
    assert tomllib.loads(output.with_name("cut.parquet.toml").read_text())["ended"] == "torn"
    found = read_contacts(output)
    assert all(len(found.of(name)) > 0.3 * count for name, count in SAMPLES.items())
    call = ["batch", str(logs), *words[1:], *THREE, "-o", str(tmp_path / "out"), "--workers", "1"]
    assert main(call) == TORN


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_of_one_sensor_is_refused(words: tuple[str, ...], option: str, tmp_path: Path) -> None:
    for command in (("estimate", "-o", tmp_path / "x.csv"), ("view", "--port", "0"), ("batch", "-o", tmp_path)):
        with pytest.raises(Refused, match=r"\[sensors\.NAME\]"):
            run(command[0], *words, *THREE, option, *OPTIONS[option], *command[1:])
