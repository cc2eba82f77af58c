"""Fit intensity curves of several kinds, and choose the one that predicts unseen presses best."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.intensity import Curve
from palpate.spatial.arguments import takes_arrays

FEWEST = 8  # rows that a curve needs
_DEGREES = (1, 2, 3, 4, 5)
_TWO_RANGE = 3  # forces without which there are no two ranges
_FEW = 6  # forces of which a curve takes each as a knot
_FOLDS = 5
_Make = Callable[[np.ndarray, np.ndarray], Curve]


@dataclass(frozen=True)
class _Linear:
    """A curve that is linear in its parameters and in the unloaded intensity, which is fitted too."""

    kind: str
    design: Callable[[np.ndarray], np.ndarray]
    fields: Mapping[str, object]
    rising: bool = False

    def solved(
        self, force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n p"], Float[np.ndarray, " p"], Float[np.ndarray, " n"]]:
        """Return the design, its parameters, and what the fit leaves of the readings."""
        matrix = np.column_stack([np.ones(len(force)), self.design(force)])
        values = _increasing(matrix, signed) if self.rising else np.linalg.lstsq(matrix, signed, rcond=None)[0]
        return matrix, values, signed - matrix @ values

    def __call__(self, force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"]) -> Curve:
        matrix, values, left = self.solved(force, signed)
        variance = float(left @ left) / max(len(force) - matrix.shape[1], 1)
        covariance = variance * np.linalg.pinv(matrix.T @ matrix)
        turn = np.eye(len(values))
        if self.rising:  # steps to values
            turn[1:, 1:] = np.tril(np.ones((len(values) - 1, len(values) - 1)))
        values, covariance = turn @ values, turn @ covariance @ turn.T
        return Curve(
            self.kind,
            values[1:],
            covariance[1:, 1:],
            largest=float(force.max()),
            residual=float(np.sqrt(np.mean(left**2))),
            **self.fields,  # pyright: ignore[reportArgumentType] - knots or joint, as the kind has
        )


def _polynomial(degree: int) -> _Linear:
    return _Linear("polynomial", lambda force: force[:, None] ** np.arange(1, degree + 1), {})


def _two_range(joint: float) -> _Linear:
    def design(force: np.ndarray) -> np.ndarray:
        low = np.minimum(force, joint)
        return np.column_stack([low, low**2, force - low])

    return _Linear("two_range", design, {"joint": joint})


def _monotone(knots: Float[np.ndarray, " k"]) -> _Linear:
    """Return a curve that is linear between knots, as steps none of which is downward."""

    def design(force: np.ndarray) -> np.ndarray:
        edges = np.concatenate([[0.0], knots])
        return np.clip((force[:, None] - edges[:-1]) / np.diff(edges), 0.0, 1.0)

    return _Linear("monotone", design, {"knots": knots}, rising=True)


def _increasing(matrix: np.ndarray, signed: np.ndarray) -> np.ndarray:
    from scipy.optimize import lsq_linear

    least = 1e-6 * float(np.ptp(signed))
    low = np.concatenate([[-np.inf], np.full(matrix.shape[1] - 1, least)])
    return lsq_linear(matrix, signed, bounds=(low, np.inf), tol=1e-12).x


def _best_joint(force: np.ndarray, signed: np.ndarray) -> Curve:
    """Fit two ranges whose joint gives the smallest residual."""
    joints: Float[np.ndarray, " j"] = np.quantile(force[force > 0], np.linspace(0.02, 0.95, 48))
    best = _best(joints, force, signed)
    for _ in range(2):  # finer, to either side
        at = int(np.argmin(np.abs(joints - best.joint)))
        low, high = float(joints[max(at - 1, 0)]), float(joints[min(at + 1, len(joints) - 1)])
        joints = np.linspace(low, high, 17)
        best = _best(joints, force, signed)
    return best


def _best(joints: np.ndarray, force: np.ndarray, signed: np.ndarray) -> Curve:
    fits = [_two_range(joint) for joint in joints.tolist()]
    for fit in sorted(fits, key=lambda fit: float(np.mean(fit.solved(force, signed)[2] ** 2))):
        with suppress(InputError):  # it does not rise
            return fit(force, signed)
    what, hint = "no curve of two ranges that rises with force fits the log.", "Use another kind, such as auto."
    raise InputError(what, where="intensity", hint=hint)


@takes_arrays
def chosen(
    kind: str, degree: int | None, force: Float[np.ndarray, " n"], signed: Float[np.ndarray, " n"]
) -> tuple[Curve, str]:
    """Return the `Curve` that predicts unseen presses best, and a reason if it is a straight line by choice, else "".

    Args:
        kind: of `Curve` but "resistive", or "auto".
        degree: of a polynomial; None: the best of 1 to 5.
        force: (n,) [N].
        signed: (n,) readings that grow with the force.

    Raises:
        InputError: an unknown kind, or a curve that does not rise; or arrays of other shapes.
    """
    choice = _choices(kind, degree, force, signed)
    errors = [_held_out(make, force, signed) for make in choice] if len(choice) > 1 else [0.0]
    curve = choice[int(np.argmin(errors))](force, signed)
    if len(choice) == 1 or curve.kind != "polynomial" or len(curve.parameters) > 1:
        return curve, ""
    if np.isinf(errors[0]):
        reason = f"{len(force)} presses are too few to leave some out, so other curves could not be judged"
    elif np.isinf(errors[1:]).all():
        reason = "no other curve rises with force"
    else:
        reason = "it predicts best the presses that were left out"
    return curve, f"the curve is a straight line, a polynomial of degree 1: {reason}"


def _choices(kind: str, degree: int | None, force: np.ndarray, signed: np.ndarray) -> list[_Make]:
    levels = len(np.unique(force[force > 0]))  # a few known weights bear no more parameters
    degrees = [each for each in _DEGREES if each <= max(levels, 1)] if degree is None else [degree]
    known: dict[str, list[_Make]] = {
        "polynomial": [_polynomial(each) for each in degrees],
        "two_range": [_best_joint] if levels >= _TWO_RANGE or kind != "auto" else [],
        "monotone": [_monotone(_knots(force, signed))],
    }
    if kind == "auto":
        return [each for some in known.values() for each in some]
    if kind not in known:
        raise InputError(f"kind of curve {kind!r} is not known.", hint=f"Use auto, {' or '.join(known)}.")
    return known[kind]


def _knots(force: np.ndarray, signed: np.ndarray) -> np.ndarray:
    """Return up to twelve forces [N], equally spaced along the curve, no more than there are."""
    count, levels = int(np.clip(len(force) // 8, 2, 12)), np.unique(force[force > 0])
    if len(levels) < _FEW:
        return levels
    count = min(count, len(levels))
    order = np.argsort(force, kind="stable")
    window = max(len(force) // 40, 1)
    smooth = np.convolve(signed[order], np.ones(window) / window, mode="valid")
    middle = np.convolve(force[order], np.ones(window) / window, mode="valid")
    risen = np.maximum.accumulate(smooth)
    way = (middle - middle[0]) / max(float(np.ptp(middle)), 1e-12)
    way = way + (risen - risen[0]) / max(float(np.ptp(risen)), 1e-12)
    steps = np.linspace(0.0, float(way[-1]), count + 1)[1:-1]
    knots: Float[np.ndarray, " k"] = np.interp(steps, way, middle)
    return np.unique(np.append(knots[knots > 0], force.max()))


def _held_out(make: _Make, force: np.ndarray, signed: np.ndarray) -> float:
    """Return the sum of squared errors over unseen blocks of neighbouring forces; inf where no fit can be made."""
    order = np.argsort(force, kind="stable")
    fold = np.empty(len(force), dtype=np.int64)
    fold[order] = np.arange(len(force)) // max(len(force) // (4 * _FOLDS), 1) % _FOLDS
    total = 0.0
    for k in range(_FOLDS):
        train, test = fold != k, fold == k
        if np.count_nonzero(train) < FEWEST or not test.any():
            return np.inf
        try:
            curve = make(force[train], signed[train])
        except (InputError, NotIdentifiable, ValueError):
            return np.inf
        zero = float(np.median(signed[train] - curve.intensity(force[train])))
        total += float(np.sum((signed[test] - zero - curve.intensity(force[test])) ** 2))
    return total
