"""Do the wrenches fit the body? A wrong unit puts the line of action where the body is not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.signals.recording import Recording
from palpate.spatial.arguments import takes_arrays

__all__ = [
    "LinesOfAction",
    "Plausibility",
    "RequiredBounds",
    "lines_of_action",
    "never_at_rest",
    "unbelievable",
    "unexplained",
]

UNLOADED = (Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID, Status.NO_POSE)
LOADED = 0.3  # of the 95th percentile of the force: below it noise moves the line as much as contact does
MANY = 0.1  # of the loaded samples without an explanation: worth a sentence
NEAR = 0.01  # of the body's size
STICKIEST = 3.0  # friction beyond which it is none: 72 degrees


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


@takes_arrays
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


@takes_arrays
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


@takes_arrays
@dataclass(frozen=True)
class RequiredBounds:
    """Which bounds of friction and torsion the loaded samples ask for.

    Attributes:
        friction: (k,) tan of the angle between -force and normal; torsion: (k,) |torque|/|F . n| [m].
        bounds: the friction and the torsion that were allowed.
        size: of the body [m]: no patch is larger.
    """

    friction: Float[np.ndarray, " k"]
    torsion: Float[np.ndarray, " k"]
    bounds: tuple[float, float]
    size: float = np.inf

    @classmethod
    def of(cls, contacts: Contacts, bounds: tuple[float, float], size: float = np.inf) -> RequiredBounds:
        """By the points, normals and forces of contacts; light ones, which noise turns, are left out."""
        force, normal = contacts.force, contacts.normal
        strength = np.linalg.norm(force, axis=1)
        loaded = contacts.located & (strength > 0)
        if loaded.any():
            loaded &= strength >= LOADED * np.percentile(strength[loaded], 95)
        pressing = np.abs(np.einsum("nk,nk->n", force[loaded], normal[loaded]))
        with np.errstate(divide="ignore"):
            friction = np.sqrt(np.maximum((strength[loaded] / pressing) ** 2 - 1.0, 0.0))
            torsion = np.abs(contacts.torque[loaded]) / pressing
        return cls(friction, torsion, bounds, size)

    @property
    def proposal(self) -> str:
        """The bounds that would hold 95 % of the samples."""
        if not len(self.friction):
            return ""
        friction, torsion = (float(np.percentile(values, 95)) for values in (self.friction, self.torsion))
        if friction > STICKIEST or torsion > self.size:
            return "no bounds that a contact has would do"
        said = f"95 % of the loaded samples stay below friction = {friction:.2g} and torsion = {torsion:.2g} m"
        return said + (self._patch(torsion) if torsion > self.bounds[1] else "")

    @property
    def exceeded(self) -> str:
        """Which bound is exceeded, how often and by how much, or ""."""
        parts: list[str] = []
        for name, values, bound, scale, unit in (
            ("friction", self.friction, self.bounds[0], 1.0, ""),
            ("torsion", self.torsion, self.bounds[1], 1e3, " mm"),
        ):
            beyond = values > bound
            if beyond.any():
                middle = float(np.median(values[beyond]))
                found = f"median {scale * middle:.3g}{unit}, bound {scale * bound:.3g}{unit}"
                patch = self._patch(middle) if name == "torsion" else ""
                parts.append(f"{name} in {beyond.mean():.0%} ({found}{patch})")
        return " and ".join(parts)

    def reach(self, torsion: float) -> float:
        """How far [m] a patch that makes a torsion [m] reaches at least from its pressure's centre.

        Coulomb friction mu p per area turns about that centre with no more than int mu p r dA <= mu F_n R, whatever the
        pressure p; R is the farthest place pressed. A ring makes all of it, an even disc 2/3. mu is the bound.
        """
        return torsion / self.bounds[0]

    def _patch(self, torsion: float) -> str:
        reach = self.reach(torsion)
        if reach > self.size / 2:
            return ""
        return (
            f", which a patch can make, if it reaches {1e3 * reach:.3g} mm or more from its middle at friction "
            f"{self.bounds[0]:.2g}"
        )


@runtime_checkable
class Plausibility(Protocol):
    """What judges whether the samples of a log fit a body."""

    @property
    def size(self) -> float:
        """[m] of the body."""
        ...

    def required_bounds(self, contacts: Contacts) -> RequiredBounds:
        """Return which bounds of friction and torsion the contacts would need."""
        ...

    def warnings(self, recording: Recording) -> list[str]:
        """Return what may be wrong, one sentence each."""
        ...


@takes_arrays
def unexplained(counts: Int[np.ndarray, " s"], required: RequiredBounds | None = None) -> list[str]:
    """Why many of the loaded samples have no contact within the bounds, and which bounds would do; else nothing.

    Args:
        counts: (len(Status),) how many estimates have each `Status`.
        required: which bounds they ask for, where that is known.
    """
    loaded = int(counts.sum() - counts[list(UNLOADED)].sum())
    if not loaded:
        return []
    beyond, off = counts[Status.IMPLAUSIBLE] / loaded, counts[Status.OFF_SURFACE] / loaded
    if beyond + off <= MANY:
        return []
    which = f", by {required.exceeded}; {required.proposal}" if required is not None and required.exceeded else ""
    said = (
        f"of the loaded samples {beyond:.0%} are implausible (beyond the bounds of friction or torsion{which}) and "
        f"{off:.0%} off the surface (no point of it makes such a wrench)"
    )
    if beyond + off <= 0.5:
        return [said]
    return [
        f"{said}: are the units of the torque and of the mesh right, is bias or payload left in or in other units, is "
        "the surface mounted as its pose says, do the normals of an open mesh face out?"
    ]


@takes_arrays
def unbelievable(counts: Int[np.ndarray, " s"], small: int) -> str:
    """The sentence to end with when not one sample can be believed, else empty.

    Args:
        counts: (len(Status),) how many estimates have each `Status`.
        small: of those answered, how many have an ellipse smaller than the body, or none at all.
    """
    answered = int(counts[Status.CONTACT] + counts[Status.AMBIGUOUS])
    loaded = int(counts.sum() - counts[list(UNLOADED)].sum())
    if not loaded:
        return "nothing to believe: there is no contact in it"
    if not answered:
        return f"nothing to believe: none of the {loaded:,} loaded samples is explained by a contact"
    if not small:
        return f"nothing to believe: each of the {answered:,} ellipses is larger than the body"
    return ""
