"""Search the known mistakes that explain a log of poses, jointly with its outliers.

Every hypothesis is fitted by least trimmed squares, so that a pose that was touched does not decide: force on (weight,
bias), then torque on (centre, bias). A sensor turned on its flange by any rotation A is found in closed form: with
F_i = A R_i^T w + f0, the rows R_i A^T F_i - R_i A^T f0 - w = 0 are linear in A^T, A^T f0 and w up to their scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from palpate.sensors.force_torque._payload_fit import force_columns, torque_columns
from palpate.sensors.force_torque._payload_mistakes import (
    AS_IS,
    BASE,
    MISTAKES,
    REVERSED,
    compose,
    mistake_of,
    parts,
    reoriented,
    turned,
)
from palpate.spatial.pose import Pose, skew

MOST = 300  # poses that are searched, evenly spread
TRIMMED = 0.2  # share of the poses, and two at least, that a fit may leave aside
FEW = 12  # poses up to which every pair is left out in turn; beyond, the fits start from random thirds
STARTS = 60
TRIED = 10.0  # a force that is fitted so many times worse than the best is not tried with torques
ALIKE = 2.0  # misfits within this factor explain a log equally well
TURNS = 8  # that are refined
TURN = 5.0  # degrees: a sensor mounted more precisely is not turned
FAR = 1.0  # m: no tool has its centre of mass farther from the sensor
ROUNDING = 1e-9


@dataclass(frozen=True)
class Explanation:
    """A hypothesis that was fitted to a log.

    Attributes:
        name: as `identify_payload(hypothesis=name)` takes it.
        misfit: geometric mean of the rms [N] and [N m] of the force and the torque over the poses that fit best.
        lever: distance [m] of the centre of mass from the sensor.
    """

    name: str
    misfit: float
    lever: float

    @property
    def cost(self) -> float:
        """Sum of the costs of its mistakes, 0.0 without any."""
        return sum((mistake_of(part).cost for part in parts(self.name)), 0.0)


@dataclass(frozen=True)
class _Poses:
    """Poses of a log: force and torque (n, 3), rotations (n, 3, 3), gravity's direction, and the starts of fits."""

    wrenches: Float[np.ndarray, "n 6"]
    rotations: Float[np.ndarray, "n 3 3"]
    direction: Float[np.ndarray, "3"] | None
    starts: Bool[np.ndarray, "m n"]
    kept: int

    def fit(self, columns: Float[np.ndarray, "n 3 p"], target: Float[np.ndarray, "n 3"]) -> tuple[float, np.ndarray]:
        """Return the rms over the poses that fit best, and the parameters (p,), by least trimmed squares."""
        gram = np.einsum("nip,niq->npq", columns, columns)
        right = np.einsum("nip,ni->np", columns, target)
        ridge = 1e-12 * np.trace(gram.sum(axis=0)) / columns.shape[2] * np.eye(columns.shape[2])

        def fitted(chosen: Float[np.ndarray, "m n"]) -> tuple[np.ndarray, np.ndarray]:
            """Return parameters (m, p) by least squares of the chosen poses, and squared residuals (m, n) of all."""
            matrices, sides = np.tensordot(chosen, gram, 1) + ridge, (chosen @ right)[..., None]
            found = np.asarray(np.linalg.solve(matrices, sides), dtype=np.float64)[..., 0]
            return found, ((target - np.einsum("nip,mp->mni", columns, found)) ** 2).sum(axis=2)

        found, squares = fitted(self.starts.astype(np.float64))
        for _ in range(3):
            limit = np.partition(squares, self.kept - 1, axis=1)[:, self.kept - 1, None]
            found, squares = fitted((squares <= limit).astype(np.float64))
        sums = np.partition(squares, self.kept - 1, axis=1)[:, : self.kept].sum(axis=1)
        best = int(np.argmin(sums))
        rounding = ROUNDING * float(np.abs(target).max(initial=0.0))
        return max(float(np.sqrt(sums[best] / (3 * self.kept))), rounding, 1e-300), found[best]

    def force(self, rotations: np.ndarray, force: np.ndarray) -> tuple[float, Float[np.ndarray, "3"]]:
        """Return the misfit of the force [N], and the weight (3,) in the base."""
        misfit, found = self.fit(force_columns(rotations, self.direction), force)
        return misfit, found[:3] if self.direction is None else found[0] * self.direction

    def explained(self, name: str, misfit: float, columns: np.ndarray, torque: np.ndarray) -> Explanation:
        """Return the explanation with the force's misfit and that of the torque; N mm if the centre is too far off."""
        second, found = self.fit(columns, torque)
        lever = float(np.linalg.norm(found[:3]))
        if lever > FAR:
            name, lever = compose(name, "torque in N mm"), 1e-3 * lever
        return Explanation(name, float(np.sqrt(misfit * second)), lever)


def upward(weight: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"] | None) -> bool:
    """Return whether a weight points against gravity: as given, or else within 60 degrees of the base's +z."""
    if direction is not None:
        return float(weight @ direction) < 0
    return float(weight[2]) > 0.5 * float(np.linalg.norm(weight))


def search(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], direction: Float[np.ndarray, "3"] | None
) -> list[Explanation]:
    """Return the hypotheses of up to three mistakes that were fitted to the poses; [] of fewer than six poses."""
    poses = _poses(wrenches, rotations, direction)
    return [] if poses is None else [*_of_table(poses), *_of_turns(poses)]


def fitted(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], direction: Float[np.ndarray, "3"] | None
) -> Explanation | None:
    """Return how well poses fit as they are, with the centre of mass where it is; None of fewer than six poses."""
    if (poses := _poses(wrenches, rotations, direction)) is None:
        return None
    misfit, weight = poses.force(poses.rotations, poses.wrenches[:, :3])
    second, found = poses.fit(torque_columns(poses.rotations, weight), poses.wrenches[:, 3:])
    return Explanation(AS_IS, float(np.sqrt(misfit * second)), float(np.linalg.norm(found[:3])))


def weight_misfit(wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"]) -> float | None:
    """Return the rms [N] that a weight and a bias leave of the force in poses as they are; None of fewer than six."""
    poses = _poses(wrenches, rotations, None)
    return None if poses is None else poses.force(poses.rotations, poses.wrenches[:, :3])[0]


def _poses(wrenches: np.ndarray, rotations: np.ndarray, direction: np.ndarray | None) -> _Poses | None:
    step = -(-len(wrenches) // MOST)
    wrenches, rotations = wrenches[::step], rotations[::step]
    count = len(wrenches)
    kept = count - max(2, int(np.ceil(TRIMMED * count)))
    return None if kept < 4 else _Poses(wrenches, rotations, direction, _starts(count), kept)


def likely(found: list[Explanation]) -> list[Explanation]:
    """Return those that explain the log as well as the best, within a factor of two; the simplest come first."""
    best = min((each.misfit for each in found), default=0.0)
    return sorted((each for each in found if each.misfit <= ALIKE * best), key=lambda each: (each.cost, each.misfit))


def _starts(count: int) -> Bool[np.ndarray, "m n"]:
    if count <= FEW:
        starts = np.ones((1 + count * (count - 1) // 2, count), dtype=bool)
        for row, pair in enumerate(combinations(range(count), 2), start=1):
            starts[row, list(pair)] = False
        return starts
    draws = np.random.default_rng(1).random((STARTS, count)).argsort(axis=1) < max(8, count // 3)
    return np.concatenate([np.ones((1, count), dtype=bool), draws])


def _of_table(poses: _Poses) -> list[Explanation]:
    """Return what the table of mistakes explains: of the orientation, the frames and the axes, with the sign."""
    axes = {name: mistake for name, mistake in MISTAKES.items() if "mirrored" in name or "swapped" in name}
    both = {"": None, **{name: mistake for name, mistake in axes.items() if "(" not in name}}
    forces: list[tuple[float, np.ndarray, tuple[str, bool, str]]] = []
    for order in ("", "inverse rotations", "w first", "inverse rotations + w first"):
        rotations = reoriented(poses.rotations, order)
        for based in (False, True):
            force = _turned_back(poses.wrenches[:, :3], rotations) if based else poses.wrenches[:, :3]
            for name, mistake in both.items():
                misfit, weight = poses.force(rotations, force if mistake is None else force @ mistake.force)
                forces.append((misfit, weight, (order, based, name)))
    best = min(misfit for misfit, _, _ in forces)
    found: list[Explanation] = []
    for misfit, weight, (order, based, name) in forces:
        if misfit > TRIED * best and (order, based, name) != ("", False, ""):
            continue
        rotations = reoriented(poses.rotations, order)
        sign = -1.0 if upward(weight, poses.direction) else 1.0
        columns = torque_columns(rotations, sign * weight)
        for torque_based in (False, True):
            logged = poses.wrenches[:, 3:]
            logged = _turned_back(logged, rotations) if torque_based else logged
            for torque_name in (name, "") if name else both:
                mistake = both[torque_name]
                which = "" if name == torque_name else " (force)" if name else " (torque)"
                frame = "" if based == torque_based else " (force)" if based else " (torque)"
                names = compose(
                    order,
                    BASE + frame if based or torque_based else "",
                    (name or torque_name) + which,
                    REVERSED if sign < 0 else "",
                )
                torque = sign * (logged if mistake is None else logged @ mistake.torque)
                found.append(poses.explained(names, misfit, columns, torque))
    return [each for each in found if len(parts(each.name)) <= 3]


def _of_turns(poses: _Poses) -> list[Explanation]:
    """Return what a sensor that is turned on its flange explains, with rotations as they are or stored otherwise."""
    found: list[Explanation] = []
    for order in ("", "inverse rotations", "w first") if poses.kept >= 6 else ():
        rotations = reoriented(poses.rotations, order)
        misfit, turn = _turn(poses, rotations)
        vector = np.degrees(Pose(turn, np.zeros(3)).rotation_vector())
        if np.linalg.norm(vector) < TURN:
            continue
        rotations = rotations @ turn
        misfit, weight = poses.force(rotations, poses.wrenches[:, :3])
        name = compose(order, turned(vector), REVERSED if upward(weight, poses.direction) else "")
        found.append(poses.explained(name, misfit, torque_columns(rotations, weight), poses.wrenches[:, 3:]))
    return found


def _turn(poses: _Poses, rotations: Float[np.ndarray, "n 3 3"]) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """Return the misfit [N] and the rotation (3, 3) of the sensor in the flange whose rotations are given."""
    force = poses.wrenches[:, :3]
    scaled = force / max(float(np.abs(force).max(initial=0.0)), 1e-300)
    rows = np.concatenate(
        [
            np.einsum("nij,nk->nijk", rotations, scaled).reshape(-1, 3, 9),
            -rotations,
            -np.broadcast_to(np.eye(3), rotations.shape),
        ],
        axis=2,
    )
    gram = np.einsum("nip,niq->npq", rows, rows)
    vectors = np.linalg.eigh(np.tensordot(poses.starts.astype(np.float64), gram, 1))[1][:, :9, 0]
    left, _, right = np.linalg.svd(vectors.reshape(-1, 3, 3))
    turns = left @ right
    turns = turns * np.sign(np.linalg.det(turns))[:, None, None]
    return min((_refined(poses, rotations, turn) for turn in _different(turns)), key=lambda each: each[0])


def _different(turns: Float[np.ndarray, "m 3 3"]) -> list[Float[np.ndarray, "3 3"]]:
    """Return up to `TURNS` turns of which no two are alike: most starts end in one."""
    found: list[np.ndarray] = []
    for turn in turns:
        if len(found) < TURNS and all(
            np.trace(turn.T @ other) < 1.0 + 2.0 * np.cos(np.radians(20.0)) for other in found
        ):
            found.append(turn)
    return found


def _refined(
    poses: _Poses, rotations: np.ndarray, turn: Float[np.ndarray, "3 3"]
) -> tuple[float, Float[np.ndarray, "3 3"]]:
    """Return misfit and turn after Gauss-Newton steps: a trimmed fit of weight and bias, then a small turn."""
    force = poses.wrenches[:, :3]
    misfit = np.inf
    for _ in range(5):
        columns = force_columns(rotations @ turn, None)
        misfit, found = poses.fit(columns, force)
        weights = columns[:, :, :3] @ found[:3]
        residuals = force - weights - found[3:]
        near = np.argpartition((residuals**2).sum(axis=1), poses.kept - 1)[: poses.kept]
        jacobian = np.concatenate([columns, skew(weights)], axis=2)[near]
        step = np.linalg.lstsq(jacobian.reshape(-1, 9), residuals[near].ravel(), rcond=None)[0][6:]
        turn = turn @ Pose.from_rotation_vector(step, np.zeros(3)).rotation
    return misfit, turn


def _turned_back(vectors: Float[np.ndarray, "n 3"], rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Return vectors in the sensor's frame that are written in the base."""
    return np.einsum("nji,nj->ni", rotations, vectors)
