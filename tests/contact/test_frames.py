"""Estimates in another frame are the estimates of the moved body."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.contact import ContactEstimate, Contacts, Locator, Status
from palpate.contact.frames import placed
from palpate.errors import InputError
from palpate.signals import Recording
from palpate.signals.recording import ORIENTATION, POSITION
from palpate.spatial.pose import Pose
from palpate_lab.simulation.contacts import touch_wrenches
from tests.support.bodies import BODIES, R, on_mesh


def test_moving_the_answer_is_moving_the_question() -> None:
    mesh, rng = BODIES["ellipsoid"].mesh, np.random.default_rng(0)
    points, normals, _ = on_mesh(mesh, 50, rng)
    wrenches = touch_wrenches(points, normals, rng, pitch=0.2 * R)
    wrenches[7] = np.nan
    noise = np.diag(np.array([0.02] * 3 + [5e-4] * 3) ** 2)
    move = Pose.from_rotation_vector((0.4, -1.1, 2.0), (0.05, -0.02, 0.11))
    matrix = move.wrench_matrix()
    one = Locator(mesh, noise=noise).run(wrenches, sequential=False).in_frame(move)
    two = Locator(mesh.transformed(move)).run(wrenches @ matrix.T, matrix @ noise @ matrix.T, sequential=False)
    assert one.status[7] == two.status[7]
    for name in ("point", "normal", "force", "torque", "residual", "candidates"):
        # 1e-9 of lengths of centimetres, unit normals turn 50 times faster, forces of 10 N
        assert np.allclose(getattr(one, name), getattr(two, name), rtol=1e-8, atol=1e-10, equal_nan=True), name
    assert np.nanmax(np.abs(one.covariance - two.covariance)) < 1e-6 * np.nanmax(two.covariance)


@pytest.mark.parametrize("samples", [[], [5], [5, 5, 5], [5, 6, 6, 8, 8, 8]])
def test_contacts_of_one_sample_are_all_in_its_own_pose(samples: list[int]) -> None:
    """On a base that moves, in a block that begins at sample 5; a sample between them has none, and one no pose."""
    rng, count = np.random.default_rng(2), len(samples)
    mesh, mount = BODIES["ellipsoid"].mesh, Pose.from_rotation_vector((0.3, 0.2, -0.4), (0.01, 0.02, 0.03))
    points, normals, _ = on_mesh(mesh, max(count, 1), rng)
    estimate = Locator(mesh).run(touch_wrenches(points, normals, rng)[:count], sequential=False)
    turns, places = Rotation.random(4, random_state=3), rng.normal(size=(4, 3))
    quaternions = turns.as_quat()
    quaternions[1] = np.nan
    block = Recording(np.arange(4.0), {ORIENTATION: quaternions, POSITION: places})
    contacts = Contacts(np.array(samples, dtype=np.int64), np.array(samples, float), np.zeros(count, int), estimate)
    found = placed(contacts, block, "base", mount)
    assert found.sample.tolist() == samples
    assert found.point.shape == (count, 3)
    for k, sample in enumerate(samples):
        if sample == 6:
            assert found.status[k] == Status.NO_POSE
            assert np.isnan(found.point[k]).all()
        else:
            there = turns[sample - 5].apply(mount.apply(estimate.point[k])) + places[sample - 5]
            np.testing.assert_allclose(found.point[k], there, atol=1e-12)
            np.testing.assert_allclose(found.force[k], turns[sample - 5].apply(mount.rotate(estimate.force[k])))


def test_a_frame_that_is_none_is_refused_and_nothing_cannot_be_joined() -> None:
    estimate = Locator(BODIES["ellipsoid"].mesh).run(np.zeros((1, 6)))
    contacts, block = Contacts.single(np.zeros(1), estimate), Recording(np.zeros(1), {})
    with pytest.raises(InputError, match="the frame 'world' is unknown"):
        placed(contacts, block, "world", Pose.identity())
    for joined in (Contacts.joined, ContactEstimate.joined):
        with pytest.raises(InputError, match="at least one"):
            joined([])
