"""Whatever frame, point, sign, axes and form of orientation a log has, the wrench of the sensor comes out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.files.logs.layout import WRENCH_COLUMNS, LogLayout
from palpate.setup import load_rig
from palpate.signals.recording import ORIENTATION, POSITION

FORMS = {
    "quaternion": lambda turn: turn.as_quat(),
    "quaternion_wxyz": lambda turn: turn.as_quat()[:, [3, 0, 1, 2]],
    "matrix_rows": lambda turn: turn.as_matrix().reshape(-1, 9),
    "matrix_columns": lambda turn: turn.as_matrix().swapaxes(1, 2).reshape(-1, 9),
    "rotation_vector": lambda turn: turn.as_rotvec(),
    "euler_xyz": lambda turn: turn.as_euler("xyz"),
    "euler_ZYX_deg": lambda turn: turn.as_euler("ZYX", degrees=True),
}
AXES = {("x", "y", "z"): np.eye(3), ("-x", "y", "z"): np.diag([-1.0, 1, 1]), ("x", "z", "y"): np.eye(3)[[0, 2, 1]]}


def session(seed: int) -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray]:
    """Return forces and torques (40, 3) at the sensor, and its rotations and positions in the base."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(40, random_state=rng)
    return rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), turns, rng.normal(size=(40, 3))


def written(path: Path, columns: dict[str, np.ndarray]) -> Path:
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


def named(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}{k}": column for k, column in enumerate(values.T)}


@pytest.mark.parametrize("seed", range(40))
def test_whatever_a_log_means_the_wrench_of_the_sensor_comes_out(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    force, torque, turns, position = session(seed)
    form = str(rng.choice(list(FORMS)))
    frame, torque_frame = (str(rng.choice(["sensor", "base"])) for _ in range(2))
    reference = ("sensor", "base", (0.01, -0.02, 0.1))[rng.integers(3)]
    acts_on, inverse = str(rng.choice(["body", "environment"])), bool(rng.integers(2))
    mount = Rotation.random(random_state=rng) if rng.integers(2) else None
    (axes, matrix), (torque_axes, torque_matrix) = (list(AXES.items())[rng.integers(3)] for _ in range(2))

    matrices = turns.as_matrix()
    forces = {"sensor": force, "base": np.einsum("nij,nj->ni", matrices, force)}
    if reference == "sensor":
        moved = torque
    else:  # the torque about another point P of a force at the sensor's origin S: (S - P) x F is added
        point = -np.einsum("nji,nj->ni", matrices, position) if reference == "base" else np.array([reference])
        moved = torque - np.cross(point, force)
    torques = {"sensor": moved, "base": np.einsum("nij,nj->ni", matrices, moved)}
    sign = -1.0 if acts_on == "environment" else 1.0
    logged = sign * np.concatenate([forces[frame] @ matrix, torques[torque_frame] @ torque_matrix], axis=1)
    flange, there = (turns if mount is None else turns * mount.inv()), position
    if inverse:
        flange, there = flange.inv(), -flange.inv().apply(position)
    columns = {"time": np.arange(40) / 100, **dict(zip(WRENCH_COLUMNS, logged.T, strict=True))}
    columns |= named("o", FORMS[form](flange)) | named("p", there)
    log = written(tmp_path / "log.csv", columns)
    layout = LogLayout(
        axes=axes,
        left_handed=bool(np.linalg.det(matrix) < 0),
        torque_axes=torque_axes,
        acts_on=acts_on,
        frame=frame,
        torque_frame=torque_frame,
        reference=reference,
        orientation=tuple(name for name in columns if name.startswith("o")),
        orientation_form=form,
        position=("p0", "p1", "p2"),
        inverse=inverse,
        sensor_rotation=() if mount is None else tuple(mount.as_quat()),
    )
    recording = read_recording(log, layout)
    read = Rotation.from_quat(recording.channels[ORIENTATION])
    assert (read * turns.inv()).magnitude().max() < 1e-9
    np.testing.assert_allclose(recording.channels[POSITION], position, atol=1e-12)
    wrenches = recording.wrenches()
    np.testing.assert_allclose(wrenches[:, :3], forces[frame], atol=1e-12)
    wanted = torque if frame == "sensor" else np.einsum("nij,nj->ni", matrices, torque)
    np.testing.assert_allclose(wrenches[:, 3:], wanted, atol=1e-12)


def test_a_matrix_of_four_rows_holds_the_position(tmp_path: Path) -> None:
    force, torque, turns, position = session(1)
    pose = np.tile(np.eye(4), (40, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = turns.as_matrix(), position
    columns = {"time": np.arange(40) / 100, **dict(zip(WRENCH_COLUMNS, np.hstack([force, torque]).T, strict=True))}
    pose[7] = 0.0  # no rotation
    columns |= named("T", pose.swapaxes(1, 2).reshape(-1, 16))
    layout = LogLayout(orientation=tuple(f"T{k}" for k in range(16)), orientation_form="matrix_columns")
    recording = read_recording(written(tmp_path / "log.csv", columns), layout)
    np.testing.assert_allclose(np.delete(recording.channels[POSITION], 7, 0), np.delete(position, 7, 0))
    assert np.isnan(recording.channels[ORIENTATION][7]).all()
    assert any("1 orientations are no rotations and were left out" in note for note in recording.notes)


def test_a_torque_about_the_base_needs_poses(tmp_path: Path) -> None:
    force, torque, _, _ = session(2)
    columns = {"time": np.arange(40) / 100, **dict(zip(WRENCH_COLUMNS, np.hstack([force, torque]).T, strict=True))}
    log = written(tmp_path / "log.csv", columns)
    with pytest.raises(InputError, match=r"the orientation is needed.*Name"):
        read_recording(log, LogLayout(reference="base"))
    shifted = read_recording(log, LogLayout(reference=(0.0, 0.0, 0.1))).wrenches()
    np.testing.assert_allclose(shifted[:, 3:], torque + np.cross([0.0, 0.0, 0.1], force))


def test_two_streams_in_one_table_are_refused(tmp_path: Path) -> None:
    force, torque, turns, _ = session(3)
    wrench, quaternion = np.hstack([force, torque]), turns.as_quat()
    wrench[::2], quaternion[1::2] = np.nan, np.nan
    columns = {"time": np.arange(40) / 100, **dict(zip(WRENCH_COLUMNS, wrench.T, strict=True))}
    columns |= dict(zip(("qx", "qy", "qz", "qw"), quaternion.T, strict=True))
    with pytest.raises(InputError, match=r"two streams: no row has both a wrench and an orientation.*Write"):
        read_recording(written(tmp_path / "log.csv", columns), LogLayout())


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('[force_torque]\nacts_on = "world"', "force_torque: acts_on must be 'body' or 'environment'"),
        ('[force_torque]\nacts_on = "environment"\naxes = ["-x", "-y", "-z"]\nleft_handed = true', "undo each other"),
        ('[force_torque]\nreference = "tcp"', "force_torque: .*or a point"),
        ('[force_torque]\ntorque_frame = "tool"', "force_torque: torque_frame must be 'sensor' or 'base'"),
        ('[force_torque]\ntorque_axes = ["x", "x", "z"]', "torque_axes: .*three different axes"),
        ('[orientation]\nform = "rpy"', "there is no form 'rpy'.*Use"),
        ('[orientation]\nform = "rotation_vector"\ncolumns = ["a", "b"]', "orientation: .*must be 3 names"),
        ("[orientation]\nsensor_rotation = [0, 0, 0, 2]", "orientation: .*quaternion x, y, z, w of length 1"),
    ],
)
def test_a_rig_with_another_meaning_is_refused(tmp_path: Path, keys: str, said: str) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(f'[surface]\nkind = "sphere"\nradius = 0.01\n{keys}\n')
    with pytest.raises(InputError, match=said):
        load_rig(rig)


def test_a_live_stream_is_taken_as_it_comes() -> None:
    LogLayout(acts_on="environment").require_live()
    for layout in (LogLayout(reference="base"), replace(LogLayout(), inverse=True)):
        with pytest.raises(InputError, match=r"of the rig are for logs, not live streams.*Convert"):
            layout.require_live()
