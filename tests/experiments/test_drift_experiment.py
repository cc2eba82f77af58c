"""The study of drift: what is usual eats a contact, and the trials run small."""

from pathlib import Path

import numpy as np

from claims.papers.drift.follow import exponential, one_tare
from claims.papers.drift.real import aged
from claims.papers.drift.study import jumps
from claims.papers.drift.world import NOISE, PLACE, RATE, Touch, drift_of, readings, wrenches


def test_touches_are_forces_at_the_body_and_rise_as_stated() -> None:
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    load = wrenches(time, [Touch(2.0, 8.0, 3.0, 1.0)], np.random.default_rng(0))
    size = np.linalg.norm(load[:, :3], axis=1)
    assert not size[time < 2.0].any()
    np.testing.assert_allclose(size[(time > 3.0) & (time < 7.0)], 3.0, rtol=1e-12)
    np.testing.assert_allclose(size[np.searchsorted(time, 2.5)], 1.5, rtol=1e-9)  # half a cosine
    force, torque = load[1000, :3], load[1000, 3:]
    arm = np.cross(force, torque) / (force @ force)  # the foot of the line of action
    assert np.linalg.norm(np.cross(PLACE - arm, force)) / np.linalg.norm(force) < 0.05  # m: it passes the body


def test_an_average_without_a_gate_takes_a_contact_for_the_zero() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 70.0, 1.0 / RATE)
    seen = readings(time, np.zeros((len(time), 6)), [Touch(5.0, 70.0, 10.0, 0.1)], rng)
    at = np.array([64.0])
    assert np.linalg.norm(exponential(time, seen, at, gated=False)[0, :3]) > 9.9
    assert np.linalg.norm(exponential(time, seen, at, gated=True)[0, :3]) < 0.02
    assert np.linalg.norm(one_tare(time, seen, at)[0, :3]) < 4 * NOISE[0] / np.sqrt(100)
    assert drift_of(2e-3, 1.0).settling == 600.0


def test_a_jump_that_a_skin_does_not_feel_is_followed() -> None:
    line = jumps(0.5, 0.0, 1, skin=True)
    assert line.figures["median off 5 s after"] < 0.05
    assert line.figures["followed"] == 1.0
    assert "a skin feels nothing" in line.what


def test_a_tare_ages_as_the_root_of_time(tmp_path: Path) -> None:
    """Of a pad pressed with 5 N, 4 s after the log's start: what is not known of the zero grows by walk^2 t."""
    rng, time = np.random.default_rng(4), np.arange(600) / 80.0
    press = np.where(time > 4.0, -5.0, 0.0)[:, None] * [0.0, 1.0, 0.0]
    load = np.concatenate([press, np.cross([0.02, 0.008, 0.01], press)], axis=1)
    seen = load + [0.02, 0.02, 0.02, 4e-4, 4e-4, 4e-4] * rng.standard_normal((600, 6))
    names = [f"ft_wrench_{part}_{axis}" for part in ("force", "torque") for axis in "xzy"]
    head, table = ",".join(["timestamp", *names]), np.column_stack([time, seen])
    np.savetxt(tmp_path / "pad.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
    lines = list(aged(tmp_path / "pad.csv", 3e-3, (0.0, 100.0, 3600.0)))
    unsure = np.array([line.figures["zero unsure N"] for line in lines])
    np.testing.assert_allclose(np.diff(unsure**2), 3e-3**2 * np.diff([0.0, 100.0, 3600.0]), rtol=1e-3)
    places = [line.figures["place unsure mm"] for line in lines]
    assert places[0] < places[1] < places[2]
    assert all(line.figures["answered"] == 1.0 for line in lines)
