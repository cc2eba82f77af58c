"""Sessions of the ring: what is recorded is what was done, and its truth is that of the mechanics."""

from pathlib import Path

import numpy as np
import pytest

from palpate.files.ground_truth import read_ground_truth
from palpate_lab.simulation.barrel import Barrel, Indenter
from palpate_lab.simulation.ring_session import (
    Faults,
    Protocol,
    RingSession,
    RingUnit,
    Touching,
    calibration_run,
    touching_run,
)
from palpate_lab.simulation.ring_session_files import write_calibration_run, write_touching_run

cv2 = pytest.importorskip("cv2")
pytest.importorskip("skfem")

UNIT = RingUnit.drawn(0, coarse=True)


@pytest.fixture(scope="module")
def calibration() -> RingSession:
    return calibration_run(UNIT, Protocol(2, (0.002, 0.004), hold=1, pause=1, dragged=2))


@pytest.fixture(scope="module")
def touching() -> RingSession:
    return touching_run(UNIT, Touching(touches=2, moving=1.0, seed=3))


def test_a_calibration_run_begins_unloaded_and_presses_as_asked(calibration: RingSession) -> None:
    touched = calibration.contacts > 0
    assert not touched[:30].any()
    np.testing.assert_array_equal(calibration.markers[0], calibration.markers[29])
    pressed = calibration.depth[touched, 0]
    assert sorted(set(np.round(1e3 * pressed, 6).tolist())) == [2.0, 4.0]
    assert np.abs(calibration.shear[touched]).max() > 0.1  # some were dragged


def test_truth_of_a_frame_is_that_of_one_press(calibration: RingSession) -> None:
    """The second plate, undragged, at half a turn and its deeper step: nothing of the first touch is left over."""
    row = int(np.flatnonzero((np.abs(calibration.angle[:, 0] - np.pi) < 0.1) & (calibration.depth[:, 0] > 0.003))[0])
    barrel = Barrel.built(UNIT.barrel)
    found = barrel.follow([Indenter("plate", np.pi, 0.004)], [(0.5, 0.0), (1.0, 0.0)])[-1]
    assert calibration.force[row] == pytest.approx(found.force, rel=1e-6)
    np.testing.assert_allclose(calibration.markers[row], found.markers, atol=1e-9)


def test_touches_stay_apart_and_move(touching: RingSession) -> None:
    moved = np.abs(np.mod(np.diff(touching.angle[:, 0]) + np.pi, 2 * np.pi) - np.pi)
    speed = moved[np.isfinite(moved)] * UNIT.barrel.radius * 30.0
    assert 0.008 < np.median(speed) < 0.11  # m/s: 10 to 100 mm/s
    both = touching.angle[touching.contacts == 2]
    if len(both):
        apart = np.abs(np.mod(both[:, 0] - both[:, 1] + np.pi, 2 * np.pi) - np.pi)
        assert apart.min() > np.radians(25.0)


def test_faults_are_seen(calibration: RingSession) -> None:
    faults = Faults(hidden=4, blobs=10, black=(1,), frozen=3)
    frames = [frame for frame, _ in zip(calibration.frames(faults=faults), range(6), strict=False)]
    assert frames[1].max() == 0
    assert not np.array_equal(frames[2], frames[3])
    assert np.array_equal(frames[3], frames[5])
    assert not np.array_equal(frames[0], next(iter(calibration.frames())))


def test_files_of_a_calibration_run(calibration: RingSession, tmp_path: Path) -> None:
    write_calibration_run(calibration, tmp_path)
    rows = np.genfromtxt(tmp_path / "truth.csv", delimiter=",", names=True)
    assert len(rows) == len(calibration.time)
    np.testing.assert_allclose(np.radians(rows["angle_deg"]), calibration.angle[:, 0], atol=1e-7)
    video = cv2.VideoCapture(str(tmp_path / "frames.avi"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0)
    read = [video.read() for _ in range(len(rows) + 1)]
    assert [good for good, _ in read] == [True] * len(rows) + [False]
    assert read[0][1].shape == (480, 640, 3)
    sent = next(iter(calibration.frames()))
    assert np.abs(read[0][1].astype(float) - sent).mean() < 10.0  # the same picture, compressed otherwise


def test_files_of_touches_are_read_as_truth(touching: RingSession, tmp_path: Path) -> None:
    write_touching_run(touching, tmp_path, images="folder")
    truth = read_ground_truth(tmp_path / "truth.csv")
    assert len(list((tmp_path / "frames").glob("*.jpg"))) == len(touching.time)
    assert len(truth.time) == touching.contacts.sum()
    np.testing.assert_allclose(np.linalg.norm(truth.point, axis=1), UNIT.barrel.radius, atol=2e-6)
    inward = -np.einsum("ni,ni->n", truth.force, truth.normal)
    np.testing.assert_allclose(inward, touching.force[np.isfinite(touching.force)], atol=1e-5)
