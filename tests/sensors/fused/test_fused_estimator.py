"""A skin and a force/torque sensor on one link, touched in a physics engine; and what goes wrong between the two."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.errors import InputError
from palpate.files.logs import join
from palpate.sensors.fused.estimator import FusedEstimator
from palpate.setup import load_rig
from palpate.setup.pipeline import open_log
from palpate.signals.drift import Drift
from palpate.signals.recording import AVERAGED, CELLS, FORCE, TORQUE, Recording
from palpate.signals.zero_filter import ZeroStatus
from palpate.spatial.pose import Pose
from palpate_lab.simulation.skin_bench import Rolled
from palpate_lab.simulation.touched.files import write_forearm
from palpate_lab.simulation.touched.run import ForearmRun, simulate_forearm
from palpate_lab.simulation.touched.settings import ForearmSettings

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

CALM = ForearmSettings(
    sheet=Rolled(rows=8), touches=2, seconds=8.0, quiet=1.5, unseen=0.0, drags=0.0, lean=0.8, moving=False
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[ForearmRun, Path]:
    made, folder = simulate_forearm(np.random.default_rng(5), CALM), tmp_path_factory.mktemp("forearm")
    write_forearm(made, folder)
    return made, folder


@pytest.fixture(scope="module")
def prepared(run: tuple[ForearmRun, Path]) -> tuple[FusedEstimator, Recording]:
    """Once: what follows begins with `reset`, and nothing tares again."""
    rig = load_rig(run[1] / "both.toml")
    with open_log(run[1] / "both.mcap", rig) as opened:
        assert opened.kind.name == "fusion"
        made, recording = opened.prepared().estimator, join(list(opened))
    assert isinstance(made, FusedEstimator)
    return made, recording


@pytest.fixture(scope="module")
def right(prepared: tuple[FusedEstimator, Recording]) -> tuple[Contacts, tuple[str, ...]]:
    """Contacts of the whole log, and what is doubted of it."""
    estimator, recording = prepared
    return estimator.run(recording), estimator.warnings()


@pytest.fixture
def estimator(prepared: tuple[FusedEstimator, Recording]) -> FusedEstimator:
    prepared[0].reset()
    return prepared[0]


@pytest.fixture(scope="module")
def log(prepared: tuple[FusedEstimator, Recording]) -> Recording:
    return prepared[1]


def _errors(run: ForearmRun, found: Contacts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the force at each true contact that the skin feels, its covariance, and the row that is nearest."""
    errors, covariances, rows = list[np.ndarray](), list[np.ndarray](), list[int]()
    for frame in np.unique(run.truth.frame[run.truth.seen]).tolist():
        here = np.flatnonzero((found.sample == frame) & found.answered)
        for k in range(*run.truth.at(frame).indices(len(run.truth.frame))):
            if run.truth.seen[k] and len(here):
                away = np.linalg.norm(found.point[here] - run.truth.point[k], axis=1)
                if away.min() < 0.01:
                    rows.append(int(here[away.argmin()]))
                    errors.append(found.force[rows[-1]] - run.truth.force[k])
    names = ("force_xx", "force_xy", "force_xz", "force_xy", "force_yy", "force_yz", "force_xz", "force_yz", "force_zz")
    for row in rows:
        covariances.append(np.array([found.features[name][row] for name in names]).reshape(3, 3))
    return np.array(errors), np.array(covariances), np.array(rows)


def test_each_contact_has_its_force_in_3d(
    run: tuple[ForearmRun, Path], right: tuple[Contacts, tuple[str, ...]]
) -> None:
    """And the covariance is as large as the errors."""
    errors, covariances, rows = _errors(run[0], found := right[0])
    size = np.linalg.norm(errors, axis=1)
    assert len(size) > 300
    assert np.median(size) < 0.6
    inside = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors) < 7.81  # chi-square, 3 degrees
    assert inside.mean() > 0.8  # errors of one touch go together, and there are few
    assert (found.features["share"][rows] < 1.0).all()


@pytest.mark.parametrize("lost", ["NaN", "beyond"])
def test_a_frame_without_a_wrench_keeps_what_the_skin_says(
    estimator: FusedEstimator, log: Recording, lost: str
) -> None:
    recording = log.picked(slice(250, 450))
    skin = estimator.taxels.run(recording)
    estimator.reset()
    gone = (np.arange(200) > 50) & (np.arange(200) < 150)
    force = np.where(gone[:, None], np.nan if lost == "NaN" else 1e12, recording.channels[FORCE])
    found = estimator.run(replace(recording, channels={**recording.channels, FORCE: force}))
    within = gone[found.sample] & found.answered
    assert within.any()
    assert (found.features["share"][within] == 1.0).all()
    assert np.isnan(found.features["unexplained"][within]).all()
    assert np.allclose(found.force[within], skin.force[gone[skin.sample] & skin.answered])
    assert any("have no wrench" in said for said in estimator.notes())


def test_a_frame_that_cannot_be_read_is_invalid(estimator: FusedEstimator, log: Recording) -> None:
    recording = log.picked(slice(360, 480))
    cells = recording.channels[CELLS].copy()
    cells[40:90] = np.nan
    found = estimator.run(replace(recording, channels={**recording.channels, CELLS: cells}))
    assert (found.status[(found.sample >= 40) & (found.sample < 90)] == Status.INVALID).all()
    assert np.array_equal(np.unique(found.sample), np.arange(len(recording)))


def _reaction(estimator: FusedEstimator, channels: dict[str, np.ndarray]) -> FusedEstimator:
    channels[FORCE], channels[TORQUE] = -channels[FORCE], -channels[TORQUE]
    return estimator


def _other_link(estimator: FusedEstimator, channels: dict[str, np.ndarray]) -> FusedEstimator:
    """The cells in another order: the map is that of another sheet."""
    channels[CELLS] = channels[CELLS][:, ::-1, ::-1]
    return estimator


def _other_end(estimator: FusedEstimator, channels: dict[str, np.ndarray]) -> FusedEstimator:
    """The sensor is thought to sit at the far end, 0.24 m away."""
    mount = Pose.from_quaternion(estimator.mount.quaternion(), -estimator.mount.translation)
    return FusedEstimator(estimator.taxels, estimator.sensor, estimator.fused, mount)


def _late(estimator: FusedEstimator, channels: dict[str, np.ndarray]) -> FusedEstimator:
    """The wrench of two seconds ago: the frames are every fourth."""
    for name in (FORCE, TORQUE):
        channels[name] = np.roll(channels[name], 50, axis=0)
    return estimator


@pytest.mark.parametrize("wrong", [_reaction, _other_link, _other_end, _late])
def test_what_does_not_belong_together_is_doubted(
    estimator: FusedEstimator, log: Recording, wrong: Callable[[FusedEstimator, dict[str, np.ndarray]], FusedEstimator]
) -> None:
    part = log.picked(slice(0, None, 4))
    channels = {name: values.copy() for name, values in part.channels.items()}
    spoilt = wrong(estimator, channels)
    spoilt.run(replace(part, channels=channels))
    assert [said for said in spoilt.warnings() if "the wrench" in said]


def test_what_belongs_together_is_not_doubted(right: tuple[Contacts, tuple[str, ...]]) -> None:
    assert not [said for said in right[1] if "the wrench" in said]


def test_noise_must_be_known(estimator: FusedEstimator) -> None:
    from palpate.sensors.force_torque.compensation import Compensation
    from palpate.sensors.force_torque.model import ForceTorque

    with pytest.raises(InputError, match=r"needs the noise of the wrenches.*State"):
        FusedEstimator(estimator.taxels, Compensation(ForceTorque()), estimator.fused)


def test_means_have_less_noise(estimator: FusedEstimator, log: Recording) -> None:
    """The log has ten wrenches a frame, and as many times less variance."""
    assert np.median(log.channels[AVERAGED]) == 10
    part = log.picked(slice(300, 500))
    one = replace(part, channels={**part.channels, AVERAGED: np.ones((len(part), 1))})
    means = estimator.run(part).features["force_xx"]
    estimator.reset()
    single = estimator.run(one)
    assert np.nanmean(means) < np.nanmean(single.features["force_xx"])
    estimator.reset()
    bare = replace(part, channels={name: values for name, values in part.channels.items() if name != AVERAGED})
    np.testing.assert_array_equal(estimator.run(bare).point, single.point)  # each wrench is one reading


def test_on_logs_the_zero_beside_a_skin_is_smoothed_from_both_sides(estimator: FusedEstimator, log: Recording) -> None:
    """40 mN/s: forwards a contact is off by what the zero did meanwhile, from both sides by little of it."""
    quiet = log.picked(log.time < log.time[0] + 1.4)
    step, span = log.time[1] - log.time[0], log.time[-1] - log.time[0]
    ends = [replace(quiet, time=quiet.time + span + step), replace(quiet, time=quiet.time + span + step + 1.4)]
    log = join([log, *ends])  # which the touch does not outlast
    ran = np.outer(log.time - log.time[0], [0.04, -0.03, 0.02, 0.0, 0.0, 0.0])
    drifts = replace(log, channels={**log.channels, FORCE: log.channels[FORCE] + ran[:, :3]})
    drift = Drift([0.05] * 3 + [1e-4] * 3)
    parts = deepcopy((estimator.taxels, estimator.sensor, estimator.fused, estimator.mount))  # their zero is followed
    off = dict[str, float]()
    for name in ("forward", "both"):
        made = FusedEstimator(*parts, drift=drift, live=name == "forward")
        made.reset()
        found = Contacts.joined(list(made.stream([drifts])))
        history = made.zero_history()
        assert history is not None
        assert found.sample.max() == len(log) - 1
        true = np.array([np.interp(history.time, log.time, axis) for axis in ran[:, :3].T]).T
        error = history.zero[:, :3] - true
        error -= error[history.time < history.time[0] + 1.0].mean(axis=0)  # the sensor's own zero
        held = history.status == ZeroStatus.HELD
        assert held.sum() > 10
        off[name] = float(np.sqrt(np.mean(error[held] ** 2)))
    assert off["both"] < 0.6 * off["forward"]


def test_what_the_skin_does_not_feel_is_found_too(
    run: tuple[ForearmRun, Path], estimator: FusedEstimator, log: Recording
) -> None:
    """A push off the sheet, with and without touches of the skin; the truth is the wrench that was added."""
    recording = log.picked(slice(100, 500))
    surface = estimator.fused.surface
    point, normal, _ = surface.project(surface.centre[None] + [[0.0, 0.0, -0.45 * surface.size]])
    push = -6.0 * normal[0]
    wrench = estimator.mount.wrench_matrix() @ np.concatenate([push, np.cross(point[0], push)])
    pushed = (np.arange(400) % 200 > 60)[:, None]
    channels = {**recording.channels}
    channels[FORCE] = channels[FORCE] + pushed * wrench[:3]
    channels[TORQUE] = channels[TORQUE] + pushed * wrench[3:]
    recording = Recording(recording.time, channels)
    blocks = estimator.run(recording)
    unseen = blocks.answered & (blocks.identity == 0)
    felt = np.isin(blocks.sample, blocks.sample[blocks.answered & (blocks.identity > 0)])
    assert np.count_nonzero(unseen & felt) > 20
    assert np.count_nonzero(unseen & ~felt) > 20
    alone = np.linalg.norm(blocks.force[unseen & ~felt] - push, axis=1)
    noise = CALM.force_noise * 3**0.5  # N, of one reading
    assert np.median(alone) < noise
    off = list[float]()
    for frame in np.unique(blocks.sample[unseen & felt]).tolist():
        found = blocks.force[(blocks.sample == frame) & blocks.answered].sum(axis=0)
        true = run[0].truth.force[run[0].truth.at(100 + frame)].sum(axis=0) + push
        off.append(float(np.linalg.norm(found - true)))
    assert np.median(off) < noise  # together they are what was measured
