"""Define the priors on errors of sensor and robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, radians

from palpate.errors import InputError

__all__ = ["Priors"]


@dataclass(frozen=True)
class Priors:
    """Prior standard deviations, along each axis, of the errors that are estimated with the taxels; 0: not estimated.

    Args:
        bias_force, bias_torque: [N], [N m] of the wrench in each configuration.
        frame, frame_angle: [m], [rad] of the link in the sensor's frame, in each configuration.
        common, common_angle: the same, common to all configurations.
        cross_talk: share of each force and torque that reads as another one, or as more of itself.
        lever: [m] by which cross-talk between forces and torques is scaled.
        start, start_angle: [m], [rad] of each module where a start is given (as in CAD); inf: nothing is known.
        smooth: [m] of single taxels without a surface: offset of each from the mean of its neighbours; inf: any.
        neighbours, spacing: [m] the distance of such taxels to the next ones, and its standard deviation; inf: not
            known.

    Raises:
        InputError: a negative value.
    """

    bias_force: float = 0.3
    bias_torque: float = 0.03
    frame: float = 3e-3
    frame_angle: float = radians(1.0)
    common: float = 3e-3
    common_angle: float = radians(1.0)
    cross_talk: float = 0.02
    lever: float = 0.1
    start: float = 3e-3
    start_angle: float = radians(5.0)
    smooth: float = 1e-3
    neighbours: float = 5e-3
    spacing: float = inf

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise InputError(f"{name} must not be negative.")

    def of_single_taxels(self) -> Priors:
        """Return `Priors` without cross-talk: centroids of answers shrink, which would look like a sensor gain.

        Modules have a model of the responses instead.
        """
        return replace(self, cross_talk=0.0)
