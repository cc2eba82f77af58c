"""A hand and a humanoid with many sensors, touched while they move: contacts of all sensors in one frame.

The robots (`palpate simulate hand` and `humanoid`) move in a physics engine, up to 1 rad/s, and are touched at one or
several places at once; what touched them, and where, is the engine's. Of each touch and sensor the sample with the
largest true force counts. Ellipses are those of the point in the tangent plane, in the frame of the robot's base.
"""

import contextlib
import io
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np
import polars as pl
from mcap.reader import make_reader
from mcap.writer import Writer

import palpate
from claims.evidence.covariance import CHI2_95
from claims.row import Row
from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW
from palpate.evaluation.evaluate import EvaluationReport, evaluate
from palpate.files.ground_truth import read_ground_truth
from palpate.files.urdf import Kinematics, Urdf
from palpate.setup.load import load_robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate_lab.cli import robot_models

LARGEST, INSIDE, MOST = 1e-3, (0.93, 0.97), 20.0  # m; of ellipses; squared distance that counts, at most
ENCODER = 0.2  # degrees: an offset of each joint that lasts a session
SHORT = ("--seconds", "12", "--touches", "16", "--free", "6")
MINUTE = ("--seconds", "60", "--free", "0")
PALMS = ("left_palm", "right_palm", "left_hand_back", "right_hand_back")
WRISTS = ("left_wrist", "right_wrist")
TWICE = ("belly", "back", "left_chest", "right_chest", *PALMS, *WRISTS)  # of the log that is timed
REPLAY = '\n[source]\nkind = "replay"\naddress = "run.mcap"\nspeed = 0.0\n'
BASE = [f"base_p{axis}" for axis in "xyz"]
NORMAL = [f"base_n{axis}" for axis in "xyz"]
FORCE = [f"base_f{axis}" for axis in "xyz"]


def rows(small: bool) -> Iterator[Row]:
    """Place, ellipses, each sensor as alone, false touches, speed of the kinematics; small, of a humanoid alone."""
    with TemporaryDirectory() as scratch:
        for name in ("hand", "humanoid")[small:]:
            length = SHORT if small else ("--free", "50")
            with mock.patch.object(robot_models, "_PRESSES", 40 if small else robot_models._PRESSES):
                made = [simulated(Path(scratch), name, seed, *length) for seed in range(1 if small else 6)]
            yield from _placed(name, [_matches(each) for each in made], small)
            yield _alone(name, made[0], 3 if small else None)
            yield _false(name, made)
            if name == "humanoid":
                yield _live(made, small)
            if small:
                continue
            off = (*SHORT[:-1], "0", "--encoder", f"{ENCODER}")
            bent = [simulated(Path(scratch), name, seed, *off) for seed in range(9, 17)]
            yield from _placed(f"{name}, joints {ENCODER} degrees off", list(map(_matches, bent)), small, bent=True)
        yield _speed(Path(scratch) / "humanoid0", small)
        if not small:
            yield _cost(simulated(Path(scratch), "humanoid", 60, *MINUTE))


def simulated(scratch: Path, name: str, seed: int, *options: str) -> Path:
    """Make a session, and return its folder."""
    folder = scratch / f"{name}{seed}"
    with contextlib.redirect_stdout(io.StringIO()):
        assert not main(["--quiet", "simulate", name, "-o", str(folder), "--seed", str(seed), *options])
    return folder


@dataclass(frozen=True, eq=False)
class Matches:
    """Touches of sensors: error [m] of each place, NaN if it was not found, and squared distance of its ellipse."""

    error: np.ndarray
    square: np.ndarray


def _matches(session: Path) -> Matches:
    found = palpate.estimate(session / "run.mcap", session / "robot.toml", frame="base")
    truth = pl.read_csv(session / "truth.csv").with_columns(
        strength=pl.sum_horizontal(*(pl.col(name) ** 2 for name in FORCE)).sqrt()
    )
    alone = truth.filter(pl.len().over("time", "sensor") == 1)  # a wrench of two touches is of neither
    strongest = alone.sort("strength").group_by("touch", "sensor").last().sort("time", "sensor")
    pairs = [_match(found.of(row["sensor"]), row) for row in strongest.iter_rows(named=True) if row["strength"] > 0.5]
    return Matches(*np.array(pairs).reshape(-1, 2).T)


def _match(found: Contacts, row: dict[str, float]) -> tuple[float, float]:
    """Return the error of the nearest contact of the sample at the time of a true one, and its squared distance."""
    near = found.answered & (np.abs(found.time - row["time"]) < 6e-4)
    if not near.any():
        return np.nan, np.nan
    off: np.ndarray = found.point[near] - [row[name] for name in BASE]
    k = int(np.argmin(np.linalg.norm(off, axis=1)))
    normal = np.array([row[name] for name in NORMAL])
    across: np.ndarray = np.linalg.svd(normal[None])[2][1:]
    spread: np.ndarray = across @ found.covariance[near][k] @ across.T
    away: np.ndarray = across @ off[k]
    return float(np.linalg.norm(off[k])), float(np.dot(away, np.linalg.solve(spread, away)))


def _placed(what: str, found: list[Matches], small: bool, *, bent: bool = False) -> Iterator[Row]:
    error, square = (np.concatenate([getattr(each, name) for each in found]) for name in ("error", "square"))
    seen = np.isfinite(error)
    inside, middle = float(np.mean(square[seen] <= CHI2_95)), float(np.median(error[seen]))
    count = f"{len(error):,} touches of sensors"
    got = f"{1e3 * middle:.2f} mm, 95 % of them {1e3 * np.quantile(error[seen], 0.95):.1f} mm; found {seen.mean():.1%}"
    yield Row(
        f"{what}, {count}: place in the base (median)",
        "" if bent else "<= 1 mm",
        got,
        None if bent else middle <= LARGEST,
    )
    passed = None if small or bent else INSIDE[0] <= inside <= INSIDE[1]  # eight robots' offsets are few draws
    got = f"{inside:.1%}; squared distances {np.mean(np.minimum(square[seen], MOST)):.2f} on average, 2 if exact"
    yield Row(f"{what}: truth in the 95 % ellipse", "" if bent else "93 to 97 %", got, passed)


def _alone(name: str, session: Path, most: int | None) -> Row:
    """Compare each sensor's contacts in its own frame with those that its rig alone gives."""
    robot = load_robot(session / "robot.toml")
    together = palpate.estimate(session / "run.mcap", robot)
    same, sensors = 0, list(robot.sensors.values())[:most]
    for each in sensors:
        found, alone = together.of(each.name), palpate.estimate(session / "run.mcap", each.rig)
        kept = list(alone.features)
        same += np.array_equal(found.rows()[:, : ROW.length], alone.rows()[:, : ROW.length], equal_nan=True) and all(
            np.array_equal(found.features[feature], alone.features[feature], equal_nan=True) for feature in kept
        )
    return Row(
        f"{name}: sensors whose rows are those of the sensor alone, to the last bit",
        "all",
        f"{same} of {len(sensors)}",
        same == len(sensors),
    )


def _false(name: str, sessions: list[Path]) -> Row:
    """Touches that are found while nothing touches and the robot moves."""
    touches, seconds = 0, 0.0
    for session in sessions:
        pipeline = RobotPipeline(load_robot(session / "robot.toml"), session / "free.mcap")
        found = Contacts.joined(list(pipeline.stream()))
        touches, seconds = touches + len(found.touches()), seconds + float(np.ptp(found.time))
    what = f"{name}, moving freely for {seconds / 60:.1f} minutes: touches"
    return Row(what, "0", f"{touches}", touches == 0)


def _live(sessions: list[Path], small: bool) -> Row:
    """Ellipses of the wrists' contacts, found live: accelerations are those of the latest poses.

    A wrist's errors of payload and bias are drawn once a session: the log's share, of few draws, is the measure.
    """
    every = list[tuple[EvaluationReport, EvaluationReport]]()
    for session in sessions:
        rig, truth = session / "live.toml", pl.read_csv(session / "truth.csv")
        head, *tables = (session / "robot.toml").read_text(encoding="utf-8").split("\n[sensors.")
        rig.write_text("\n[sensors.".join([head + REPLAY, *tables]), encoding="utf-8")
        for name in WRISTS:
            own, touched = session / f"{name}_truth.csv", truth.filter(pl.col("sensor") == name)
            if not len(touched):
                continue
            touched.write_csv(own)
            with palpate.open_live(rig, name) as live:
                times, rows = map(np.array, zip(*((time, row.copy()) for time, row in live), strict=True))
            offline = palpate.estimate(session / "run.mcap", load_robot(rig).sensors[name].rig)
            known = read_ground_truth(own)
            found = Contacts.of_rows(np.arange(len(times)), times, rows, ())
            every.append((evaluate(found, known), evaluate(offline, known)))
    covered = [[each[k].coverage for each in every] for k in (0, 1)]
    counts = [sum(one.count for one in each) for each in covered]
    live, log = (sum(one.inside * one.count for one in each) / n for each, n in zip(covered, counts, strict=True))
    off = 1e3 * float(np.nanmedian(np.concatenate([live.errors for live, _ in every])))
    got = f"{live:.1%} of {counts[0]:,} samples, {log:.1%} in the log; off by {off:.2f} mm (median)"
    what = "humanoid, live: wrists, truth in the 95 % ellipse"
    return Row(what, "" if small else "the log's share -3 %", got, None if small else live >= log - 0.03)


def _speed(session: Path, small: bool) -> Row:
    """Joint samples a second through pinocchio, for all links at once."""
    urdf, count = Urdf(session / "robot.urdf"), 500 if small else 20_000
    kinematics = Kinematics(urdf, "torso", urdf.links)
    values = np.random.default_rng(0).uniform(-1.0, 1.0, (count, len(kinematics.joints)))
    kinematics.poses(values[:100])
    begin = time.process_time()
    kinematics.poses(values)
    rate = count / (time.process_time() - begin)
    what = f"joint samples a second of CPU time, poses of {len(urdf.links)} links"
    return Row(what, ">= 20,000", f"{rate:,.0f}", None if small else rate >= 20_000)


def _cost(session: Path) -> Row:
    """CPU time of a log of `doubled` sensors."""
    robot = load_robot(doubled(session))
    begin = time.process_time()
    rows = sum(map(len, RobotPipeline(robot, session / "twice.mcap", "base").stream()))
    took = time.process_time() - begin
    what = f"log with {len(robot.sensors)} sensors, {rows:,} rows, in the base: CPU time"
    return Row(what, "<= 8 s for 60 s", f"{took:.1f} s", took <= 8.0)


def doubled(session: Path) -> Path:
    """Write twice.mcap, in which eight of the patches and both wrists are there twice, and return a rig for it."""
    rig, log = session / "robot.toml", session / "twice.mcap"
    head, *tables = rig.read_text(encoding="utf-8").split("\n[sensors.")
    copied = [each for each in tables if each.startswith(TWICE)]
    again = [re.sub(r"(?m)^(\w+)\](?=\n)|^topic = \"/(\w+)/", _renamed, each) for each in copied]
    rig.with_name("twice.toml").write_text("\n[sensors.".join([head, *tables, *again]), encoding="utf-8")
    _write_twice(session / "run.mcap", log)
    return rig.with_name("twice.toml")


def _renamed(match: re.Match[str]) -> str:
    return f"{match[1]}_2]" if match[1] else f'topic = "/{match[2]}_2/'


def _write_twice(log: Path, path: Path) -> None:
    """Write the messages of a log, those of some sensors also under a second name."""
    channels = dict[str, int]()
    with log.open("rb") as file, path.open("wb") as out:
        writer = Writer(out)
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages():
            if schema is None:  # the lab's logs state a schema of each topic
                continue
            copied = channel.topic.strip("/").startswith(TWICE)
            topics = [channel.topic, *([re.sub(r"^/(\w+)/", r"/\1_2/", channel.topic)] if copied else [])]
            for topic in topics:
                if topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[topic] = writer.register_channel(topic, channel.message_encoding, kind)
                writer.add_message(channels[topic], message.log_time, message.data, message.publish_time)
        writer.finish()
