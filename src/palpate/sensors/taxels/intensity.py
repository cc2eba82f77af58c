"""Convert a taxel's intensity to the force on it by calibrated curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value

KINDS = ("polynomial", "two_range", "monotone", "resistive")
_KNOTS = 2048  # of a curve as a table: linear between them, finer than 16 bits can tell


@frozen_value
class Curve:
    """Intensity above (or below) the unloaded one [counts] as a function of force [N], I = f(F) [skin map, 3.1].

    | kind | f(F) |
    |---|---|
    | `polynomial` | p1 F + p2 F^2 + ...: the paper's |
    | `two_range` | p1 F + p2 F^2 below the force `joint`, and above it a line of slope p3 |
    | `monotone` | linear between the `knots` of force, where it is p1, p2, ... |
    | `resistive` | s R / (2 p1 / F + p2): an ADC of full `scale` s on a divider with a `reference` R; 2 p1/F is the \
    resistance of the sensor's two contacts, p2 the one in series with them |

    Args:
        kind: one of `KINDS`.
        parameters: (p,).
        covariance: (p, p) of the parameters.
        largest: [N] up to which the curve was measured.
        saturation: raw intensity at the end of the sensor's range; NaN: not known.
        falling: the raw reading falls as the force grows.
        joint: [N] of `two_range`; knots: [N] of `monotone`; reference, scale: of `resistive`.
        residual: rms residual of the fit [counts].
        hysteresis: largest difference between loading and unloading at one force, as a share of the span; NaN: not
            known.

    Raises:
        InputError: an unknown kind, a largest force that is not positive, or a curve that does not rise with force.
    """

    kind: str
    parameters: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    largest: float
    saturation: float = float("nan")
    falling: bool = False
    joint: float = 0.0
    knots: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    reference: float = 0.0
    scale: float = 0.0
    residual: float = 0.0
    hysteresis: float = float("nan")

    def __post_init__(self) -> None:
        for name in ("parameters", "covariance", "knots"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.kind not in KINDS:
            raise InputError(
                f"kind of a curve must be one of {', '.join(KINDS)}, not {self.kind!r}.", where="intensity"
            )
        if not self.largest > 0:
            raise InputError(f"largest force must be positive, not {self.largest:g} N.", where="intensity")
        forces = np.linspace(0.0, self.largest, 257)
        with np.errstate(all="ignore"):  # numbers of nonsense: such a curve does not rise
            steps = np.diff(self.intensity(forces))
        if not np.all(steps > 0):
            place = forces[int(np.argmin(np.where(np.isfinite(steps), steps, -np.inf)))]
            raise InputError(
                f"the {self.kind} curve does not rise at {place:.3g} N, so a reading there determines no force.",
                where="intensity",
                hint="Use a lower degree, kind 'monotone', or more presses around that force.",
            )

    @property
    def name(self) -> str:
        """Return the kind of the curve, with the degree of a polynomial."""
        return f"polynomial of degree {len(self.parameters)}" if self.kind == "polynomial" else self.kind

    def intensity(self, force: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the counts above the unloaded reading, positive under load, for forces [N], of the same shape.

        Below 0 N the curve continues with its first slope, beyond the largest measured force with its last.

        Raises:
            InputError: force has another shape.
        """
        step = np.array([1e-6 * self.largest])
        first_slope = float(self._rising(self.parameters, step)[0] / step[0])
        return self._rising(self.parameters, np.maximum(force, 0.0)) + np.minimum(force, 0.0) * first_slope

    def force(self, intensity: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the forces [N] for counts above the unloaded reading, of the same shape; end slopes continue.

        Raises:
            InputError: intensity has another shape.
        """
        counts, forces = self.table()
        found = np.interp(intensity, counts, forces)
        last = (forces[-1] - forces[-2]) / (counts[-1] - counts[-2])
        found = found + np.maximum(intensity - counts[-1], 0.0) * last
        return found + np.minimum(intensity, 0.0) * (forces[1] - forces[0]) / (counts[1] - counts[0])

    def table(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Return counts (2048,), evenly spaced from 0 to those of the largest force, and the force [N] at each."""
        grid = self.largest * np.linspace(0.0, 1.0, _KNOTS) ** 2  # denser where the curve may be steep
        counts = self.intensity(grid)
        even: Float[np.ndarray, " k"] = np.linspace(0.0, float(counts[-1]), _KNOTS)
        return even, np.interp(even, counts, grid)

    def deviation(self, force: Float[np.ndarray, "*batch"], noise: float = 0.0) -> Float[np.ndarray, "*batch"]:
        """Return the standard deviation [N] of each force [N] found from an intensity with a noise [counts].

        Var F = (J C J^T + noise^2) / f'(F)^2, J = df/dp.

        Raises:
            InputError: force has another shape.
        """
        jacobian = self.jacobian(force)
        variance = np.einsum("...i,ij,...j->...", jacobian, self.covariance, jacobian) + noise**2
        return np.sqrt(np.maximum(variance, 0.0)) / self.slope(force)

    def jacobian(self, force: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch p"]:
        """Return the derivatives of the intensity [counts] by the parameters, (..., p), at forces (...) [N].

        Raises:
            InputError: force has another shape.
        """
        pushed, values = np.maximum(force, 0.0), self.parameters
        steps = np.maximum(np.abs(values), 1e-9) * 1e-6
        columns = [
            (self._rising(values + step, pushed) - self._rising(values - step, pushed)) / (2 * step[k])
            for k, step in enumerate(np.diag(steps))
        ]
        return np.stack(columns, axis=-1)

    def slope(self, force: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the slope of the curve [counts/N] at forces [N], of the same shape.

        Raises:
            InputError: force has another shape.
        """
        step = 1e-6 * self.largest
        return (self.intensity(force + step) - self.intensity(force - step)) / (2 * step)

    def _rising(self, parameters: Float[np.ndarray, " p"], force: np.ndarray) -> np.ndarray:
        """Return f(F) [counts] for F >= 0 with these parameters, linear beyond the largest force."""
        largest, step = self.largest, 1e-6 * self.largest
        last, before = self._measured(parameters, np.array([largest, largest - step])).tolist()
        beyond = np.maximum(force - largest, 0.0) * (last - before) / step
        return self._measured(parameters, np.minimum(force, largest)) + beyond

    def _measured(self, parameters: Float[np.ndarray, " p"], force: np.ndarray) -> np.ndarray:
        if self.kind == "polynomial":
            return force * np.polynomial.polynomial.polyval(force, parameters)
        if self.kind == "two_range":
            low = np.minimum(force, self.joint)
            return parameters[0] * low + parameters[1] * low**2 + parameters[2] * (force - low)
        if self.kind == "monotone":
            return np.interp(force, np.append(0.0, self.knots), np.append(0.0, parameters))
        return self.scale * self.reference * force / (2.0 * parameters[0] + parameters[1] * force)


@frozen_value
class Intensity(Value):
    """The curves of all cells of a skin.

    Args:
        curves: one for all cells, or several.
        which: (rows, columns) or (k,), the index of each cell's curve; None: the first for all.
        unit: of an intensity, in messages.
        provenance: origin of the calibration.
        notes: notes for the user, one sentence each.

    Raises:
        InputError: no curve, `which` of another shape or with an index of no curve, or curves of which some fall.
    """

    curves: tuple[Curve, ...]
    which: Int[np.ndarray, "rows columns"] | Int[np.ndarray, " k"] | None = None
    unit: str = "counts"
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        if not self.curves:
            raise InputError("at least one curve is needed.", where="intensity")
        if self.which is not None:
            which = np.array(self.which, dtype=np.int64)
            if which.ndim not in (1, 2) or which.min() < 0 or which.max() >= len(self.curves):
                raise InputError(
                    f"`which` must give each cell the number of a curve, from 0 to {len(self.curves) - 1}.",
                    where="intensity",
                )
            which.flags.writeable = False
            object.__setattr__(self, "which", which)
        if len({curve.falling for curve in self.curves}) > 1:
            raise InputError("all curves must rise with force, or all fall.", where="intensity")

    def numbers(self, shape: tuple[int, ...]) -> Int[np.ndarray, " k"]:
        """Return the index of each cell's curve, (k,), for a frame of `shape` (rows, columns) or (k,).

        Raises:
            InputError: the curves were calibrated for another shape.
        """
        count = int(np.prod(shape))
        if self.which is None:
            return np.zeros(count, dtype=np.int64)
        if self.which.shape not in (shape, (count,)):
            here, there = (" x ".join(map(str, size)) for size in (shape, self.which.shape))
            raise InputError(f"the model was calibrated for {there} cells, not {here}.", where="intensity")
        return self.which.ravel().copy()

    def tables(self) -> tuple[Float[np.ndarray, "c k"], Float[np.ndarray, " c"]]:
        """Return the force [N] of each curve at evenly spaced counts from 0, (c, 2048), and the step in counts (c,)."""
        tables = [curve.table() for curve in self.curves]
        return np.stack([forces for _, forces in tables]), np.array([counts[1] for counts, _ in tables])


def load_direction(intensity: Intensity | None, falling: bool | None) -> bool | None:
    """Return whether readings fall under load, as stated or by the curves; None: neither says.

    Raises:
        InputError: the curves contradict what is stated.
    """
    known = None if intensity is None else intensity.curves[0].falling
    if known is not None and falling is not None and known != falling:
        raise InputError(
            f"falling = {str(falling).lower()} contradicts the curves, which {'fall' if known else 'rise'} under load.",
            where="skin.falling",
            hint="Leave it out, or name the curves of this skin.",
        )
    return falling if known is None else known
