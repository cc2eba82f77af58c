"""Poses, wrenches and their covariances."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "spatial/pose.py",
        "tests/spatial",
        (
            "the lever is taken in the source's axes",
            "skew(self.translation) @ self.rotation",
            "self.rotation @ skew(self.translation)",
        ),
        ("a quaternion is read w first", "q[..., 3, None, None]", "q[..., 0, None, None]"),
        ("reflections pass for rotations", "np.any(np.linalg.det(self.rotation) < 0)", "False"),
    ),
    *of(
        "spatial/uncertain.py",
        "tests/spatial",
        ("a turn of the pose does not turn the torque", "jacobian[..., 3:, :3] = -torque", "pass"),
        ("a shift of the pose makes no torque", "jacobian[..., 3:, 3:] = -force", "pass"),
        (
            "the adjoint is transposed",
            "adjoint @ covariance @ adjoint.T",
            "adjoint.T @ covariance @ adjoint",
        ),
        ("deviations are taken for variances", "np.diag(array**2)", "np.diag(array)"),
        ("negative eigenvalues pass", "np.linalg.eigvalsh(array).min() < -1e-12 * np.abs(array).max()", "False"),
    ),
    *of(
        "spatial/wrench.py",
        "tests/spatial",
        (
            "the covariance is carried on one side only",
            "matrix @ self.covariance @ np.swapaxes(matrix, -1, -2)",
            "matrix @ self.covariance",
        ),
    ),
    *of(
        "spatial/interpolate.py",
        "tests/spatial/test_pose_track.py",
        (
            "orientations go the long way round",
            "np.where(np.sum(start * end, axis=-1, keepdims=True) < 0, -end, end)",
            "end",
        ),
        ("the share is taken from the other end", "np.sin((1.0 - u) * angle) / whole", "np.sin(u * angle) / whole"),
    ),
    *of(
        "spatial/frames.py",
        "tests/spatial/test_frame_tree.py",
        ("an edge passed upward is not turned round", "turned = turned.inv()", "pass"),
        (
            "an edge turns what is above it",
            "_product(turn, turned.as_quat())",
            "_product(turned.as_quat(), turn)",
        ),
        (
            "one edge without an answer does not matter",
            "known &= np.isfinite(quaternion).all(axis=1)",
            "known |= np.isfinite(quaternion).all(axis=1)",
        ),
        ("a frame with two parents lies in the first", "len(parents) > 1", "len(parents) > 2"),
    ),
]
