"""Identify the drift of a sensor's bias, from a log without contact: random walk, warm-up, temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.drift_windows import GAP, SHORTEST, windows_of
from palpate.calibration.validation import Validation
from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.noise import resolution_of
from palpate.spatial._arrays import Value
from palpate.spatial.arguments import frozen_value, takes_arrays

if TYPE_CHECKING:
    from palpate.calibration.drift_search import Search

USUAL = 240.0  # s: a shorter log is used, and it is said how little it tells
LEAST_TILT = 0.02  # rad, rms: a weight off by 0.1 N is 2 mN off then
UNLIKE = 9.0  # of the squared distance of the halves' walks over what is expected: they are not alike
LEAST_KELVIN = 0.1  # K: less change of temperature tells nothing


@frozen_value
class DriftFit(Value):
    """The drift of a bias as identified from a log.

    Attributes:
        drift: drift for an estimator.
        walk_deviation: (m,) standard deviation of `drift.walk`.
        warm_up_deviation: (m,) standard deviation of `rate`.
        rate: (m,) [unit/s] of the warm-up as this log begins.
        warm: True if there is a significant warm-up; else `drift.warm_up` is what the log does not exclude.
        seen: (m,) True where the walk is significant; else `drift.walk` is its upper bound (95 %).
        noise: (m,) standard deviation of the mean over a window.
        window: [s].
        samples: number used.
        seconds: [s] of the log.
        touched: share of the log omitted as touched.
        validation: agreement of the walks of both halves of the log.
        notes: a sentence each.
    """

    drift: Drift
    walk_deviation: Float[np.ndarray, " m"]
    warm_up_deviation: Float[np.ndarray, " m"]
    rate: Float[np.ndarray, " m"]
    warm: bool
    seen: Bool[np.ndarray, " m"]
    noise: Float[np.ndarray, " m"]
    window: float
    samples: int
    seconds: float
    touched: float
    validation: Validation = field(default_factory=Validation)
    notes: tuple[str, ...] = ()

    def unsure(self, seconds: float) -> Float[np.ndarray, " m"]:
        """Return the standard deviation (m,) of the bias, in the channels' units, `seconds` [s] after a touch began.

        The variance is walk sqrt(window) noise when the touch begins, the filter having settled, plus walk^2 t, plus
        (t times the rate's standard deviation in this log)^2.
        """
        walk = self.drift.walk
        start = walk * np.sqrt(self.window) * self.noise
        return np.sqrt(start + walk**2 * seconds + (self.warm_up_deviation * seconds) ** 2)

    def spread(self, sound: Bool[np.ndarray, " k"]) -> DriftFit:
        """Return this `DriftFit` expanded to k channels.

        Args:
            sound: (k,) True for a channel that was fitted; the others get the root mean square of the fitted values.

        Raises:
            InputError: `sound` has another shape, or another number of True than channels were fitted.
        """

        def filled(values: np.ndarray) -> np.ndarray:
            made = np.full(len(sound), np.sqrt(np.mean(np.square(values)))).astype(values.dtype)
            made[sound] = values
            return made

        of_drift = ("walk", "warm_up", "thermal", "thermal_deviation")
        drift = replace(self.drift, **{name: filled(getattr(self.drift, name)) for name in of_drift})
        names = ("walk_deviation", "warm_up_deviation", "rate", "seen", "noise")
        return replace(self, drift=drift, **{name: filled(getattr(self, name)) for name in names})


@takes_arrays
def identify_drift(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, "n m"],
    noise: Float[np.ndarray, "..."] | None = None,
    temperature: Float[np.ndarray, " n"] | None = None,
    down: Float[np.ndarray, "n 3"] | None = None,
    *,
    groups: Sequence[Sequence[int]] | None = None,
    names: Sequence[str] = (),
    window: float = 0.1,
) -> DriftFit:
    """Identify the most likely random walk, warm-up and thermal coefficient of a bias; return a `DriftFit`.

    The likelihood is that of a Kalman filter without knowledge of the bias at the start; where residuals are not
    white, windows become longer. Warm-up r s (1 - exp(-t/s)), temperature and errors that turn with gravity are found
    by generalised least squares. A temperature that changes as steadily as a warm-up is counted as warm-up.

    Args:
        time: (n,) [s].
        values: (n, m) readings after gravity compensation, or voltages; NaN where there is none.
        noise: (m,) standard deviations or (m, m) covariance of one reading, for comparison; None: not stated.
        temperature: (n,) [K or degrees C]; None or NaN: not known.
        down: (n, 3) direction of gravity in the sensor's frame; None or NaN: not known, or the sensor keeps still.
        groups: channels that are alike, such as the forces; None: three and three of six, else all.
        names: names of the channels, for messages.
        window: [s] over which readings are averaged.

    Raises:
        InputError: the log is shorter than a minute, touched or moved too much, a channel never changes, or times run
            backwards; or arrays of other shapes.
    """
    from palpate.calibration.drift_search import Search  # scipy.optimize: loaded when first needed

    channels = values.shape[1]
    alike = ([0, 1, 2], [3, 4, 5]) if groups is None and channels == 6 else groups or [list(range(channels))]
    names = tuple(names) or tuple(f"channel {k + 1}" for k in range(channels))
    used, notes = _usable(time, values)
    when, what = time[used], values[used]
    notes += _require_changing(what, names)
    kelvin, said = _temperature(temperature, used)
    notes += said
    others = _tilts(down, used)
    courses = others if kelvin is None else np.column_stack([kelvin, others])
    windows = windows_of(when, what, courses, window)
    least = resolution_of(what) ** 2 / 12.0
    found = Search(windows, [list(group) for group in alike], least).run()
    if kelvin is not None and not found.distinct(0):
        kelvin = None
        notes.append(
            "the temperature changes as steadily as in a warm-up, so its effect on the zero is counted as warm-up: "
            "record a log in which it rises and falls to separate the two"
        )
        found = Search(windows_of(when, what, others, window), [list(group) for group in alike], least).run()
    notes += found.notes(noise, float(np.median(np.diff(when))), names)
    left, larger = found.compare_halves()
    made = _made(found, alike, len(what), kelvin=kelvin is not None)
    if left.widening > UNLIKE:
        notes.append("the zero walks more in one half of the log than in the other: the larger walk is written")
        made = replace(made, drift=replace(made.drift, walk=np.maximum(made.drift.walk, larger)))
    deviation = made.walk_deviation * left.widening**0.5
    return replace(made, walk_deviation=deviation, validation=left, notes=tuple(notes))


def _usable(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n m"]
) -> tuple[Bool[np.ndarray, " n"], list[str]]:
    """Return the mask (n,) of rows with a time and all values, and notes."""
    known = np.isfinite(time) & np.isfinite(values).all(axis=1)
    when, notes = time[known], list[str]()
    if len(when) < 2 or not (span := float(when[-1] - when[0])) >= SHORTEST:
        lasts = f"{max(0.0, float(when[-1] - when[0])):.3g} s" if len(when) > 1 else "no time"
        raise InputError(
            f"the usable part of the log lasts {lasts}, and at least {SHORTEST:g} s are needed to find the drift.",
            hint="Record the sensor at rest and untouched for five minutes.",
        )
    steps = np.diff(when)
    if np.any(steps < 0):
        raise InputError(
            "times run backwards: the log starts again, or its rows are out of order.",
            hint="Split the log where it starts again, or sort its rows by time.",
        )
    if (missing := len(time) - len(when)) > 0:
        notes.append(f"{missing:,} of {len(time):,} samples have no value or no time and were left out")
    gaps = steps[steps > GAP]
    if len(gaps):
        notes.append(
            f"the log has {len(gaps)} gaps of up to {gaps.max():.4g} s: changes of the zero in them were left out"
        )
    if span - float(gaps.sum()) < SHORTEST:
        raise InputError(f"without its gaps the log lasts {span - gaps.sum():.3g} s, and {SHORTEST:g} s are needed.")
    if span < USUAL:
        notes.append(f"the log lasts only {span:.0f} s: record five minutes or more to know the walk better")
    return known, notes


def _require_changing(values: Float[np.ndarray, "n m"], names: Sequence[str]) -> list[str]:
    """Refuse a channel that never changes; return notes on readings that are too coarse."""
    same = np.ptp(values, axis=0) == 0.0
    if same.any():
        stuck = ", ".join(name for name, one in zip(names, same, strict=True) if one)
        raise InputError(
            f"{stuck} never changes: it is not connected, or its driver sets small readings to zero.",
            hint="Connect it, or switch off the dead band or the tare, which hide how the bias drifts.",
        )
    step, spread = resolution_of(values), np.median(np.abs(np.diff(values, axis=0)), axis=0)
    coarse = [name for name, one, size in zip(names, step, spread, strict=True) if one > 0.0 and size == 0.0]
    if not coarse:
        return []
    return [
        f"readings of {', '.join(coarse)} are so coarse that they mostly repeat: a walk smaller than one step of them "
        "is not seen"
    ]


def _temperature(
    temperature: Float[np.ndarray, " n"] | None, used: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"] | None, list[str]]:
    """Return the temperature of the used rows, None if it tells nothing, and notes."""
    if temperature is None:
        return None, []
    known = temperature[used]
    finite = known[np.isfinite(known)]
    if not len(finite):
        return None, ["the log's temperature has no values: its effect on the zero is not known"]
    if (change := float(np.ptp(finite))) < LEAST_KELVIN:
        return None, [f"the temperature changes by only {change:.2g} K: its effect on the zero is not known"]
    return known, []


def _tilts(down: Float[np.ndarray, "n 3"] | None, used: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "k q"]:
    """Return gravity along the axes about which the sensor turns, for the used rows."""
    turned = np.full((int(np.count_nonzero(used)), 3), np.nan) if down is None else down[used]
    known = np.isfinite(turned).all(axis=1)
    if not known.any():
        return turned[:, :0]
    middle: Float[np.ndarray, "3"] = turned[known].mean(axis=0)
    turned = turned - middle
    spread, axes = np.linalg.eigh(turned[known].T @ turned[known] / int(np.count_nonzero(known)))
    return turned @ axes[:, spread > LEAST_TILT**2]


def _made(found: Search, groups: Sequence[Sequence[int]], samples: int, *, kelvin: bool) -> DriftFit:
    """Convert the result of the search to a `DriftFit`."""
    best = found.found
    warm_up: Float[np.ndarray, " m"] = np.sqrt(found.rate**2 + found.rate_deviation**2)
    for group in groups:
        warm_up[list(group)] = np.sqrt(np.mean(warm_up[list(group)] ** 2))
    drift = Drift(
        best.walk,
        warm_up,
        found.settling,
        thermal=best.course[0] if kelvin else None,
        thermal_deviation=np.sqrt(best.covariance[:, 0, 0]) if kelvin else None,
    )
    return DriftFit(
        drift,
        best.deviation,
        found.rate_deviation,
        found.rate,
        found.warm,
        best.seen,
        best.noise,
        found.windows.length,
        samples,
        found.span,
        found.share,
    )
