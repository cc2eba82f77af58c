"""Poses: a group that acts on points, and its ways in and out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from palpate.errors import InputError
from palpate.spatial.pose import Pose, quaternion_from_rotation, rotation_from_quaternion, skew

TINY = 1e-14  # a few roundings of numbers near one


def poses(count: int, seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    return Pose.from_rotation_vector(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))


def vectors(size: int, limit: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, size, elements=st.floats(-limit, limit))


def test_composition_is_application_after_application() -> None:
    a, b, points = poses(50, 0), poses(50, 1), np.random.default_rng(2).normal(size=(50, 3))
    assert np.allclose((a @ b).apply(points), a.apply(b.apply(points)), rtol=0, atol=10 * TINY)
    assert np.allclose((a @ b).rotate(points), a.rotate(b.rotate(points)), rtol=0, atol=10 * TINY)


def test_composition_is_associative_and_the_inverse_inverts() -> None:
    a, b, c = poses(50, 0), poses(50, 1), poses(50, 2)
    one, two = (a @ b) @ c, a @ (b @ c)
    assert np.allclose(one.rotation, two.rotation, rtol=0, atol=TINY)
    assert np.allclose(one.translation, two.translation, rtol=0, atol=10 * TINY)
    for unit in (a @ a.inverse(), a.inverse() @ a):
        assert np.allclose(unit.rotation, np.eye(3), rtol=0, atol=TINY)
        assert np.allclose(unit.translation, 0, rtol=0, atol=10 * TINY)


def test_the_identity_changes_nothing() -> None:
    pose = poses(1, 3)
    assert np.array_equal((Pose.identity() @ pose).rotation, pose.rotation)
    assert np.array_equal(Pose.identity().apply(np.array([1.0, 2, 3])), [1, 2, 3])


def test_a_rotation_vector_turns_about_its_axis_by_its_length() -> None:
    quarter = Pose.from_rotation_vector((0, 0, np.pi / 2), (1.0, 0, 0))
    assert np.allclose(quarter.apply(np.array([1.0, 0, 0])), [1, 1, 0], rtol=0, atol=TINY)
    angles = np.random.default_rng(4).uniform(-1.8, 1.8, (30, 3))  # less than half a turn: there it is unique
    assert np.allclose(Pose.from_rotation_vector(angles, angles).rotation_vector(), angles, rtol=0, atol=10 * TINY)


@pytest.mark.parametrize("spread", [0.0, 1e-9, 0.1])
def test_quaternions_are_those_of_scipy(spread: float) -> None:
    """Also of half turns, whose sign is free, and of matrices that are scaled or otherwise not orthonormal."""
    rng = np.random.default_rng(6)
    axes = np.array([[0, -1, 2], [-1, 2, 0], [-2, 0, 1], [0, 0, -3], [1, -2, 3]])
    half = 2.0 * axes[:, :, None] * axes[:, None] / (axes**2).sum(axis=1)[:, None, None] - np.eye(3)
    matrices = np.concatenate([Rotation.random(500, rng=rng).as_matrix(), half])
    matrices = matrices * rng.uniform(1.0, 1.0 + spread, (505, 1, 1)) + spread * rng.uniform(-0.5, 0.5, (505, 3, 3))
    expected = Rotation.from_matrix(matrices).as_quat(canonical=True)
    assert np.allclose(quaternion_from_rotation(matrices), expected, rtol=0, atol=TINY)


@given(vectors(4, 10.0).filter(lambda q: np.linalg.norm(q) > 1e-3), vectors(3, 10.0))
def test_a_quaternion_turns_as_hamilton_says(quaternion: np.ndarray, v: np.ndarray) -> None:
    """Q v q* with q = (x, y, z, w): v + 2 w (u x v) + 2 u x (u x v)."""
    u, w = np.split(quaternion / np.linalg.norm(quaternion), [3])
    expected = v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v))
    assert np.allclose(rotation_from_quaternion(quaternion) @ v, expected, rtol=0, atol=1e-13)


@given(vectors(3, 1e3), vectors(3, 1e3))
def test_skew_is_the_cross_product(v: np.ndarray, u: np.ndarray) -> None:
    assert np.allclose(skew(v) @ u, np.cross(v, u), rtol=0, atol=1e-9)  # 1e6 times a few roundings
    assert np.array_equal(skew(v), -skew(v).T)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_batches_lead(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    pose = Pose.from_quaternion(rng.normal(size=(*shape, 4)), rng.normal(size=(*shape, 3)))
    points = rng.normal(size=(*shape, 3))
    assert pose.apply(points).shape == points.shape
    assert pose.wrench_matrix().shape == (*shape, 6, 6)
    assert pose.quaternion().shape == (*shape, 4)
    assert (pose @ pose.inverse()).translation.shape == points.shape
    for at in np.ndindex(shape):
        one = Pose(pose.rotation[at], pose.translation[at])
        assert np.allclose(pose.apply(points)[at], one.apply(points[at]), rtol=0, atol=TINY)
        assert np.allclose(pose.wrench_matrix()[at], one.wrench_matrix(), rtol=0, atol=TINY)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1, -1]), 2 * np.eye(3), np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"not a rotation matrix.*Write"):
        Pose(matrix, np.zeros(3))


def test_poses_are_frozen_and_do_not_share_what_they_were_given() -> None:
    turn = np.eye(3)
    pose = Pose(turn, np.zeros(3))
    turn[0, 0] = 5.0
    assert pose.rotation[0, 0] == 1.0
    for array in (pose.rotation, pose.translation, Pose.identity().rotation, pose.inverse().translation):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0
    with pytest.raises(AttributeError):
        pose.translation = np.ones(3)


def test_one_rotation_serves_many_translations_and_the_other_way_round() -> None:
    turn = Pose.from_rotation_vector([0.1, -0.2, 0.3], np.zeros((5, 3)))
    many = Pose.from_rotation_vector(np.full((5, 3), 0.1), np.zeros(3))
    for pose in (turn, many):
        assert (pose.quaternion().shape, pose.rotation_vector().shape) == ((5, 4), (5, 3))
    assert np.allclose(turn.rotation_vector(), [0.1, -0.2, 0.3])
