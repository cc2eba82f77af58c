"""Covariances: their stated forms, and first-order rules against finite differences and dice."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.spatial.uncertain import inverse_pose_covariance, noise_covariance
from tests.support.dice import agree, mixed, rolled


def test_six_deviations_are_a_diagonal_and_a_covariance_is_itself() -> None:
    deviations = np.array([1.0, 2, 3, 0.1, 0.2, 0])
    assert np.array_equal(noise_covariance(deviations), np.diag(deviations**2))
    full = np.eye(6) + 0.1
    assert np.array_equal(noise_covariance(full), full)


@pytest.mark.parametrize(
    ("noise", "word"),
    [
        (np.ones(3), r"six standard deviations.*\(3,\).*Write"),
        (np.full(6, 1e200), "from 0 to 1e.*Write"),
        (-np.ones(6), "six standard deviations"),
        ([1, 1, 1, 1, 1, np.nan], "six standard deviations"),
        (np.ones((5, 6)), r"\(5, 6\).*Write"),
        (np.triu(np.ones((6, 6))), "symmetric"),
        (np.full((6, 6), np.inf), "finite"),
        (np.diag([1.0, 1, 1, 1, 1, -1e-3]), "negative eigenvalue"),
    ],
)
def test_bad_noise_is_refused_with_what_it_should_be(noise: object, word: str) -> None:
    with pytest.raises(InputError, match=word):
        noise_covariance(noise)


def test_the_inverse_of_an_uncertain_pose_against_dice() -> None:
    pose, own = Pose.from_rotation_vector((0.3, -0.8, 1.2), (0.05, -0.2, 0.1)), mixed(np.repeat([0.02, 1e-3], 3), 1)

    def inverse(off: np.ndarray) -> np.ndarray:
        turned = Pose.from_rotation_vector(off[:3], off[3:]) @ pose  # about the target's origin, then a shift
        moved = turned.inverse() @ pose  # exp(xi') of the inverse, read off against its mean
        return np.concatenate([moved.rotation_vector(), moved.translation])

    agree(inverse_pose_covariance(pose, own), rolled(inverse, own))
