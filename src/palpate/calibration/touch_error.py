"""Estimate errors of touches at known points beyond wrench noise: indentation, marks, the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.ground_truth import TrueTouches
from palpate.signals.correlation import correlation_time
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose, skew

FOLDS, MANY = 4, 24  # parts that are judged by the others, where there are so many touches
SURE = 4.0  # over sqrt(n): a correlation time of n touches that differs from 1 by less is none


@dataclass(frozen=True)
class TouchError:
    """Standard deviations [m] along one tangent of a sample's apparent contact point about its mark.

    Attributes:
        common: beyond the noise, common to the samples of a touch.
        noise: due to the noise of a single sample.
    """

    common: float
    noise: float

    def placement(self, marks: float) -> float:
        """Return the part of `common` [m] beyond `marks` [m], the standard deviation of how well marks are hit."""
        return max(self.common**2 - marks**2, 0.0) ** 0.5


@takes_arrays
def touch_error(
    time: Float[np.ndarray, " m"],
    wrenches: Float[np.ndarray, "m 6"],
    touches: TrueTouches,
    normals: Float[np.ndarray, "n 3"],
    noise: Float[np.ndarray, "6 6"] | None,
    pose_from: Callable[[Int[np.ndarray, " k"]], Pose],
) -> TouchError:
    """Estimate the `TouchError` of touches at known points.

    A wrench that acts at a distance d from the mark p, across its normal n, has r = M - p x F = d x F + tau n, so

        d = n x r / (n . F),    Sigma_d = G Sigma G^T with G = [n]x (-[p]x, 1) / (n . F),

    and each touch gives the mean of |d|^2/2 - tr Sigma_d/2 over its samples, weighted by (n . F)^2. From 24 touches
    on, each quarter of them is compared with the pose that the others give; fewer are compared with the pose of all,
    which fits them too well by (2 n - 6)/(2 n).

    Args:
        time: (m,) [s].
        wrenches: (m, 6) in the sensor's frame, compensated; NaN: omitted.
        touches: n touches at known points in the surface's frame.
        normals: (n, 3) at these points.
        noise: (6, 6) covariance of a sample; None: 0.
        pose_from: returns T_sensor_surface from the touches of these numbers.

    Raises:
        InputError: arrays of other shapes.
    """
    every: Int[np.ndarray, " n"] = np.arange(len(touches), dtype=np.int64)
    folds = np.array_split(every, FOLDS) if len(touches) >= MANY else [every]
    moments = list[tuple[float, float]]()
    for fold in folds:
        pose = pose_from(np.setdiff1d(every, fold) if len(folds) > 1 else every)
        for k in fold:
            inside = wrenches[(time >= touches.start[k]) & (time <= touches.end[k])]
            inside = inside[np.isfinite(inside).all(axis=1)]
            moments += _moments(inside, pose.apply(touches.point[k]), pose.rotate(normals[k]), noise)
    if not moments:
        return TouchError(0.0, 0.0)
    free = 1.0 if len(folds) > 1 else 1.0 - min(3.0 / len(moments), 0.75)
    square, by_noise = (float(np.mean(each)) for each in zip(*moments, strict=True))
    return TouchError(max(square / free - by_noise, 0.0) ** 0.5, by_noise**0.5)


def _moments(
    wrenches: Float[np.ndarray, "m 6"],
    point: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    noise: Float[np.ndarray, "6 6"] | None,
) -> list[tuple[float, float]]:
    """Return the mean of |d|^2/2 over a touch, and the part due to noise, if anything pressed."""
    weight = float(np.sum(np.square(wrenches[:, :3] @ normal)))
    if not weight > 0:
        return []
    across = np.cross(normal, wrenches[:, 3:] - np.cross(point, wrenches[:, :3]))  # d (n . F)
    slope = skew(normal) @ np.concatenate([-skew(point), np.eye(3)], axis=1)
    by_noise = 0.0 if noise is None else float(np.trace(slope @ noise @ slope.T))
    return [(float(np.sum(across**2)) / weight / 2.0, by_noise * len(wrenches) / weight / 2.0)]


@takes_arrays
def spread_in_time(errors: Float[np.ndarray, "n k"]) -> float:
    """Return the longest correlation time of errors (n, k) of n touches, in touches; 1 if it is not significant.

    Raises:
        InputError: errors has another shape.
    """
    longest = float(correlation_time(errors).max())
    return longest if longest > 1.0 + SURE / len(errors) ** 0.5 else 1.0
