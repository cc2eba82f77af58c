"""Do the wrenches fit the body? A wrong unit puts the line of action where the body is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import Status

__all__ = ["LinesOfAction", "lines_of_action", "never_at_rest", "unexplained"]

UNLOADED = (Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID, Status.NO_POSE)
LOADED = 0.3  # of the 95th percentile of the force: below it noise moves the line as much as contact does
NEAR = 0.01  # of the body's size


@dataclass(frozen=True)
class LinesOfAction:
    """Where the wrench axes of the loaded samples pass.

    Attributes:
        loaded: how many samples were looked at.
        far: share whose axis passes the body's middle at more than the body's size.
        near: share whose axis passes the frame's origin at less than a hundredth of the body's size.
    """

    loaded: int
    far: float
    near: float

    @property
    def doubt(self) -> str:
        """The sentence to say when most of them do not fit, else empty."""
        if self.near > 0.5:
            return (
                f"{self.near:.0%} of the loaded samples put the force's line through the sensor's origin, within 1 % "
                "of the body's size: are the units of the torque and of the mesh right (N m, mm)?"
            )
        if self.far > 0.5:
            return (
                f"{self.far:.0%} of the loaded samples put the force's line further from the body than the body is "
                "large: are the units of the torque and of the mesh right (N mm, mm), and is bias or payload left in?"
            )
        return ""


def lines_of_action(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], size: float) -> LinesOfAction:
    """Compare the wrench axes with the body, all in one frame.

    The axis of (F, M) passes a point c at |F x (M - c x F)| / |F|^2.

    Args:
        wrenches: (n, 6) without bias and payload [N, N m]; NaN is left out.
        centre: (3,) middle of the body [m].
        size: of the body [m].
    """
    force, torque = wrenches[:, :3], wrenches[:, 3:]
    strength = np.where(np.isfinite(wrenches).all(axis=1), np.linalg.norm(force, axis=1), 0.0)
    present = strength[strength > 0]
    if not len(present):
        return LinesOfAction(0, 0.0, 0.0)
    loaded = strength >= LOADED * np.percentile(present, 95)
    force, torque, square = force[loaded], torque[loaded], strength[loaded] ** 2
    about_middle: Float[np.ndarray, " k"] = (
        np.linalg.norm(np.cross(force, torque - np.cross(centre, force)), axis=1) / square
    )
    about_origin: Float[np.ndarray, " k"] = np.linalg.norm(np.cross(force, torque), axis=1) / square
    far, near = np.mean(about_middle > size), np.mean(about_origin < NEAR * size)
    return LinesOfAction(int(np.count_nonzero(loaded)), float(far), float(near))


def never_at_rest(wrenches: Float[np.ndarray, "n 6"], on: float) -> str:
    """The sentence to say when the force never falls below the threshold of contact, else empty.

    Args:
        wrenches: (n, 6) as they are located [N, N m].
        on: force [N] at which a contact begins.
    """
    strength = np.linalg.norm(wrenches[:, :3], axis=1)
    least = float(np.percentile(strength[np.isfinite(strength)], 1)) if np.isfinite(strength).any() else 0.0
    if least <= on:
        return ""
    return f"the force is never below {least:.3g} N: if the log has free moments, bias or payload is left in it"


def unexplained(counts: Int[np.ndarray, " s"]) -> list[str]:
    """The sentence to say when a contact within the bounds explains fewer than half of the loaded samples, else none.

    Args:
        counts: (len(Status),) how many estimates have each `Status`.
    """
    loaded = int(counts.sum() - counts[list(UNLOADED)].sum())
    if not loaded:
        return []
    beyond, off = counts[Status.IMPLAUSIBLE] / loaded, counts[Status.OFF_SURFACE] / loaded
    if beyond + off <= 0.5:
        return []
    return [
        f"of the loaded samples {beyond:.0%} are implausible (beyond the bounds of friction or torsion) and {off:.0%} "
        "off the surface (no point of it makes such a wrench): are the units of the torque and of the mesh right, is "
        "bias or payload left in or in other units, is the surface mounted as its pose says, do the normals of an open "
        "mesh face out?"
    ]
