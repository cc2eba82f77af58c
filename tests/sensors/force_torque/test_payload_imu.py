"""Gravity from an IMU: the payload and the IMU's mounting come back without poses, and compensation needs none."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import palpate
from claims.evidence.payload_imu import BALL, MASS, NOISE, PLACE, G, Rests, mistakes, squared_distance, touches
from palpate.cli import main
from palpate.contact.estimate import ROW
from palpate.files.logs import join
from palpate.sensors.force_torque.section import free_wrenches
from palpate.setup.pipeline import open_log
from palpate.signals import Payload
from palpate.surfaces import Sphere
from palpate_lab.simulation.bags import Stamped, header, nanoseconds, wrenches, write_bag

SENSOR = palpate.ForceTorque(noise=(NOISE[0], NOISE[3]))
COLUMNS = "fx,fy,fz,tx,ty,tz,ax,ay,az"


@pytest.fixture(scope="module")
def found() -> Payload:
    return Rests.of(0).identified()


def recording(readings: np.ndarray) -> palpate.Recording:
    parts = ("force", readings[:, :3]), ("torque", readings[:, 3:6]), ("acceleration", readings[:, 6:])
    return palpate.Recording(0.1 * np.arange(len(readings)), {name: part.copy() for name, part in parts})


def log(rests: Rests, readings: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] at 50 Hz and readings (n, 9): `count` samples a rest, and quick turns between them."""
    rng, rows = np.random.default_rng(5), list[np.ndarray]()
    turns = Rotation.from_matrix(rests.rotations)
    for k, row in enumerate(readings):
        rows += [np.tile(row, (count, 1))]
        if k + 1 < len(readings):
            way = Slerp([0.0, 1.0], turns[[k, k + 1]])(np.linspace(0.1, 0.9, 9)).as_matrix()
            moving = Rests.of(0, way, noise=0.0)  # with another IMU: nothing in a turn is a rest
            rows += [moving.readings]
    made = np.concatenate(rows)
    return 0.02 * np.arange(len(made)), made + NOISE * rng.normal(size=made.shape)


# --- what comes back


def test_exact_readings_give_the_truth() -> None:
    """To the rounding of 12 N and 10 m/s^2, whose floor of 1e-9 the deviations have, through a well posed fit."""
    rests = Rests.of(3, noise=0.0)
    payload = rests.identified()
    np.testing.assert_allclose(rests.error(payload), 0.0, atol=1e-8)
    assert payload.notes == ()


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_an_imu_may_be_mounted_as_the_sensor_is_or_upside_down(angle: float) -> None:
    rests = Rests.of(4)
    turn = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    readings = rests.readings.copy()
    readings[:, 6:] = readings[:, 6:] @ rests.turn @ turn.T
    other = replace(rests, readings=readings, turn=turn, bias=turn @ rests.turn.T @ rests.bias)
    assert squared_distance(other, other.identified()) == pytest.approx(
        squared_distance(rests, rests.identified()), rel=1e-3
    )  # the same fit but for its steps, which end at a thousandth of a deviation


def test_a_rest_that_was_touched_is_set_aside() -> None:
    rests = Rests.of(5)
    readings = rests.readings.copy()
    readings[2, :6] += [2.0, -1.0, 3.0, 0.1, 0.0, 0.2]
    payload = replace(rests, readings=readings).identified()
    assert payload.samples == len(readings) - 1
    assert "1 of 20 samples are far from the fit" in payload.notes[0]
    assert squared_distance(rests, payload) < 2.5  # of 16 degrees of freedom: one fit in 1,000 is beyond


@pytest.mark.parametrize("mistake", mistakes())
def test_a_mistake_is_named(mistake: str) -> None:
    readings, words = mistakes()[mistake]
    with pytest.raises(palpate.PalpateError, match=words):
        palpate.identify_payload_with_imu(readings[:, :6], readings[:, 6:])


def test_an_imu_of_another_scale_is_noted() -> None:
    readings = Rests.of(6).readings.copy()
    readings[:, 6:] *= 1.03
    payload = palpate.identify_payload_with_imu(readings[:, :6], readings[:, 6:])
    assert any("its scale is off" in note for note in payload.notes)


# --- the model


def test_the_file_keeps_every_bit_and_has_no_imu_without_one(tmp_path: Path, found: Payload) -> None:
    found.save(tmp_path / "payload.toml")
    again = Payload.load(tmp_path / "payload.toml")
    assert again.imu is not None
    assert found.imu is not None
    for name in ("quaternion", "bias", "covariance"):
        np.testing.assert_array_equal(getattr(again.imu, name), getattr(found.imu, name))
    assert again.imu.noise == found.imu.noise
    np.testing.assert_array_equal(again.joint_covariance, found.joint_covariance)
    Payload(mass=0.4).save(tmp_path / "plain.toml")
    assert "imu" not in (tmp_path / "plain.toml").read_text(encoding="utf-8")


# --- compensation


def test_live_samples_and_blocks_are_as_the_payload_alone_compensates(found: Payload) -> None:
    """To the last bit of each other, and to rounding of `Payload.compensate`."""
    pressed, places = touches(0)
    estimator = palpate.WrenchEstimator(
        Sphere(BALL), palpate.Compensation(SENSOR, found), mount=palpate.Pose.from_quaternion([0, 0, 0, 1], PLACE)
    )
    together = estimator.run(recording(pressed.readings))
    estimator.reset()
    singly = [
        estimator.update(0.1 * k, row[:6], acceleration=row[6:]).point[0] for k, row in enumerate(pressed.readings)
    ]
    np.testing.assert_array_equal(np.array(singly), together.point)
    expected, _ = found.compensate(pressed.readings[:, :6], None, pressed.readings[:, 6:])
    measured = palpate.Compensation(SENSOR, found).measure(recording(pressed.readings))
    np.testing.assert_allclose(measured.wrench, expected, atol=1e-12)
    off = together.point - places
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.pinv(together.covariance, rcond=1e-6, hermitian=True), off)
    assert 0.5 < squares.mean() / 2 < 1.7  # on the ball's surface: two degrees of freedom in each of 20 touches


def test_what_lacks_the_imu_is_refused(found: Payload) -> None:
    compensation = palpate.Compensation(SENSOR, found)
    blind = palpate.Recording(np.zeros(1), {"force": np.zeros((1, 3)), "torque": np.zeros((1, 3))})
    with pytest.raises(palpate.InputError, match="takes gravity from an IMU, and there are no accelerations"):
        compensation.measure(blind)
    with pytest.raises(palpate.InputError, match="base frame need orientations"):
        palpate.Compensation(palpate.ForceTorque(frame="base"), found)
    with pytest.raises(palpate.InputError, match="give accelerations"):
        found.compensate(np.zeros((1, 6)), np.eye(3)[None])
    lost = recording(np.where(np.arange(9) > 5, np.nan, np.zeros((1, 9))))
    assert compensation.measure(lost).status[0] == palpate.Status.NO_POSE


# --- the commands


RIG = """\
[surface]
kind = "sphere"
radius = 0.02
pose = { xyz = [0, 0, 0.1], quaternion_xyzw = [0, 0, 0, 1] }

[force_torque]
noise = { force = 0.05, torque = 0.002 }
payload = "payload.toml"

[acceleration]
kind = "imu"
"""


def csv(path: Path, rests: Rests, readings: np.ndarray, names: str = COLUMNS) -> Path:
    time, rows = log(rests, readings, 25)
    table = np.column_stack([time, rows])
    np.savetxt(path, table, delimiter=",", header=f"time,{names}", comments="", fmt="%.9g")
    return path


def test_a_log_of_columns_is_calibrated_and_its_touches_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """25 samples a rest err by a fifth of one: 0.01 N of 12, and 0.2 mm of a touch of 8 N, five times over."""
    rests, (pressed, places) = Rests.of(0, noise=0.0), touches(0, noise=0.0)
    free = csv(tmp_path / "free.csv", rests, rests.readings, COLUMNS.replace("ax,ay,az", "acc_x,acc_y,acc_z"))
    assert main(["calibrate", "payload", str(free), "-o", str(tmp_path / "payload.toml")]) == 0
    assert f"used: {len(rests.readings)} rests of" in capsys.readouterr().out
    payload = Payload.load(tmp_path / "payload.toml")
    assert payload.mass == pytest.approx(MASS, rel=5e-3)
    assert payload.imu.noise == pytest.approx(NOISE[-1], rel=0.1)
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    touched = csv(tmp_path / "touch.csv", pressed, pressed.readings)
    rig = palpate.load_rig(tmp_path / "rig.toml")
    with open_log(csv(tmp_path / "rests.csv", rests, rests.readings), rig) as opened:
        rested = free_wrenches(rig.resolve("force_torque"), join(list(opened)))
    rested = rested[np.arange(len(rested)) % 34 < 25]  # noise, and that of the IMU, by which the payload is taken off
    np.testing.assert_allclose(np.sqrt(np.mean(rested**2, axis=0)) / NOISE[:6], 1.1, atol=0.15)
    contacts = palpate.estimate(touched, tmp_path / "rig.toml")
    for k, place in enumerate(places):
        own = slice(34 * k, 34 * k + 25)  # 9 samples of a turn follow
        assert (contacts.status[own] == palpate.Status.CONTACT).all()
        assert np.linalg.norm(contacts.point[own].mean(axis=0) - place) < 1e-3
    inner = np.loadtxt(touched, delimiter=",", skiprows=1) / np.repeat([1.0, G], [7, 3])
    np.savetxt(tmp_path / "in_g.csv", inner, delimiter=",", header=f"time,{COLUMNS}", comments="", fmt="%.12g")
    replayed = '\n[source]\nkind = "replay"\naddress = "in_g.csv"\nspeed = 0\n'
    (tmp_path / "live.toml").write_text(f'{RIG}unit = "g"\n{replayed}', encoding="utf-8")
    with palpate.open_live(tmp_path / "live.toml") as live:
        points = np.array([row[ROW.point] for _, row in live])
    np.testing.assert_allclose(points[-25:], contacts.point[-25:], atol=1e-3)  # without the later samples of a touch
    (tmp_path / "rig.toml").write_text(RIG.replace('"imu"', '"motion"'), encoding="utf-8")
    with pytest.raises(palpate.InputError, match='write kind = "imu"'):
        palpate.estimate(touched, tmp_path / "rig.toml")


def imus(types: Any, time: np.ndarray, felt: np.ndarray) -> Iterator[Stamped]:
    imu, quaternion = types["sensor_msgs/msg/Imu"], types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    vector, nothing = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    for stamp, row in zip(nanoseconds(time), felt.tolist(), strict=True):
        still = quaternion, nothing, vector(0.0, 0.0, 0.0), nothing
        yield stamp, "/imu", imu(header(types, stamp, "ft_imu"), *still, vector(*row), nothing)


def test_an_imu_in_a_bag_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By `rig new`, which names its topic, and by `calibrate payload` with that rig and without one, to the same."""
    rests = Rests.of(0, noise=0.0)
    time, rows = log(rests, rests.readings, 25)
    bag, rig = tmp_path / "free.mcap", tmp_path / "rig.toml"
    kinds = {"/wrench": "geometry_msgs/msg/WrenchStamped", "/imu": "sensor_msgs/msg/Imu"}
    write_bag(
        bag,
        kinds,
        lambda types: [wrenches(types, "/wrench", time + 1.0, rows[:, :6]), imus(types, time + 1.0, rows[:, 6:])],
    )
    assert main(["rig", "new", str(bag), "-o", str(rig)]) == 0
    assert "topic '/imu' is taken for the acceleration of an IMU" in capsys.readouterr().out
    stated = palpate.load_rig(rig).acceleration
    assert (stated.topic, stated.kind, stated.unit) == ("/imu", "imu", "m/s^2")
    models = tmp_path / "with.toml", tmp_path / "without.toml"
    assert main(["calibrate", "payload", str(bag), "--rig", str(rig), "-o", str(models[0])]) == 0
    assert main(["calibrate", "payload", str(bag), "-o", str(models[1])]) == 0
    one, other = map(Payload.load, models)
    np.testing.assert_array_equal(one.joint_covariance, other.joint_covariance)
    assert one.mass == pytest.approx(MASS, rel=5e-3)


def test_a_log_of_a_sensor_that_never_rests_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turns = np.linspace(0.0, 1.0, 400)[:, None]
    way = Rotation.from_rotvec(np.hstack([4.0 * np.sin(3.0 * turns), 5.0 * turns, np.cos(9.0 * turns)])).as_matrix()
    rows = np.column_stack([0.02 * np.arange(400), Rests.of(0, way).readings])
    path = tmp_path / "moving.csv"
    np.savetxt(path, rows, delimiter=",", header=f"time,{COLUMNS}", comments="", fmt="%.9g")
    assert main(["calibrate", "payload", str(path), "-o", str(tmp_path / "payload.toml")]) == 1
    assert "the sensor moves" in capsys.readouterr().err
    assert main(["calibrate", "payload", str(path), "--gravity", "0,0,-1", "-o", str(tmp_path / "payload.toml")]) == 1
    assert "moving.csv: --gravity is a direction in the base" in capsys.readouterr().err
