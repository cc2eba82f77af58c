"""Poses in a second table are joined to the wrenches by time, and clocks that do not fit are named."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.logs_written import POSE, STAMPED, WRENCH, pose_stamped, wrench_stamped, write_mcap
from palpate.cli import main
from palpate.errors import InputError
from palpate.files.logs import read_poses, read_recording
from palpate.files.logs.layout import LogLayout
from palpate.files.models import read_model
from palpate.setup import load_rig
from palpate.setup.new import propose_rig
from palpate.signals.payload import Payload
from palpate.signals.recording import ORIENTATION, POSITION

LAYOUT = LogLayout(pose_file="poses.csv", pose_time="stamp")
WEIGHT = 5.0  # N


def turned(time: np.ndarray) -> Rotation:
    """Return the sensor in the base, which turns about three axes at constant rates of Euler angles."""
    return Rotation.from_euler("xyz", np.outer(time, [0.9, 0.7, 0.4]))


def write(
    folder: Path, shift: float = 0.0, scale: float = 1.0, *, last: float = 110.5, name: str = "poses.csv"
) -> Path:
    """Write wrenches at 100 Hz from 100 s to 110 s, and poses at 40 Hz from 99.5 s; return the log."""
    time, rng = 100 + np.arange(1000) / 100, np.random.default_rng(3)
    force = turned(time).inv().apply([0.0, 0.0, -WEIGHT]) + rng.normal(size=(1000, 3)) * 0.02
    torque = np.cross([0.0, 0.0, 0.05], force) + rng.normal(size=(1000, 3)) * 0.002
    names = ("time", "fx", "fy", "fz", "tx", "ty", "tz")
    save(folder / "log.csv", dict(zip(names, (time, *force.T, *torque.T), strict=True)))
    stamp = np.arange(99.504, last, 0.025)
    parts = dict(zip(("qx", "qy", "qz", "qw"), turned(stamp).as_quat().T, strict=True))
    save(folder / name, {"stamp": (stamp + shift) * scale, **parts, "x": stamp, "y": 0 * stamp, "z": 0 * stamp})
    return folder / "log.csv"


def save(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    frame = pl.DataFrame(dict(columns))
    if path.suffix == ".npz":
        np.savez(path, allow_pickle=False, **columns)
    else:
        frame.write_parquet(path) if path.suffix == ".parquet" else frame.write_csv(path)


def as_messages(log: Path, *, posed: bool = False) -> Path:
    """Write the wrenches of a table as messages, with a topic of other poses too if `posed`; return the MCAP file."""
    table, path = pl.read_csv(log).to_numpy(), log.with_suffix(".mcap")
    stamps = np.rint(1e9 * table[:, 0]).astype(np.int64).tolist()
    wrenches = [(stamp, WRENCH, wrench_stamped(stamp, row)) for stamp, row in zip(stamps, table[:, 1:7], strict=True)]
    others = [(stamps[0], POSE, pose_stamped(stamps[0], np.array([0, 0, 0, 1.0]), np.zeros(3)))] if posed else []
    write_mcap(path, [*others, *wrenches], STAMPED if posed else {WRENCH: STAMPED[WRENCH]})
    return path


@pytest.mark.parametrize("name", ["poses.csv", "log_poses.parquet", "poses.npz"])
def test_poses_are_interpolated_at_the_wrenches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    log = write(tmp_path, shift=-0.01, name=name)
    file = name.replace("log", "{log}")
    layout = LogLayout(pose_file=file, pose_time="stamp", pose_time_unit="s", offset=0.01)
    whole = read_recording(log, layout)
    off = turned(whole.time).inv() * Rotation.from_quat(whole.channels[ORIENTATION])
    assert off.magnitude().max() < 1e-4  # the rates of the axes change by 1e-2 rad/s between poses
    np.testing.assert_allclose(whole.channels[POSITION][:, 0], whole.time, atol=1e-9)
    assert not any("pose" in note for note in whole.notes)
    monkeypatch.setattr("palpate.files.logs.text.PIECE", 1500)
    monkeypatch.setattr("palpate.files.logs.columns.BLOCK", 70)
    cut = read_recording(log, layout)
    np.testing.assert_array_equal(cut.channels[ORIENTATION], whole.channels[ORIENTATION])
    stamps, *_ = read_poses(log, layout)  # at their own times
    np.testing.assert_allclose(np.diff(stamps), 0.025, atol=1e-9)


@pytest.mark.parametrize("posed", [False, True])
def test_messages_take_the_poses_of_a_table(tmp_path: Path, posed: bool) -> None:
    """As a table of the same wrenches does; the poses are named with their times, which must overlap the log's."""
    log = write(tmp_path, last=109.0)
    expected, found = (read_recording(path, LAYOUT) for path in (log, as_messages(log, posed=posed)))
    for name, values in expected.channels.items():
        np.testing.assert_allclose(found.channels[name], values, atol=1e-8)  # times in float64, 100 s at 1 rad/s
    assert "the orientation is taken from poses.csv, whose poses are from 99.504 s to 108.979 s" in found.notes
    assert "102 of 1,000 samples have no pose: poses are from 99.504 s to 108.979 s" in found.notes
    np.testing.assert_array_equal(read_poses(log, LAYOUT)[1], read_poses(log.with_suffix(".mcap"), LAYOUT)[1])
    write(tmp_path, 60.0)
    with pytest.raises(InputError, match=r"159.504 s to 170.479 s.* 100.000 s to 109.990 s.*offset"):
        read_recording(log.with_suffix(".mcap"), LAYOUT)


def test_one_table_with_two_streams_names_itself(tmp_path: Path) -> None:
    log = write(tmp_path)
    wrenches, poses = pl.read_csv(log), pl.read_csv(tmp_path / "poses.csv").rename({"stamp": "time"})
    pl.concat([wrenches, poses], how="diagonal").sort("time").write_csv(log)
    with pytest.raises(InputError, match=r"holds two streams.*file = "):
        read_recording(log)
    found = read_recording(log, LogLayout(pose_file="log.csv"))
    measured = np.isfinite(found.wrenches()).all(axis=1)
    off = turned(found.time[measured]).inv() * Rotation.from_quat(found.channels[ORIENTATION][measured])
    assert measured.sum() == 1000
    assert off.magnitude().max() < 1e-4


@pytest.mark.parametrize(
    ("shift", "scale", "words"),
    [
        (60.0, 1.0, "poses.csv.* 159.504 s to 170.479 s.* 100.000 s to 109.990 s.*offset"),
        (-60.0, 1.0, "do not overlap.*offset"),
        (0.0, 1e3, 'time_unit = "ms"'),
    ],
)
def test_clocks_that_do_not_overlap_are_refused(tmp_path: Path, shift: float, scale: float, words: str) -> None:
    log = write(tmp_path, shift, scale)
    with pytest.raises(InputError, match=words):
        read_recording(log, LogLayout(pose_file="poses.csv", pose_time="stamp", pose_time_unit="s"))


def test_samples_without_a_pose_are_counted(tmp_path: Path) -> None:
    found = read_recording(write(tmp_path, last=105.0), LAYOUT)
    lacking = int(np.isnan(found.channels[ORIENTATION][:, 0]).sum())
    assert lacking == np.count_nonzero(found.time > 104.979)
    assert f"{lacking} of 1,000 samples have no pose: poses are from 99.504 s to 104.979 s" in found.notes
    poses = pl.read_csv(tmp_path / "poses.csv")
    pl.concat([poses[100:], poses[:100]]).write_csv(tmp_path / "poses.csv")
    notes = read_recording(tmp_path / "log.csv", LAYOUT).notes
    assert any("poses.csv: 100 poses are not newer" in note for note in notes)
    (tmp_path / "poses.csv").unlink()
    with pytest.raises(InputError, match=r"poses\.csv.*Did"):
        read_recording(tmp_path / "log.csv", LAYOUT)


@pytest.mark.parametrize("messages", [False, True])
def test_rig_new_and_payload_take_a_second_table(tmp_path: Path, messages: bool) -> None:
    log = as_messages(write(tmp_path)) if messages else write(tmp_path)
    made = propose_rig(log, None, tmp_path, poses=tmp_path / "poses.csv")
    (tmp_path / "rig.toml").write_text(made.text)
    assert load_rig(tmp_path / "rig.toml").orientation.file == "poses.csv"
    assert not main(
        ["calibrate", "payload", str(log), "--rig", str(tmp_path / "rig.toml"), "-o", str(tmp_path / "p.toml")]
    )
    payload = read_model(tmp_path / "p.toml", Payload)
    np.testing.assert_allclose(payload.weight, [0.0, 0.0, -WEIGHT], atol=0.01)  # 5 deviations of the mean
    assert "poses.csv sha256:" in payload.provenance["poses"]
