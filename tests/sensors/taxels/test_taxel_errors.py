"""Places of taxels against others: a rigid motion is taken off exactly, ellipsoids hold what they should."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.places_page import ellipsoid_axes
from palpate.sensors.taxels.plots import unroll
from palpate.sensors.taxels.poking.evaluate import compare_places
from palpate.spatial.pose import Pose


def _skin(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    angle, along = rng.uniform(-1.0, 1.0, count), rng.uniform(-0.05, 0.05, count)
    return np.column_stack([0.03 * np.cos(angle), along, 0.03 * np.sin(angle)])


def test_one_rigid_motion_is_taken_off() -> None:
    truth = _skin(40)
    motion = Pose.from_rotation_vector([0.02, -0.05, 0.03], [2e-3, -1e-3, 4e-3])
    none = np.full_like(truth, np.nan)
    found = compare_places(TaxelPlaces(motion.apply(truth), none), TaxelPlaces(truth, none))
    np.testing.assert_allclose(found.relative, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.absolute, np.linalg.norm(motion.apply(truth) - truth, axis=1))


@pytest.mark.parametrize("free", [2, 3])
def test_ellipsoids_hold_the_truth_in_95_of_100(free: int) -> None:
    """Of covariances of full rank, and of rank two as on a surface; 4,000 taxels: three deviations are one percent."""
    rng, count = np.random.default_rng(1), 4000
    roots = rng.normal(size=(count, 3, free)) * 1e-3
    truth, none = _skin(count), np.full((count, 3), np.nan)
    found = truth + np.einsum("kij,kj->ki", roots, rng.normal(size=(count, free)))
    places = TaxelPlaces(found, none, np.einsum("kij,klj->kil", roots, roots))
    assert compare_places(places, TaxelPlaces(truth, none)).coverage == pytest.approx(0.95, abs=0.01)


def test_half_axes_are_those_of_the_covariance() -> None:
    """On the ellipsoid's axes d' C^-1 d is the quantile, and rotations are proper."""
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(20, 3, 3))
    covariance = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(3)
    axes, frames = ellipsoid_axes(covariance)
    ends = frames * axes[:, None, :]
    square = np.einsum("kia,kij,kja->ka", ends, np.linalg.inv(covariance), ends)
    np.testing.assert_allclose(square, 7.814727903251179, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


def test_taxels_of_two_skins_are_refused_and_never_touched_ones_stand_apart() -> None:
    truth, none = _skin(12), np.full((12, 3), np.nan)
    with pytest.raises(InputError, match=r"taxels: .*12 taxels, but the truth has 10"):
        compare_places(TaxelPlaces(truth, none), TaxelPlaces(truth[:10], none[:10]))
    pokes, module = np.repeat([0, 4], 6), np.repeat([0, 1], 6)
    compared = compare_places(TaxelPlaces(truth, none, module=module, pokes=pokes), TaxelPlaces(truth, none))
    touched = ["of those touched", "of those never touched"]
    names = [name for name, _ in compared.summaries()]
    assert names == ["absolute", "one rigid motion taken off", *touched, "module 0", "module 1"]


def test_a_skin_round_a_link_is_unrolled() -> None:
    """Distances along a cylinder and around it are nearly what they are there, whichever way it lies: for a picture."""
    pose = Pose.from_rotation_vector([0.7, 0.2, -0.4], [0.1, 0.0, 0.3])
    truth = _skin(60)
    flat = unroll(pose.apply(truth))[0]
    way = np.column_stack([truth[:, 1], 0.03 * np.arctan2(truth[:, 2], truth[:, 0])])
    apart = np.linalg.norm(flat[:, None] - flat, axis=2)
    np.testing.assert_allclose(apart, np.linalg.norm(way[:, None] - way, axis=2), atol=5e-3)
