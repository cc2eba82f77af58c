"""Plan the next pokes, and their number."""

from __future__ import annotations

from math import radians

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.priors import Priors
from palpate.sensors.taxels.poking.rigid_groups import Units, across, fitted, single
from palpate.sensors.taxels.poking.solve import Before
from palpate.sensors.taxels.poking.systematic_errors import Nuisances, predicted
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose
from palpate.surfaces.surface import Surface

FORCE = 10.0  # N of a planned poke
TILT = radians(20.0)  # of the candidate directions from the normal
PLACED = 0.7e-3  # m: how well taxels tell where a poke was
LOOKED = 3000  # candidates that are examined for a poke
MOST = 2000  # pokes of a plan
KEEN = 8.0  # power of a taxel's variance, over the worst one, in its weight; 3 to 200 serve as well

Vectors = Float[np.ndarray, "n 3"]


@frozen_value
class PossiblePokes:
    """The c pokes that could be made.

    Attributes:
        point: (c, 3) [m] and direction: (c, 3) of the force on the body, unit, in the link's frame.
        configuration: (c,) index of the arm's configuration; taxel: (c,) index of the poked taxel.
        rows: (c, 3, p) derivatives of the whitened torque by units, then `Nuisances.vector`.
    """

    point: Vectors
    direction: Vectors
    configuration: Int[np.ndarray, " c"]
    taxel: Int[np.ndarray, " c"]
    rows: Float[np.ndarray, "c 3 p"]


@frozen_value
class Plan:
    """The next pokes, and the accuracy that they give.

    Attributes:
        chosen: (m,) indices of candidates, in order.
        worst: (m + 1,) [m] largest standard deviation of a taxel, before the first poke and after each.
        reached: true if the last of `worst` is as small as wanted.
    """

    chosen: Int[np.ndarray, " m"]
    worst: Float[np.ndarray, " m1"]
    reached: bool


@takes_arrays
def candidates(units: Units, poses: Pose, noise: Float[np.ndarray, "6 6"]) -> PossiblePokes:
    """Return `PossiblePokes` of 10 N on each taxel, along its normal and 20 degrees to four sides, in each pose.

    Args:
        units: places of the taxels.
        poses: (d,) T_sensor_link of the configurations.
        noise: covariance of a wrench.

    Raises:
        InputError: no taxel has a place, or the noise is not positive definite; or arrays of other shapes.
    """
    points, normals = units.places
    rows = units.taxels
    if not len(rows):
        raise InputError("no taxel has a place to poke.", where="plan", hint="Plan from a skin with taxels.")
    count = len(poses.translation)
    first, second = np.moveaxis(across(normals[rows]), 2, 0)
    ways = -normals[rows] + np.tan(TILT) * np.stack([0 * first, first, -first, second, -second])  # (5, r, 3)
    ways = ways / np.linalg.norm(ways, axis=2, keepdims=True)
    taxel = np.tile(rows, 5 * count)
    direction = np.tile(ways.reshape(-1, 3), (count, 1))
    configuration: Int[np.ndarray, " c"] = np.repeat(np.arange(count), 5 * len(rows))
    point = points[taxel]
    turn, origin = poses.rotation[configuration], poses.translation[configuration]
    pressed = FORCE * np.einsum("nij,nj->ni", turn, direction)
    torque = np.cross(np.einsum("nij,nj->ni", turn, point) + origin, pressed)
    many = len(point)
    alike = (np.arange(many + 1), taxel, np.ones(many), len(units.layout), noise, np.ones(many), np.zeros(many))
    pokes = Pokes(np.concatenate([pressed, torque], axis=1), turn, origin, configuration, *alike)
    return PossiblePokes(point, direction, configuration, taxel, _rows(units, pokes, point, count))


def _rows(units: Units, pokes: Pokes, point: Vectors, configurations: int) -> Float[np.ndarray, "c 3 p"]:
    none = Nuisances.none(configurations)
    said = predicted(pokes, point, none)
    read = np.eye(6)[3:] - said.by_wrench
    spread = read @ pokes.noise @ np.swapaxes(read, 1, 2)
    spread = spread + PLACED**2 * said.by_point @ np.swapaxes(said.by_point, 1, 2)
    root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(spread)), 1, 2)
    size = len(units) * units.freedom
    rows = np.zeros((len(point), 3, size + len(none.vector())))
    each, axes = np.ogrid[: len(point), :3]
    unit = units.layout.module[pokes.taxel][:, None] * units.freedom + np.arange(units.freedom)
    shared = size + Nuisances.columns(pokes.configuration, configurations)
    rows[each[..., None], axes[..., None], unit[:, None]] = root @ (said.by_point @ units.jacobian[pokes.taxel])
    rows[each[..., None], axes[..., None], shared[:, None]] = root @ said.by_nuisance
    return rows


def after_calibration(
    places: TaxelPlaces, surface: Surface | None, priors: Priors, *, start: bool = False
) -> tuple[Units, Float[np.ndarray, "p p"], PossiblePokes]:
    """Return `Units`, covariance (p, p) of all unknowns, and `PossiblePokes`, from the result of a calibration.

    Pokes are not stored: each counts as equal parts of the candidates on the taxel that it touched.

    Args:
        places: a result of `calibrate_taxels` by modules or single taxels.
        surface: as in the calibration.
        priors: as in the calibration.
        start: true if it began from CAD.

    Raises:
        InputError: the result does not state its configurations and noise, or has no taxels.
    """
    if not len(places.configurations) or len(places.noise) != 6:
        raise InputError(
            "does not state the arm configurations in which it was made.",
            where="skin",
            hint="Plan from a .toml that palpate calibrate taxels wrote with method modules or taxels.",
        )
    if places.modules:
        units = fitted(ModuleLayout.of(places, bent=True), places.positions, surface)
    else:
        units, priors = single(places.positions, surface, places.normals), priors.of_single_taxels()
    rows = places.configurations
    poses, share = Pose.from_quaternion(rows[:, 3:7], rows[:, :3]), rows[:, 7] / rows[:, 7].sum()
    options = candidates(units, poses, np.diag(places.noise**2))
    answers = np.maximum(places.pokes, 0) * rows[:, 7].sum() / max(int(places.pokes.sum()), 1)  # a poke, some answers
    made = answers[options.taxel] * share[options.configuration] / (len(options.taxel) / len(units.taxels) / len(rows))
    deviations = units.each(priors.start, priors.start_angle) if start else None
    return units, known_after(units, options, made, priors, len(rows), deviations), options


@takes_arrays
def known_after(
    units: Units,
    options: PossiblePokes,
    made: Float[np.ndarray, " c"],
    priors: Priors,
    configurations: int,
    deviations: Float[np.ndarray, " f"] | None = None,
) -> Float[np.ndarray, "p p"]:
    """Return the covariance (p, p) of units' unknowns, then `Nuisances.vector`, under the priors and some pokes.

    Args:
        units: places of the taxels.
        options: the c candidates.
        made: (c,) number of pokes at each, which need not be whole.
        priors: of the errors.
        configurations: number of them.
        deviations: (f,) [m, rad] prior standard deviations of a unit's unknowns; None: nothing is known.

    Raises:
        InputError: arrays of other shapes.
    """
    rows = options.rows[made > 0] * np.sqrt(made[made > 0])[:, None, None]
    flat = rows.reshape(-1, options.rows.shape[2])
    before = Before(units, None, deviations, Nuisances.deviations(priors, configurations))
    return before.covariance(flat.T @ flat)


@takes_arrays
def plan_pokes(
    units: Units,
    covariance: Float[np.ndarray, "p p"],
    options: PossiblePokes,
    *,
    wanted: float = 0.0,
    pokes: int = 50,
) -> Plan:
    """Choose pokes one after the other, each to reduce the worst taxels' covariances most; return a `Plan`.

    Args:
        units: places of the taxels.
        covariance: (p, p) of all unknowns, as `known_after` returns it.
        options: possible pokes.
        wanted: [m] largest standard deviation (root of the trace) of a taxel that is good enough.
        pokes: largest number of pokes, at most 2000.

    Raises:
        InputError: covariance has another shape.
    """
    taxels, size = units.taxels, units.freedom
    unit = units.layout.module[taxels]
    columns = unit[:, None] * size + np.arange(size)
    by = units.jacobian[taxels]
    square = np.swapaxes(by, 1, 2) @ by
    rng = np.random.default_rng(0)
    known: Float[np.ndarray, "p p"] = covariance.copy()
    chosen, worst = list[int](), list[float]()
    while True:
        blocks = known[columns[:, :, None], columns[:, None]]
        traces = np.einsum("kif,kfg,kig->k", by, blocks, by)
        j = int(np.argmax(traces))
        worst.append(float(np.sqrt(traces[j])))
        if worst[-1] <= wanted or len(chosen) >= min(pokes, MOST):
            break
        few = np.arange(len(options.taxel))
        if len(few) > LOOKED:
            own = units.layout.module[options.taxel] == unit[j]
            few = np.union1d(few[own], rng.choice(few, LOOKED, replace=False))
        rows = options.rows[few]
        spread: Float[np.ndarray, "c 3 p"] = rows @ known  # (c, 3, p)
        seen: Float[np.ndarray, "c 3 3"] = spread @ np.swapaxes(rows, 1, 2) + np.eye(3)
        counts = (traces / traces[j]) ** KEEN * (traces > wanted**2)
        pull = np.zeros((len(units), size, size))
        np.add.at(pull, unit, counts[:, None, None] * square)
        own = spread[:, :, : len(units) * size].reshape(len(few), 3, len(units), size)
        inverse = np.linalg.inv(seen)
        gain = np.einsum("cab,cauf,cbuf->c", inverse, own, (own[..., None, :] @ pull)[..., 0, :], optimize=True)
        best = int(np.argmax(gain))
        known = known - spread[best].T @ (inverse[best] @ spread[best])
        known = 0.5 * (known + known.T)
        chosen.append(int(few[best]))
    return Plan(np.array(chosen, dtype=np.int64), np.array(worst), bool(worst[-1] <= wanted))
