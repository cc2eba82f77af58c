"""Find presses with known forces in a log of taxels with three axes, and what their readings do at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.response import TaxelResponse
from palpate.sensors.taxels.rest import ROUNDING, quantum
from palpate.signals.recording import TEMPERATURE, Recording

FEWEST = 40  # presses
PRESSED, FULL = 0.02, 0.5  # of the largest force, and of the largest of a press, from which frames are used
EACH, EVERY = 4, 2  # frames of a press, and of those each so many to try
MOSTLY, BESIDE = 0.8, 2.0  # of the forces that press; pitches to the nearest taxel, at most, of half of the points
SHEARED = 0.01  # of the force, which the shear across must reach
MOVES, OFTEN = 0.1, 0.2  # of what readings do under a force, and of the frames for which none is stated
STANDS = 10  # frames for which a reading at the end of its range repeats
WARMS = 2.0  # K by which a temperature changes at least, if what it does is learned
LATER, DRIFTS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0), (1.0, 2.0, 5.0, 10.0)  # s to try of `TaxelResponse.late` and `.drift`


@dataclass(frozen=True)
class Presses:
    """Frames of presses with known forces on a body.

    Attributes:
        body: that is pressed.
        guess: its response, of which `late`, `drift`, `limits`, `temperature` are known, and `fade` as it is taken off;
            `thermal` is how far a kelvin more moves readings at rest.
        press, frame: (n,) number of the press of each frame, and its index in the recording.
        readings: (n, k, 3) less the rest [counts].
        noise: (k, 3) of the readings [counts].
        offset: (n, k, 2) of each taxel from the press [pitches].
        point, force: (n, 3) in the body's frame [m], and along both tangents and into the body [N].
        warmer: (n,) [K] than `temperature`; 0 where what it does is not to be learned.
        level: (k, 3) [counts] where readings rest.
    """

    body: TaxelBody
    guess: TaxelResponse
    press: Int[np.ndarray, " n"]
    frame: Int[np.ndarray, " n"]
    readings: Float[np.ndarray, "n k 3"]
    noise: Float[np.ndarray, "k 3"]
    offset: Float[np.ndarray, "n k 2"]
    point: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    warmer: Float[np.ndarray, " n"]
    level: Float[np.ndarray, "k 3"]

    def of(self, chosen: Bool[np.ndarray, " n"]) -> Presses:
        """Return some of the frames."""
        names = "press", "frame", "readings", "offset", "point", "force", "warmer"
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def unfaded(self, fade: float) -> Presses:
        """Return the frames without the share `fade` of their readings that a kelvin more takes away."""
        more = 1.0 + (fade - self.guess.fade) * self.warmer[:, None, None]
        return replace(self, readings=more * self.readings, guess=replace(self.guess, fade=fade))


def known_presses(body: TaxelBody, recording: Recording, truth: TrueSamples) -> Presses:
    """Return the frames of a recording in which a force is known, less the rest before and after."""
    if truth.force is None:
        raise InputError("the true contacts have no forces.", where=recording.source, hint="Add columns fx, fy, fz.")
    guess = TaxelResponse.guessed(len(body), float(np.median(body.spacing)))
    cells = replace(body, response=guess).raw(recording)
    limits, raw = _limits(cells), np.where(np.isfinite(cells), cells, 0.0)
    sound = ((cells > limits[0]) & (cells < limits[1])).all(axis=(1, 2))
    temperature, warmer = _warmth(recording)
    sound, warmer = sound & np.isfinite(warmer), np.where(np.isfinite(warmer), warmer, 0.0)
    time, step = recording.time, float(np.median(np.diff(recording.time)))
    row = np.clip(np.searchsorted(truth.time, time - 0.5 * step), 0, len(truth.time) - 1)
    size = np.linalg.norm(truth.force, axis=1)[row] * (np.abs(truth.time[row] - time) <= 0.5 * step)
    pressed = size > PRESSED * size.max(initial=0.0)
    free = ~(pressed | np.append(pressed[1:], False) | np.append(False, pressed[:-1])) & sound
    starts = np.flatnonzero(pressed & ~np.append(False, pressed[:-1]))
    press = np.searchsorted(starts, np.arange(len(pressed)), side="right") - 1
    if not free.any() or not pressed.any():
        raise NotIdentifiable("there must be frames with a force, and frames with none.", rank=0, missing=("rest",))
    warms = warmer[free] - warmer[free].mean()  # the slope of readings at rest over the temperature
    thermal = np.tensordot(warms, raw[free], 1) / max(float(warms @ warms), 1e-300)
    raw = raw - thermal * warmer[:, None, None]
    late, raw = _late(time, raw, free)
    rest, noise = _rests(time, raw, free)
    moved: np.ndarray = np.abs(raw - rest).max(axis=(1, 2))
    _require_rest(moved, free, recording.source)
    drift = _drift(step, raw / noise, rest / noise, free)
    count, largest = len(starts), np.maximum.reduceat(size * pressed, starts)
    full = np.flatnonzero(pressed & (size >= FULL * largest[press]) & sound)
    order = np.arange(len(full)) - np.searchsorted(press[full], press[full])  # within its press
    many = np.bincount(press[full], minlength=count)[press[full]]
    used = full[order % np.maximum(many // EACH, 1) == 0]
    if count < FEWEST:
        few = f"{count} presses are too few (at least {FEWEST}): press more places, with shear in all directions."
        raise NotIdentifiable(few, rank=count, missing=("gains",))
    point, force = truth.point[row[used]], truth.force[row[used]]
    _require_places(body, point, guess.pitch, recording.source)
    offset, local = _local(body, point, force, guess.pitch)
    _require_forces(local, recording.source)
    known = {"thermal": thermal} if warmer.any() else {}
    guess = replace(guess, late=late, drift=drift, limits=limits, temperature=temperature, **known)
    rested = (raw - rest)[used], noise, offset, point, local, warmer[used], np.median(rest, axis=0)
    return Presses(body, guess, press[used], used, *rested)


def _warmth(recording: Recording) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return the mean temperature and by how much each frame is warmer; 0 where it does not change enough."""
    kelvin = recording.channels.get(TEMPERATURE, np.zeros((len(recording), 1)))[:, 0]
    if not np.nanmax(kelvin, initial=-np.inf) - np.nanmin(kelvin, initial=np.inf) >= WARMS:
        return 0.0, np.zeros(len(kelvin))
    usual = float(np.nanmean(kelvin))
    return usual, kelvin - usual


def _require_rest(moved: Float[np.ndarray, " n"], free: Bool[np.ndarray, " n"], source: str) -> None:
    """Require that readings, which have moved so far from their rest, do so only where a force is stated."""
    share = np.count_nonzero(moved[free] > MOVES * float(np.median(moved[~free]))) / np.count_nonzero(free)
    if share > OFTEN:
        hint = "State the force as it rises and falls, too, on the clock of the log."
        raise InputError(f"readings move in {share:.0%} of the frames without a true force.", where=source, hint=hint)


def _require_places(body: TaxelBody, point: Float[np.ndarray, "n 3"], pitch: float, source: str) -> None:
    """Require that the points lie on the skin."""
    away = float(np.median(np.linalg.norm(body.positions - point[:, None], axis=2).min(axis=1)))
    if away > BESIDE * pitch:
        hint = "State the points in m, in the surface's frame, which is that of the taxels."
        far = f"the true points lie {1e3 * away:.3g} mm from the nearest taxel (median)."
        raise InputError(far, where=source, hint=hint)


def _require_forces(force: Float[np.ndarray, "n 3"], source: str) -> None:
    """Require that the forces press, and have shear in all directions."""
    if np.mean(force[:, 2] > 0) < MOSTLY:
        hint = "State the force on the skin, in the surface's frame: change the sign of fx, fy, fz."
        raise InputError("most of the true forces pull at the skin.", where=source, hint=hint)
    sizes = np.linalg.svd(force, compute_uv=False)
    if sizes[-1] < SHEARED * sizes[0]:
        what = "the true forces have no shear in some direction: press sideways in all directions, too."
        raise NotIdentifiable(what, rank=int(np.count_nonzero(sizes >= SHEARED * sizes[0])), missing=("gains",))


def _limits(cells: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "2"]:
    """Return `TaxelResponse.limits`: extremes at which readings stand still, but do not rest; infinite: none."""
    rest, limits = np.median(cells, axis=0), np.array([-np.inf, np.inf])
    for which, end in enumerate((np.nanmin(cells), np.nanmax(cells))):
        still = np.sum((cells[1:] == end) & (cells[:-1] == end), axis=0) >= STANDS
        if np.count_nonzero(still) > 1 and np.all(rest != end):
            limits[which] = end
    return limits


def _late(
    time: Float[np.ndarray, " n"], raw: Float[np.ndarray, "n k 3"], free: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "n k 3"]]:
    """Return `TaxelResponse.late` by what remains after presses, and the readings without that."""
    rest, noise = _rests(time, raw, free)
    left, best = (raw - rest)[free] / noise, (np.inf, np.array([1.0, 0.0, 0.0]), raw)
    for span in LATER:
        slow = np.roll(_followed(raw - rest, float(np.median(np.diff(time))) / span), 1, axis=0)
        ways: np.ndarray = (slow - _rests(time, slow, free)[0])[free] / noise
        share = float(np.sum(ways * left) / (np.sum(ways**2) + 1e-300))
        square, off = ways**2 - np.mean(ways**2), (left - share * ways) ** 2
        varies = float(np.sum(square * off) / (np.sum(square**2) + 1e-300))  # how the squares that are left grow
        if float(np.mean(off)) < best[0]:
            best = float(np.mean(off)), np.array([span, share, sqrt(max(varies, 0.0))]), raw - share * slow
    return best[1:]


def _followed(values: np.ndarray, step: float) -> np.ndarray:
    """Return values (n, ...) followed exponentially from 0, in steps of a share of the time that it takes."""
    found, pace, now = np.empty_like(values), 1.0 - np.exp(-step), np.zeros(values.shape[1:])
    for i, value in enumerate(values):
        now = now + pace * (value - now)
        found[i] = now
    return found


def _drift(
    step: float, raw: Float[np.ndarray, "n k 3"], rest: Float[np.ndarray, "n k 3"], free: Bool[np.ndarray, " n"]
) -> float:
    """Return the time within which readings are followed to be next to the rest when a press begins; both by noise."""
    ends = np.flatnonzero(free & ~np.append(free[1:], False))
    moved, at, wanted = (raw - rest[0])[free], np.cumsum(free)[ends] - 1, rest[ends] - rest[0]
    off = [float(np.square(_followed(moved, step / span)[at] - wanted).mean()) for span in DRIFTS]
    return DRIFTS[int(np.argmin(off))]


def _rests(
    time: Float[np.ndarray, " n"], raw: Float[np.ndarray, "n k 3"], free: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n k 3"], Float[np.ndarray, "k 3"]]:
    """Return the rest of each reading, linear in time between the means of free stretches, and the noise."""
    starts = np.flatnonzero(free & ~np.append(False, free[:-1]))
    stretch = np.searchsorted(starts, np.arange(len(free)), side="right") - 1
    count = np.bincount(stretch[free], minlength=len(starts)).astype(float)
    when = np.bincount(stretch[free], time[free], len(starts)) / count
    rest, noise = np.empty_like(raw), np.empty(raw.shape[1:])
    for k in np.ndindex(raw.shape[1:]):
        level = np.bincount(stretch[free], raw[free, *k], len(starts)) / count
        rest[:, *k] = np.interp(time, when, level)
        noise[k] = np.std(np.diff(raw[:, *k])[free[1:] & free[:-1]]) / np.sqrt(2.0)
    steps = quantum(raw.reshape(len(raw), -1)).reshape(noise.shape)  # 0 where readings are continuous
    return rest, np.maximum(noise, np.maximum(ROUNDING * steps, 1e-9))


def _local(
    body: TaxelBody, point: Float[np.ndarray, "n 3"], force: Float[np.ndarray, "n 3"], pitch: float
) -> tuple[Float[np.ndarray, "n k 2"], Float[np.ndarray, "n 3"]]:
    """Return each taxel's offset [pitches] from points, and the forces along tangents and inwards there."""
    away, axes = body.positions - point[:, None], axes_at(body, point, pitch)
    flat = np.einsum("nac,nkc->nka", axes[:, :2], away)
    half = 0.5 * np.arccos(np.clip(-axes[:, 2] @ body.normals.T, -1.0, 1.0))
    arc = np.linalg.norm(away, axis=2) / np.sinc(half / np.pi)  # along an arc between both normals
    length = np.linalg.norm(flat, axis=2)
    scale = np.where(length > 0.0, arc / np.maximum(length, 1e-300), 0.0)
    return scale[..., None] * flat / pitch, np.einsum("nac,nc->na", axes, force)


def axes_at(body: TaxelBody, point: Float[np.ndarray, "n 3"], pitch: float) -> Float[np.ndarray, "n 3 3"]:
    """Return both tangents and the direction into the body at points, as rows."""
    near = np.exp(-0.5 * ((body.positions - point[:, None]) ** 2).sum(axis=2) / pitch**2) + 1e-300
    normal = near @ body.normals
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = near @ body.tangents
    along -= (along * normal).sum(axis=1, keepdims=True) * normal
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along), -normal], axis=1)
