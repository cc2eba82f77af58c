"""What a rig says of a log's units, clock and frames means just that, for contacts and for drift.

Axes, other points of reference and forms of orientations are those of `tests/files/test_wrench_meaning.py`.
"""

import tomllib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.files.logs import join
from palpate.sensors.force_torque.section import stated_sensor
from palpate.setup.pipeline import open_log
from palpate.setup.rig import check_rig
from tests.support.rig_scenes import Log, Scene, drifted, drifting, estimated, merged, rig_of, same, six

FORCE, TORQUE, TURN = ("fx", "fy", "fz"), ("tx", "ty", "tz"), ("qx", "qy", "qz", "qw")
Rewritten = Callable[[Log], Log]


def _scaled(size: float, *names: str) -> Rewritten:
    return lambda log: log | {name: size * log[name] for name in names}


def _turned(*groups: tuple[str, ...]) -> Rewritten:
    """Along the axes of the base."""

    def rewritten(log: Log) -> Log:
        turn = Rotation.from_quat(np.column_stack([log[name] for name in TURN]))
        for names in groups:
            values = turn.apply(np.column_stack([log[name] for name in names]))
            log = log | dict(zip(names, values.T, strict=True))
        return log

    return rewritten


def _about_base(log: Log) -> Log:
    """Torques about the origin of the base."""
    turn, place = (np.column_stack([log[name] for name in names]) for names in (TURN, "xyz"))
    more = np.cross(Rotation.from_quat(turn).inv().apply(place), np.column_stack([log[name] for name in FORCE]))
    return log | {name: log[name] + more[:, k] for k, name in enumerate(TORQUE)}


MEANT: list[tuple[str, Rewritten]] = [
    ("time.unit = 'ms'", _scaled(1e3, "time")),
    ("force_torque.units.force = 'kN'", _scaled(1e-3, *FORCE)),
    ("force_torque.units.torque = 'N mm'", _scaled(1e3, *TORQUE)),
    ("force_torque.acts_on = 'environment'", _scaled(-1.0, *FORCE, *TORQUE)),
    ("force_torque.frame = 'base'", _turned(FORCE, TORQUE)),
    ("force_torque.torque_frame = 'base'", _turned(TORQUE)),
    ("force_torque = {frame = 'base', torque_frame = 'sensor'}", _turned(FORCE)),
    ("force_torque.reference = 'base'", _about_base),
    ("acceleration.unit = 'g'", _scaled(1.0 / 9.80665, "ax", "ay", "az")),
]


MADE: dict[str, tuple[Callable[[], Log], Callable[[Callable[[], Log]], Any], float]] = {
    "six": (six, partial(estimated, frame="base"), 1e-6),  # of rounding
    "drift": (drifting, drifted, 1e-3),  # where a search ends
}


@cache
def _plain(scene: str) -> dict[str, Any]:
    log, answer, _ = MADE[scene]
    return Scene(answer(log)).of(rig_of(scene), Path())


@pytest.mark.parametrize(("key", "rewritten"), MEANT, ids=lambda each: each if isinstance(each, str) else "")
def test_a_rewritten_log_has_the_same_answers(key: str, rewritten: Rewritten, tmp_path: Path) -> None:
    for scene, (log, answer, rtol) in MADE.items():
        if scene == "six" or not ("acceleration" in key or "reference" in key):
            rig = merged(rig_of(scene), tomllib.loads(key))
            assert same(_plain(scene), Scene(answer(lambda log=log: rewritten(log()))).of(rig, tmp_path), rtol), scene


def test_what_a_followed_bias_walks_is_no_noise(tmp_path: Path) -> None:
    """The bias creeps by 50 deviations of the white noise; without [drift] that is noise, too."""
    rng, time, noise = np.random.default_rng(1), np.arange(20_000) / 100.0, list[np.ndarray]()
    crept = 0.02 * (rng.normal(size=(6, 20_000)) + np.linspace(0.0, 50.0, 20_000))
    log = {"time": time} | dict(zip((*FORCE, *TORQUE), crept, strict=True))
    unstated = {"force_torque": {"noise": "DELETED", "payload": "DELETED"}, "orientation": "DELETED"}
    for more in ("drift.walk = {force = 0.02, torque = 0.02}", ""):
        rig = check_rig(merged(merged(rig_of("drift"), unstated), tomllib.loads(more)), tmp_path / "rig.toml")
        with open_log(log, rig) as opened:
            noise.append(np.sqrt(np.diag(stated_sensor(opened.setup, join(list(opened))).noise)))
    np.testing.assert_allclose(noise[0], 0.02, rtol=0.1)
    np.testing.assert_array_less(0.1, noise[1])
