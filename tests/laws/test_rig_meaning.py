"""A key that says how a log is written means just that: a log rewritten so, with the key, has the same answers."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.rig_scenes import Log, Scene, drifted, drifting, estimated, merged, rig_of, same, six

FORCE, TORQUE, TURN, PLACE = ("fx", "fy", "fz"), ("tx", "ty", "tz"), ("qx", "qy", "qz", "qw"), ("x", "y", "z")
PUSH, WRENCH = ("ax", "ay", "az"), (*FORCE, *TORQUE)
FLANGE = Rotation.from_quat([0.6, 0.0, 0.0, 0.8])
SHIFT = np.array([0.1, -0.02, 0.03])  # m
UP = np.array([0.0, 0.0, 9.80665])
Rewritten = Callable[[Log], Log]


def _of(log: Log, names: tuple[str, ...]) -> np.ndarray:
    return np.column_stack([log[name] for name in names])


def _with(log: Log, names: tuple[str, ...], values: np.ndarray) -> Log:
    return log | dict(zip(names, values.T, strict=True))


def _turn(log: Log) -> Rotation:
    return Rotation.from_quat(_of(log, TURN))


def _renamed(*names: str) -> Rewritten:
    return lambda log: {f"my {name}" if name in names else name: values for name, values in log.items()}


def _scaled(size: float, *names: str) -> Rewritten:
    return lambda log: log | {name: size * log[name] for name in names}


def _turned(*groups: tuple[str, ...]) -> Rewritten:
    """Along the axes of the base."""

    def rewritten(log: Log) -> Log:
        for names in groups:
            log = _with(log, names, _turn(log).apply(_of(log, names)))
        return log

    return rewritten


def _moved(shift: Callable[[Log], np.ndarray]) -> Rewritten:
    """Torques about a point [m] of the sensor."""
    return lambda log: _with(log, TORQUE, _of(log, TORQUE) - np.cross(shift(log), _of(log, FORCE)))


def _posed(names: str, numbers: Callable[[Rotation], np.ndarray]) -> Rewritten:
    """Orientations in another form, in columns named by letters."""

    def rewritten(log: Log) -> Log:
        plain = {name: values for name, values in log.items() if name not in TURN}
        return _with(plain, tuple(names), numbers(_turn(log)).reshape(len(log["time"]), -1))

    return rewritten


def _inverted(log: Log) -> Log:
    back = _turn(log).inv()
    return _with(_with(log, TURN, back.as_quat()), PLACE, -back.apply(_of(log, PLACE)))


def _logged(*axes: str) -> Callable[[tuple[str, ...]], Rewritten]:
    """Components such that axis k of the sensor is the one named k-th."""
    return lambda names: (
        lambda log: (
            log
            | {
                names["xyz".index(axis[-1])]: log[name] * (-1.0 if axis[0] == "-" else 1.0)
                for axis, name in zip(axes, names, strict=True)
            }
        )
    )


def _both(one: Rewritten, other: Rewritten) -> Rewritten:
    return lambda log: other(one(log))


ROUND, MIRROR = _logged("y", "z", "x"), _logged("x", "y", "-z")
MEANT: list[tuple[str, Rewritten]] = [
    ("time.column = 'my time'", _renamed("time")),
    ("time.unit = 'ms'", _scaled(1e3, "time")),
    (f"force_torque.columns = {[f'my {name}' for name in WRENCH]}", _renamed(*WRENCH)),
    ("force_torque.units.force = 'kN'", _scaled(1e-3, *FORCE)),
    ("force_torque.units.torque = 'N mm'", _scaled(1e3, *TORQUE)),
    ("force_torque.axes = ['y', 'z', 'x']", _both(ROUND(FORCE), ROUND(TORQUE))),
    ("force_torque.torque_axes = ['y', 'z', 'x']", ROUND(TORQUE)),
    ("force_torque = {axes = ['x', 'y', '-z'], left_handed = true}", _both(MIRROR(FORCE), MIRROR(TORQUE))),
    ("force_torque.acts_on = 'environment'", _scaled(-1.0, *WRENCH)),
    ("force_torque.frame = 'base'", _turned(FORCE, TORQUE)),
    ("force_torque.torque_frame = 'base'", _turned(TORQUE)),
    ("force_torque = {frame = 'base', torque_frame = 'sensor'}", _turned(FORCE)),
    (f"force_torque.reference = {SHIFT.tolist()}", _moved(lambda log: SHIFT)),
    ("force_torque.reference = 'base'", _moved(lambda log: -_turn(log).inv().apply(_of(log, PLACE)))),
    (f"orientation.columns = {[f'my {name}' for name in TURN]}", _renamed(*TURN)),
    (
        "orientation = {columns = ['a', 'b', 'c', 'd'], form = 'quaternion_wxyz'}",
        _posed("abcd", lambda turn: turn.as_quat()[:, [3, 0, 1, 2]]),
    ),
    ("orientation = {columns = ['a', 'b', 'c'], form = 'rotation_vector'}", _posed("abc", Rotation.as_rotvec)),
    (
        "orientation = {columns = ['a', 'b', 'c'], form = 'euler_ZYX_deg'}",
        _posed("abc", lambda turn: turn.as_euler("ZYX", degrees=True)),
    ),
    ("orientation = {columns = ['a', 'b', 'c'], form = 'euler_xyz'}", _posed("abc", lambda turn: turn.as_euler("xyz"))),
    (f"orientation = {{columns = {list('abcdefghi')}, form = 'matrix_rows'}}", _posed("abcdefghi", Rotation.as_matrix)),
    (
        f"orientation = {{columns = {list('abcdefghi')}, form = 'matrix_columns'}}",
        _posed("abcdefghi", lambda turn: turn.inv().as_matrix()),
    ),
    ("orientation.inverse = true", _inverted),
    (
        "orientation.sensor_rotation = [0.6, 0.0, 0.0, 0.8]",
        lambda log: _with(log, TURN, (_turn(log) * FLANGE.inv()).as_quat()),
    ),
    (f"orientation.position = {[f'my {name}' for name in PLACE]}", _renamed(*PLACE)),
    (f"acceleration.columns = {[f'my {name}' for name in PUSH]}", _renamed(*PUSH)),
    ("acceleration.unit = 'g'", _scaled(1.0 / UP[2], *PUSH)),
]


def _answers(key: str, rewritten: Rewritten, folder: Path, scene: str, answer: Callable[[Log], Any]) -> list[Any]:
    """Of the log as it is, and as it is rewritten with the key."""
    rig, log = rig_of(scene), {"six": six, "drift": drifting}[scene]()
    return [
        Scene(answer(lambda: log)).of(rig, folder),
        Scene(answer(lambda: rewritten(log))).of(merged(rig, tomllib.loads(key)), folder),
    ]


@pytest.mark.parametrize(("key", "rewritten"), MEANT, ids=lambda each: each if isinstance(each, str) else "")
def test_a_rewritten_log_has_the_same_contacts(key: str, rewritten: Rewritten, tmp_path: Path) -> None:
    plain, found = _answers(key, rewritten, tmp_path, "six", lambda log: estimated(log, "base"))
    assert same(plain, found, 1e-6)  # of rounding, which a filter of time and a quaternion enlarge


@pytest.mark.parametrize(("key", "rewritten"), [each for each in MEANT if "frame" in each[0] or "axes" in each[0]])
def test_a_rewritten_log_has_the_same_drift(key: str, rewritten: Rewritten, tmp_path: Path) -> None:
    plain, found = _answers(key, rewritten, tmp_path, "drift", drifted)
    assert same(plain, found, 1e-3)  # where a search ends
