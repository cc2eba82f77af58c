"""A session of pokes in time and on disk: what a reader finds there is what was simulated."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from palpate.files.ground_truth import read_ground_truth
from palpate.files.urdf import Kinematics, Urdf
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import PokeBench, PokeSession
from palpate_lab.simulation.poke_log import EVERY, RATE, PokeLog, simulate_poke_log
from palpate_lab.simulation.poke_session_files import JOINT_TOPIC, JOINTS, TAXEL_TOPIC, WRENCH_TOPIC, write_poke_session
from tests.support.read_back import messages, rows

Written = tuple[PokeSession, TaxelPlaces, PokeLog, Path]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    rng = np.random.default_rng(1)
    arm = Forearm.of()
    session = PokeBench.drawn(rng, skin=arm).session(rng, 20)
    cad, folder = arm.cad(rng), tmp_path_factory.mktemp("pokes") / "session"
    return session, cad, write_poke_session(session, arm.cone, cad, folder, rng, touches=6), folder


def test_pokes_cut_from_the_log_are_those_of_the_session(written: Written) -> None:
    """The mean over 0.3 s less the mean of 0.3 s of rest before: white noise of 0.05 N and 2 N mm over 60 samples each.

    The largest of 20 times 3 numbers stays within five deviations; the bias of the configuration is gone.
    """
    session, _, log, _ = written
    cut = np.array([_mean(log, a, b) for a, b in zip(log.start, log.end, strict=True)])
    rest = np.array([_mean(log, a - 0.55, a - 0.25) for a in log.start])
    expected = session.pokes.wrench - session.bench.bias[session.pokes.configuration]
    spread = np.repeat([0.05, 0.002], 3) * np.sqrt(2 / 60)
    assert (np.abs(cut - rest - expected) < 5 * spread).all()


def _mean(log: PokeLog, start: float, end: float) -> Float[np.ndarray, "6"]:
    return log.wrench[(log.time >= start) & (log.time < end)].mean(axis=0)


def test_taxels_answer_while_they_are_poked_and_rest_else(written: Written) -> None:
    session, _, log, _ = written
    time, above = log.time[::EVERY], log.taxels - log.rest
    poked = np.zeros(len(time), dtype=bool)
    for poke, (start, end) in enumerate(zip(log.start, log.end, strict=True)):
        poked |= (time > start - 0.16) & (time < end + 0.16)
        middle = above[(time >= start) & (time < end)].mean(axis=0)
        own = session.pokes.poke == poke
        np.testing.assert_allclose(middle[session.pokes.taxel[own]], session.pokes.response[own], atol=1.6)
        rising = above[(time > start - 0.15) & (time < start)].mean(axis=0)
        strongest = middle.argmax()
        assert 0.3 < rising[strongest] / middle[strongest] < 0.7  # with the force, which rises evenly
    assert np.abs(above[~poked]).max() <= 2
    assert (above[poked].max(axis=1) > 2).mean() > 0.8


def test_the_arm_stands_while_it_is_poked_and_moves_between(written: Written) -> None:
    session, _, log, _ = written
    joints = session.bench.arm.joints[session.pokes.configuration]
    for start, end, there in zip(log.start, log.end, joints, strict=True):
        inside = (log.time >= start - 0.5) & (log.time < end)
        np.testing.assert_array_equal(log.joints[inside], np.tile(there, (int(inside.sum()), 1)))
    assert np.abs(np.diff(log.joints, axis=0)).max() * RATE < 2.0  # rad/s, what the URDF allows
    assert log.time[0] + 2.0 < log.start[0]
    assert len(np.unique(log.joints[(log.time < log.start[0] - 1.0)], axis=0)) > 100  # free motion first
    assert (np.diff(log.joints[:, 0]) != 0).sum() > 7 * 2 * 250


def test_the_mcap_file_holds_the_log(written: Written) -> None:
    """Read by the mcap library; stamps to the nanosecond, numbers to the last bit."""
    _, _, log, folder = written
    read = messages(folder / "pokes.mcap")
    assert {topic: len(each) for topic, each in read.items()} == {
        WRENCH_TOPIC: len(log.time),
        JOINT_TOPIC: (len(log.time) + 1) // 2,
        TAXEL_TOPIC: len(log.taxels),
    }
    stamps, frames = zip(*read[TAXEL_TOPIC], strict=True)
    np.testing.assert_array_equal(stamps, np.rint(log.time[::EVERY] * 1e9))
    np.testing.assert_array_equal(np.stack([each.data for each in frames]), log.taxels)
    assert frames[0].layout.dim[0].size == 84
    stamps, joints = zip(*read[JOINT_TOPIC], strict=True)
    assert joints[0].name == list(JOINTS)
    np.testing.assert_array_equal(np.stack([each.position for each in joints]), log.joints[::2])
    forces = [each.wrench.force.x for _, each in read[WRENCH_TOPIC]]
    np.testing.assert_array_equal(forces, log.wrench[:, 0])


def test_the_urdf_is_the_arm(written: Written) -> None:
    """By pinocchio, at random joints."""
    session, _, _, folder = written
    pytest.importorskip("pinocchio")
    kinematics = Kinematics(Urdf(folder / "arm.urdf"), "ft_sensor", "forearm")
    joints = np.random.default_rng(2).uniform(-1.0, 1.5, (20, 2))
    turned, moved = kinematics.poses(joints[:, [JOINTS.index(name) for name in kinematics.joints]])
    quaternion, position = turned[:, 0], moved[:, 0]
    pose = session.bench.arm.pose(joints[:, 0], joints[:, 1])
    np.testing.assert_allclose(Pose.from_quaternion(quaternion, position).rotation, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(position, pose.translation, atol=1e-12)


def test_the_mesh_is_that_of_the_link(written: Written) -> None:
    """STL holds float32: 4e-9 m of 160 mm."""
    session, _, _, folder = written
    mesh = Mesh.load(folder / "forearm.stl", "m")
    here, _, _ = mesh.project(session.bench.skin.places.positions)
    away = np.linalg.norm(here - session.bench.skin.places.positions, axis=1)
    assert away.max() < 0.04 * (1 - np.cos(np.pi / 96)) + 1e-8


def test_places_and_pokes_are_written_as_they_are(written: Written) -> None:
    session, cad, _, folder = written
    np.testing.assert_allclose(
        np.loadtxt(folder / "cad.txt"), np.column_stack([cad.positions, cad.normals]), atol=5.1e-7
    )
    truth = np.array([[float(each) for each in row.values()] for row in rows(folder / "truth.csv")])
    np.testing.assert_allclose(truth[:, :3], session.bench.skin.places.positions, rtol=1e-6)
    pokes = rows(folder / "pokes.csv")
    np.testing.assert_allclose([float(row["tz"]) for row in pokes], session.pokes.wrench[:, 5], rtol=1e-6)
    answers = np.array([[float(row[f"t{k}"]) for k in range(84)] for row in pokes])
    np.testing.assert_array_equal(answers[session.pokes.poke, session.pokes.taxel], session.pokes.response)
    assert (answers > 0).sum() == len(session.pokes.response)
    turn = Pose.from_quaternion([[float(row[name]) for name in ("qx", "qy", "qz", "qw")] for row in pokes], np.zeros(3))
    np.testing.assert_allclose(turn.rotation, session.pokes.rotation, atol=1e-6)


def test_the_truth_of_touches_is_one_that_evaluate_reads(written: Written) -> None:
    _, _, _, folder = written
    for name, together in (("touches", 1), ("pairs", 2)):
        truth = read_ground_truth(folder / f"{name}_truth.csv")
        assert (np.unique(truth.time, return_counts=True)[1] == together).all()
        read = messages(folder / f"{name}.mcap")
        assert set(read) == {TAXEL_TOPIC}
        frames = np.array([[float(row[f"t{k}"]) for k in range(84)] for row in rows(folder / f"{name}.csv")])
        np.testing.assert_array_equal(frames, np.stack([message.data for _, message in read[TAXEL_TOPIC]]))


def test_configurations_that_come_back_are_refused() -> None:
    rng = np.random.default_rng(3)
    bench = PokeBench.drawn(rng)
    points = bench.skin.places.positions[:3]
    session = bench.poke_at(points, bench.directions(points, rng), np.array([0, 1, 0]), rng)
    with pytest.raises(ValueError, match="order of their configurations"):
        simulate_poke_log(session, rng)
