"""Fit curves from intensity to force to presses that a load cell measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.curve_kinds import FEWEST, chosen
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.spatial.arguments import takes_arrays

BLOCKS = 20  # of rows, assigned in turn to the parts of a cross-validation
STRETCHES = 10  # of consecutive rows, each left out in turn
LEVELS = 3  # forces below saturation that determine a curve, with that of no load
_TURNS = 3  # of the common curve and the gains
_NOISY = 0.5  # of what the force does to the reading: a residual beyond it
_FLAT = 0.1  # of the slope below it: a curve that rises less to its end saturates


def _identified(
    force: Float[np.ndarray, " n"], intensity: Float[np.ndarray, " n"], kind: str, degree: int | None, top: float | None
) -> tuple[Curve, str, Validation]:
    """Return the least-squares curve, the reason if it is a straight line by choice, and its cross-validation."""
    force, intensity, dropped = _sound(force, intensity)
    _require_spread(force, dropped)
    if not np.ptp(intensity) > 0:
        raise _no_curve("the reading never changes: check that it is that of the pressed cell.", 0)
    falling = bool(np.corrcoef(force, intensity)[0, 1] < 0)
    signed = -intensity if falling else intensity
    limit = _limit(force, signed, None if top is None else _end_of_range(top, falling))
    below = signed < limit
    _require_spread(force[below], dropped)
    _require_forces(force, below)
    end, reading = _goes_flat(force[below], signed[below])
    limit, below = min(limit, reading), below & (force <= end)
    curve, why = chosen(kind, degree, force[below], signed[below])
    _require_signal(curve)
    saturation = float("nan") if np.isinf(limit) else (0.0 - limit if falling else limit)
    hysteresis = _hysteresis(curve, force[below], signed[below])
    left = _left_out(curve, force[below], signed[below])
    covariance = left.widening * curve.covariance
    found = replace(curve, covariance=covariance, saturation=saturation, falling=falling, hysteresis=hysteresis)
    return found, why, left


def _left_out(curve: Curve, force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"]) -> Validation:
    """Compare unseen presses with a curve that is fitted to the others; return the worse of two cross-validations.

    One compares all parameters over interleaved blocks, the other the gain over consecutive ones, which shows a drift
    that most parameters, the bends, do not feel. The zero cancels: slopes are taken about their mean.
    """
    degree, rounding = len(curve.parameters) if curve.kind == "polynomial" else None, 1e-6 * float(np.ptp(signed))

    def predict(left: Bool[np.ndarray, " n"], gain: bool) -> tuple[np.ndarray, np.ndarray]:
        rest = chosen(curve.kind, degree, force[~left], signed[~left])[0]
        seen = left & (force <= rest.largest)  # beyond it no curve is valid
        slopes = rest.jacobian(force[seen])
        ways = slopes - slopes.sum(axis=0) / max(len(slopes), 1)
        ways = ways @ rest.parameters[:, None] if gain else ways
        across = ways.T @ slopes
        spread = (curve.residual**2 + rounding**2) * (ways.T @ ways) + across @ rest.covariance @ across.T
        return ways.T @ (signed[seen] - rest.intensity(force[seen])), spread

    both = (
        cross_validate(len(force), partial(predict, gain=False), blocks=BLOCKS),
        cross_validate(len(force), partial(predict, gain=True), STRETCHES),
    )
    return max(both, key=lambda found: found.widening)


@takes_arrays
def tells(curve: Curve, force: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return bools (n,), whether one reading determines each force [N] better than `curve.largest` / sqrt(12).

    Raises:
        InputError: force has another shape.
    """
    return curve.deviation(force, curve.residual) < curve.largest / np.sqrt(12.0)


def _goes_flat(force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the force [N] above which a taxel saturates, and the reading that 98 % there exceed; inf if none does."""
    end = limit = np.inf
    for _ in range(4):
        below = force <= end
        curve = chosen("monotone", None, force[below], signed[below])[0]
        last = _end(curve)
        if not last < curve.largest or np.count_nonzero(force <= last) < FEWEST:
            break
        _require_forces(force, force <= last)
        end, limit = last, float(np.quantile(signed[force > last], 0.02))
    return end, limit


def _end(curve: Curve) -> float:
    """Return the force [N] above which no reading determines it and the curve hardly rises; else the largest force."""
    forces = curve.largest * np.arange(1, 257) / 256.0
    known = np.flatnonzero(tells(curve, forces))
    last = float(forces[known[-1]]) if len(known) else curve.largest
    if not last < curve.largest:
        return curve.largest
    low, high = curve.intensity(np.array([last, curve.largest])).tolist()
    flat = (high - low) / (curve.largest - last) < _FLAT * low / last
    return last if flat else curve.largest


@takes_arrays
def identify_intensity(
    force: Float[np.ndarray, " n"],
    intensity: Float[np.ndarray, " n"],
    cell: Int[np.ndarray, "n 2"] | None = None,
    *,
    shape: tuple[int, int] | None = None,
    kind: str = "auto",
    degree: int | None = None,
    top: float | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Intensity:
    """Return the `Intensity` of a sheet, I = I0_k + g_k f(F) for cell k: one curve f, and a gain g_k for each cell.

    The unloaded readings I0_k are fitted but not returned. Rows that are not finite, at the end of the sensor's range,
    or beyond the force at which the curve goes flat are excluded. Forty presses a cell are enough.

    Args:
        force: (n,) [N], not negative.
        intensity: (n,) raw.
        cell: (n, 2) row and column of the pressed cell; None: one curve for all cells.
        shape: rows and columns of the sheet; None: up to the largest that were pressed.
        kind: of `Curve` but "resistive", or "auto": the one that predicts unseen presses best.
        degree: of a polynomial; None: the best of 1 to 5.
        top: largest raw reading of the range, whose other end is 0; None: found where readings stop rising.
        provenance: origin of the log.

    Raises:
        NotIdentifiable: too few rows, forces that hardly differ, or readings that never change.
        InputError: negative forces, an unknown kind, a fit that does not rise with force, or a pressed cell that is not
            on the sheet.
    """
    if cell is None:
        common, why, left = _identified(force, intensity, kind, degree, top)
        record = {"left_out": str(left), **(provenance or {})}
        return Intensity((common,), provenance=record, notes=(*_remarks(common, why), *left.notes))
    rows, columns = shape or tuple(int(last) + 1 for last in cell.max(axis=0))
    pressed, number = np.unique(cell, axis=0, return_inverse=True)
    outside = ((pressed < 0) | (pressed >= [rows, columns])).any(axis=1)
    if outside.any():
        named = tuple(pressed[outside][0].tolist())
        raise InputError(f"a press names cell {named}, not on the sheet of {rows} x {columns}.", where="intensity")
    which, presses = np.zeros((rows, columns), np.int64), _Presses.of(force, intensity, number.ravel(), top)
    common, why, left, zero, gain, error = _in_turns(presses, len(pressed), kind, degree)
    gained = gain > 0
    ends = presses.ends(common, np.append(zero[gained].mean(), zero), np.append(1.0, gain))
    common, own = replace(common, saturation=float(ends[0])), np.column_stack([gain, error, ends[1:]])[gained]
    curves, notes = [scaled(common, *each) for each in own.tolist()], _remarks(common, why)
    which[tuple(pressed[gained].T)] = 1 + np.arange(len(curves))
    if len(curves) < which.size:
        without = f"{which.size - len(curves)} of {which.size} cells"
        notes.append(f"{without} have no gain of their own: they were pressed too few times")
    notes.append(f"gains of cells differ by {100 * float(np.std(gain[gained])):.1f} %")
    record = {"left_out": str(left), **(provenance or {})}
    return Intensity((common, *curves), which, provenance=record, notes=(*notes, *left.notes))


@dataclass(frozen=True)
class _Presses:
    """Sound rows of presses: force [N], intensity, cell's number; whether loads lower readings, and the range's end."""

    force: np.ndarray
    intensity: np.ndarray
    number: np.ndarray
    sign: float
    limit: float

    @classmethod
    def of(cls, force: np.ndarray, intensity: np.ndarray, number: np.ndarray, top: float | None) -> _Presses:
        known, (force, intensity, dropped) = np.isfinite(force) & np.isfinite(intensity), _sound(force, intensity)
        _require_spread(force, dropped)
        falling = bool(np.ptp(intensity) > 0 and np.corrcoef(force, intensity)[0, 1] < 0)
        sign = -1.0 if falling else 1.0
        limit = _limit(force, sign * intensity, None if top is None else _end_of_range(top, falling))
        below = sign * intensity < limit
        return cls(force[below], intensity[below], number[known][below], sign, limit)

    def gains(self, x: np.ndarray, count: int, largest: float = np.inf) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fit a line in x to each cell up to a force; return zero, gain (0: not known) and the gain's deviation."""
        zero, gain, error = np.zeros(count), np.zeros(count), np.zeros(count)
        for k in range(count):
            mine = (self.number == k) & (self.force <= largest)
            if np.count_nonzero(mine) < 4 or not np.ptp(x[mine]) > 0:
                continue
            y, centred = self.intensity[mine], x[mine] - x[mine].mean()
            square = float(centred @ centred)
            slope = float(centred @ y) / square
            left = y - y.mean() - slope * centred
            if slope > 0:
                zero[k], gain[k] = y.mean() - slope * x[mine].mean(), slope
                error[k] = np.sqrt(float(left @ left) / max(np.count_nonzero(mine) - 2, 1) / square)
        return zero, gain, error

    def common(
        self, zero: np.ndarray, gain: np.ndarray, kind: str, degree: int | None
    ) -> tuple[Curve, str, Validation]:
        """Fit the curve that all cells have, as `_identified` does, to readings over their gains."""
        own = (gain > 0)[self.number]
        mine = self.number[own]
        return _identified(self.force[own], (self.intensity[own] - zero[mine]) / gain[mine], kind, degree, np.inf)

    def ends(self, common: Curve, zero: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Return the readings at which cells saturate, at the end of the range or of the curve; NaN: not known."""
        end = np.fmin(self.limit, self.sign * (zero + gain * common.saturation))
        return np.where(np.isfinite(end), self.sign * end, np.nan)


def _in_turns(
    presses: _Presses, count: int, kind: str, degree: int | None
) -> tuple[Curve, str, Validation, np.ndarray, np.ndarray, np.ndarray]:
    """Return the common curve, its remark and validation, and each cell's zero, gain and deviation of the gain.

    Curve and gains are fitted in turns, from gains of straight lines on. A curve goes flat where readings over their
    gains do: raw ones of unequal cells scatter so much that they look as if they went flat.
    """
    zero, gain, error = presses.gains(presses.sign * presses.force, count)
    if not (gain > 0).any():
        gain[:] = 1.0
    common, why, left = presses.common(zero, gain / gain[gain > 0].mean(), kind, degree)
    for _ in range(_TURNS):
        zero, gain, error = presses.gains(presses.sign * common.intensity(presses.force), count, common.largest)
        terms = len(common.parameters) if common.kind == "polynomial" else None
        common, _, left = presses.common(zero, gain, common.kind, terms)
    return common, why, left, zero, gain, error


def scaled(curve: Curve, gain: float, error: float, saturation: float) -> Curve:
    """Return the curve of a cell whose gain is known with a standard deviation of `error`."""
    values = curve.parameters
    covariance = gain**2 * curve.covariance + error**2 * np.outer(values, values)
    return replace(curve, parameters=gain * values, covariance=covariance, saturation=saturation)


@takes_arrays
def identify_resistive(
    force: Float[np.ndarray, " n"],
    reading: Float[np.ndarray, " n"],
    *,
    scale: float,
    reference: Float[np.ndarray, " n"],
    layer: Int[np.ndarray, " n"],
    floor: float = 0.0,
) -> tuple[Curve, ...]:
    """Fit resistive taxels: reading = max(floor, s (1 - R / (2 S / F + R_i))), S common, R_i of each layer.

    Rows that are not finite are left out.

    Args:
        force: (n,) [N].
        reading: (n,) of the ADC, falling with force.
        scale: s, the reading without load.
        reference: (n,) R of the divider, in any unit of resistance, also that of S/F and R_i.
        layer: (n,) index of each row's layer, from 0.
        floor: the lowest reading.

    Returns:
        One `Curve` for each layer, with parameters (S, R_i) and their covariance.

    Raises:
        NotIdentifiable: too few rows, or forces that hardly differ.
        InputError: a layer whose curve does not rise with force; or arrays of other shapes.
    """
    from scipy.optimize import least_squares

    known = np.isfinite(force) & np.isfinite(reading) & np.isfinite(reference)
    force, reading, reference, layer = force[known], reading[known], reference[known], layer[known]
    _require_spread(force, 0)
    count = int(layer.max()) + 1
    pushed = np.maximum(force, 0.0)

    def model(values: np.ndarray) -> np.ndarray:
        return np.maximum(floor, scale * (1 - reference * pushed / (2 * values[0] + values[1:][layer] * pushed)))

    half = float(np.median(pushed[pushed > 0] * reference[pushed > 0]))
    start = np.concatenate([[half], np.full(count, float(np.median(reference)))])
    found = least_squares(lambda values: model(values) - reading, start, bounds=(1e-12, np.inf), x_scale=start)
    freedom = max(len(force) - count - 1, 1)
    variance = float(np.sum(found.fun**2)) / freedom
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance: Float[np.ndarray, "p p"] = variance * np.linalg.pinv(jacobian.T @ jacobian)
    curves: list[Curve] = []
    for k in range(count):
        mine, pair = layer == k, [0, k + 1]
        told = mine & (reading > floor)
        curves.append(
            Curve(
                "resistive",
                found.x[pair],
                covariance[np.ix_(pair, pair)],
                largest=float(pushed[told if told.any() else mine].max()),
                saturation=floor,
                falling=True,
                reference=float(reference[mine][0]),
                scale=scale,
                residual=float(np.sqrt(np.mean(found.fun[mine] ** 2))),
            )
        )
    return tuple(curves)


def _sound(force: np.ndarray, intensity: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the finite rows and the number of the others; raise an InputError if forces are negative."""
    known = np.isfinite(force) & np.isfinite(intensity)
    if known.any() and float(force[known].min()) < -0.05 * float(np.ptp(force[known])):
        raise InputError(
            "some forces are negative: the load cell pulls, or was not tared.",
            hint="Give forces that grow as the taxel is pressed, zero without load.",
        )
    return np.maximum(force[known], 0.0), intensity[known], int(np.count_nonzero(~known))


def _require_spread(force: np.ndarray, dropped: int) -> None:
    if len(force) < FEWEST:
        without = f"; {dropped} rows had no number" if dropped else ""
        few = f"{len(force)} rows are too few for a curve (at least {FEWEST}{without}): press with more forces."
        raise _no_curve(few, len(force))
    if not np.ptp(force) > 1e-6 * max(float(np.abs(force).max()), 1e-12):
        raise _no_curve(f"all presses have the same force ({force[0]:.3g} N): a curve needs several forces.", 1)


def _require_forces(force: np.ndarray, below: Bool[np.ndarray, " n"]) -> None:
    """Check that several of the forces are below saturation."""
    levels, known = np.unique(force), len(np.unique(force[below]))
    if known < min(LEVELS, len(levels)):
        raise _no_curve(
            f"the reading does not rise above {levels[known - 1]:.3g} N, and only {known} of {len(levels)} forces are "
            "that light: they do not show how it rises, or where it saturates. Press with several lighter forces.",
            known,
        )


def _require_signal(curve: Curve) -> None:
    span = float(curve.intensity(np.array([curve.largest]))[0])
    if curve.residual > _NOISY * span:
        raise _no_curve(
            f"the residual, {curve.residual:.3g} counts rms, is as large as what the force does, {span:.3g} counts: "
            "check that the reading is that of the pressed cell, and that reading and force have one clock.",
            0,
        )


def _end_of_range(top: float, falling: bool) -> float:
    """Return the end that a load drives readings to, as a number that grows with the force."""
    return top if not falling else np.inf if np.isinf(top) else 0.0


def _no_curve(why: str, rank: int) -> NotIdentifiable:
    return NotIdentifiable(why, rank=rank, missing=("curve",))


def _limit(force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"], stated: float | None) -> float:
    """Return the end of the range: as stated, or the highest reading, if it stays over a tenth of the forces."""
    if stated is not None:
        return stated
    top = signed.max()
    at_top: Bool[np.ndarray, " n"] = signed >= top
    if np.count_nonzero(at_top) >= 5 and np.ptp(force[at_top]) > 0.1 * np.ptp(force):
        return float(top)
    return np.inf


def _hysteresis(curve: Curve, force: np.ndarray, signed: np.ndarray) -> float:
    """Return the largest difference between loading and unloading, over the span; NaN: not known."""
    span = float(np.ptp(signed))
    trend = np.sign(np.convolve(np.gradient(force), np.ones(5) / 5, mode="same"))
    left = signed - curve.intensity(force)
    edges = np.linspace(0.0, float(force.max()), 9)
    found: list[float] = []
    for low, high in pairwise(edges.tolist()):
        inside = (force > low) & (force <= high)
        up, down = inside & (trend > 0), inside & (trend < 0)
        if np.count_nonzero(up) >= 3 and np.count_nonzero(down) >= 3:
            found.append(abs(float(np.mean(left[down]) - np.mean(left[up]))))
    return max(found) / span if found and span > 0 else float("nan")


def _remarks(curve: Curve, why: str) -> list[str]:
    said = [why] if why else []
    if curve.falling:
        said.append("the reading falls as the force grows")
    if np.isfinite(curve.saturation):
        said.append(f"readings do not go beyond {curve.saturation:g}: readings there are saturated")
    if np.isfinite(curve.hysteresis):
        said.append(f"loading and unloading differ by up to {100 * curve.hysteresis:.1f} % of the span")
    return said
