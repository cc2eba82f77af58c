"""Check whether wrenches fit the body."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Int8

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.locate import Locator
from palpate.contact.meaning import Known, other_meaning, reversed_sign, smaller_body
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE, Recording
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose, rotation_from_quaternion

UNLOADED = (Status.NO_CONTACT, Status.TOO_LIGHT, Status.INVALID, Status.NO_POSE)
LOADED = 0.3  # of the 95th percentile of the force: below it noise moves the line as much as contact does
MANY = 0.1  # of the loaded samples without an explanation: worth a sentence
NEAR = 0.01  # of the body's size
_Sensed = tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None, Int8[np.ndarray, " n"]]
SELDOM, LONG = 0.01, 0.2  # share of samples at rest in a stretch without rest, and of the log that it is at least
SAMPLED = 300  # samples, evenly spread, among which the most frequent force is searched for
RETURNS = 4  # touches after which the force must be back at that value
STICKIEST = 3.0  # friction beyond which it is none: 72 degrees


@takes_arrays
def lines_of_action(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], size: float) -> str:
    """Return a warning if most of the wrench axes do not fit the body, all in one frame; else "".

    The axis of (F, M) passes a point c at |F x (M - c x F)| / |F|^2: too far from the middle of the body, or too near
    to the origin of the frame.

    Args:
        wrenches: (n, 6) without bias and payload [N, N m]; rows with NaN are left out.
        centre: (3,) middle of the body [m].
        size: of the body [m].

    Raises:
        InputError: arrays of other shapes.
    """
    force, torque = wrenches[:, :3], wrenches[:, 3:]
    strength = np.where(np.isfinite(wrenches).all(axis=1), np.linalg.norm(force, axis=1), 0.0)
    if not strength.any():
        return ""
    loaded = strength >= LOADED * np.percentile(strength[strength > 0], 95)
    force, torque, square = force[loaded], torque[loaded], strength[loaded] ** 2
    from_middle: Float[np.ndarray, " k"] = np.linalg.norm(np.cross(force, torque - np.cross(centre, force)), axis=1)
    from_origin: Float[np.ndarray, " k"] = np.linalg.norm(np.cross(force, torque), axis=1)
    far, near = np.mean(from_middle / square > size), np.mean(from_origin / square < NEAR * size)
    if near > 0.5:
        return (
            f"in {near:.0%} of the loaded samples the line of the force passes through the sensor's origin, "
            "within 1 % of the body's size: check the units of the torque and of the mesh (N m, mm)"
        )
    if far > 0.5:
        return (
            f"in {far:.0%} of the loaded samples the line of the force is further from the middle of the body "
            "than the body is large: check the units of the torque and of the mesh (N mm, mm), the frame and reference "
            "of the wrench, and that bias and payload are removed"
        )
    return ""


@takes_arrays
def never_at_rest(
    wrenches: Float[np.ndarray, "n 6"], on: Float[np.ndarray, " k"], time: Float[np.ndarray, " n"] | None = None
) -> str:
    """Return a warning if the force never falls below the threshold of contact, else "".

    With times, a long stretch at the end or the beginning is a reason, too, if the force is the same between touches.

    Args:
        wrenches: (n, 6) [N, N m], force first.
        on: (n,) or (1,) force [N] at which a contact begins.
        time: (n,) [s] in order; None: not known.

    Raises:
        InputError: arrays of other shapes.
    """
    force = wrenches[:, :3]
    known = np.isfinite(force).all(axis=1)
    force, on = force[known], np.broadcast_to(on, len(force))[known]
    strength = np.linalg.norm(force, axis=1)
    if not len(force):
        return ""
    if np.percentile(strength - on, 1) > 0.0:
        least = float(np.percentile(strength, 1))
        return f"the force is never below {least:.3g} N: if nothing touches at times, bias or payload is not removed"
    if time is None:
        return ""
    for way, when in ((-1, "from {} s on"), (1, "until {} s")):
        resting = np.cumsum((strength <= on)[::way]) / np.arange(1, len(on) + 1)
        count = int(np.flatnonzero(resting <= SELDOM).max(initial=-1)) + 1
        rows = np.sort(np.arange(len(on))[::way][:count])
        again = _returned_to(force[rows], float(on[rows].min())) if count > LONG * len(on) else np.arange(0)
        if len(again):
            level, since = np.linalg.norm(np.median(force[rows[again]], axis=0)), rows[again[0 if way < 0 else -1]]
            return (
                f"{when.format(f'{time[known][since]:.1f}')} the force is {level:.2g} N between touches, and nearly 0 "
                "otherwise: the sensor's bias jumped, or something rests on it; cut the log there and tare each part"
            )
    return ""


def _returned_to(force: Float[np.ndarray, "n 3"], on: float) -> Int[np.ndarray, " m"]:
    """Return the rows at the most frequent force, if touches by more than it begin and end there; else none."""
    some = force[:: max(1, len(force) // SAMPLED)]
    level = some[(np.linalg.norm(some[:, None] - some, axis=2) < on / 2).sum(axis=1).argmax()]
    away = np.linalg.norm(force - level, axis=1)
    near = away < on
    seen = near | (away > max(3.0 * on, float(np.linalg.norm(level))))
    visits = np.diff(near[seen].astype(int), prepend=0) == 1
    steady = near.any() and np.median(away[near]) < on / 2
    return np.flatnonzero(near & (steady and visits.sum() >= RETURNS))


@frozen_value(eq=True)
class RequiredBounds:
    """Friction and torsion of the loaded samples, compared with the bounds.

    Attributes:
        friction: (k,) tan of the angle between -force and normal.
        torsion: (k,) |torque|/|F . n| [m].
        bounds: friction and torsion [m] that were allowed.
        size: of the body [m]; no patch is larger.
    """

    friction: Float[np.ndarray, " k"]
    torsion: Float[np.ndarray, " k"]
    bounds: tuple[float, float]
    size: float = np.inf

    @classmethod
    def of(cls, contacts: Contacts, bounds: tuple[float, float], size: float = np.inf) -> RequiredBounds:
        """Return the `RequiredBounds` of the loaded contacts; noise turns the light ones, which are left out.

        Args:
            contacts: with points and normals where located.
            bounds: friction and torsion [m] that were allowed.
            size: of the body [m].
        """
        force, normal = contacts.force, contacts.normal
        strength = np.linalg.norm(force, axis=1)
        loaded = contacts.located & (strength > 0)
        if loaded.any():
            loaded &= strength >= LOADED * np.percentile(strength[loaded], 95)
        pressing = np.abs(np.einsum("nk,nk->n", force[loaded], normal[loaded]))
        with np.errstate(divide="ignore", invalid="ignore"):
            friction = np.sqrt(np.maximum((strength[loaded] / pressing) ** 2 - 1.0, 0.0))
            torsion = np.where(pressing > 0, np.abs(contacts.torque[loaded]) / pressing, np.inf)
        return cls(friction, torsion, bounds, size)

    @property
    def proposal(self) -> str:
        """Bounds that would include 95 % of the samples, in words, or that none would; "" without samples."""
        if not len(self.friction):
            return ""
        finite = (np.minimum(values, 1e300) for values in (self.friction, self.torsion))  # percentiles lie between two
        friction, torsion = (float(np.percentile(values, 95)) for values in finite)
        if friction > STICKIEST or torsion > self.size:
            return "no bounds that a real contact can have would include them"
        said = f"95 % of the loaded samples stay below friction = {friction:.2g} and torsion = {torsion:.2g} m"
        return said + (self._patch(torsion) if torsion > self.bounds[1] else "")

    @property
    def exceeded(self) -> str:
        """Bounds that are exceeded, in words, with share of the samples and median; "" if none is."""
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
        """Return the least distance [m] from the centre of pressure to which a patch with this torsion [m] extends.

        Coulomb friction makes a torque of at most int mu p r dA <= mu F_n R about that centre, whatever the pressure p;
        R is the farthest place pressed, mu the bound. A ring attains it, an even disc 2/3 of it.
        """
        return torsion / self.bounds[0]

    def _patch(self, torsion: float) -> str:
        reach = self.reach(torsion)
        if reach > self.size / 2:
            return ""
        return (
            f", which a contact patch can make if it extends {1e3 * reach:.3g} mm or more from its middle at friction "
            f"{self.bounds[0]:.2g}"
        )


class Plausibility:
    """Check of whether the wrenches of a log fit the body on which they are located.

    Args:
        locator: on the surface.
        unfiltered: turns a recording into wrenches (n, 6) [N, N m] about the surface's frame, force first, covariances
            and statuses.
        mount: T_sensor_surface.

    Attributes:
        stated: what a rig states of the wrench: fields of `Known`.
    """

    def __init__(self, locator: Locator, unfiltered: Callable[[Recording], _Sensed], mount: Pose) -> None:
        self._locator, self._unfiltered, self._mount = locator, unfiltered, mount
        self.stated: Mapping[str, Any] = {}

    @property
    def size(self) -> float:
        """Size of the body [m]."""
        return self._locator.surface.size

    def required_bounds(self, contacts: Contacts) -> RequiredBounds:
        """Return the friction and torsion that the contacts would need, as `RequiredBounds`."""
        return RequiredBounds.of(contacts, (self._locator.friction, self._locator.torsion), self.size)

    def warnings(self, recording: Recording) -> list[str]:
        """Return warnings of wrong units, bias or mounting, a list of sentences or [].

        Raises:
            InputError: a channel is missing or has another shape.
        """
        surface = self._locator.surface
        wrenches, covariances, _ = self._unfiltered(recording)
        sensed = wrenches @ self._mount.wrench_matrix().T  # saturated: a wrong unit does that
        on = self._locator.least_forces(covariances)
        if not (np.linalg.norm(sensed[:, :3], axis=1) > on).any():
            return []
        judged = (
            *self._meanings(recording, sensed),
            lines_of_action(sensed, self._mount.apply(surface.centre), surface.size),
            never_at_rest(sensed, on, recording.time),
        )
        return [warning for warning in judged if warning]

    def _meanings(self, recording: Recording, sensed: Float[np.ndarray, "n 6"]) -> tuple[str, ...]:
        """Return warnings on what a recorded wrench means, each "" if there is none; () for another sensor."""
        channels = recording.channels
        if not {FORCE, TORQUE} <= channels.keys():
            return ()
        posed = ORIENTATION in channels
        rotation = rotation_from_quaternion(channels[ORIENTATION]) if posed else None
        known = Known(sensed, rotation, channels.get(POSITION), recording.frame, **self.stated)
        return tuple(judge(known, self._locator, self._mount) for judge in (other_meaning, reversed_sign, smaller_body))


@takes_arrays
def unexplained(counts: Int[np.ndarray, " s"], required: RequiredBounds | None = None) -> list[str]:
    """Return a list of one warning if over 10 % of the loaded samples have no contact within the bounds, else [].

    Args:
        counts: (len(Status),) number of estimates with each `Status`.
        required: the bounds that they need, if known, for a proposal in the warning.

    Raises:
        InputError: counts are not whole numbers.
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
        f"{off:.0%} are off the surface (no point of it can make the wrench)"
    )
    if beyond + off <= 0.5:
        return [said]
    return [
        f"{said}: check the units of the torque and of the mesh, frame, axes and reference of the wrench, bias and "
        "payload and their units, the pose of the surface, and that the normals of an open mesh point outward"
    ]


def endless(first: float, since: float, last: float, cause: str) -> list[str]:
    """Return a list of one warning if a contact goes on for more than half of a log, to its end, else [].

    Args:
        first: time [s] of the first sample.
        since: time [s] from which every sample has a contact; NaN: the last one has none.
        last: time [s] of the last sample.
        cause: what explains it, if nothing touches there.
    """
    if not since <= 0.5 * (first + last) or first == last:
        return []
    return [f"there is a contact from {since:.2f} s to the end of the log: if nothing touches there, {cause}"]


@takes_arrays
def unbelievable(counts: Int[np.ndarray, " s"], small: int) -> str:
    """Return a sentence if no sample of a log can be trusted, else "".

    No sample is loaded, no contact explains a loaded one, or every ellipse is larger than the body.

    Args:
        counts: (len(Status),) number of estimates with each `Status`.
        small: number of contacts whose 95 % ellipse is smaller than the body, or that have none.

    Raises:
        InputError: counts are not whole numbers.
    """
    answered = int(counts[Status.CONTACT] + counts[Status.AMBIGUOUS])
    loaded = int(counts.sum() - counts[list(UNLOADED)].sum())
    if not loaded:
        return "no result to trust: the log has no contact"
    if not answered:
        return f"no result to trust: a contact explains none of the {loaded:,} loaded samples"
    if not small:
        return f"no result to trust: each of the {answered:,} ellipses is larger than the body"
    return ""
