"""Calibrate the places of taxels from pokes."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np
from jaxtyping import Float

from palpate.calibration.validation import Validation
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking import paper
from palpate.sensors.taxels.poking.moved_modules import moved_far
from palpate.sensors.taxels.poking.numbering import Numbering, found_numbering
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.priors import Priors
from palpate.sensors.taxels.poking.rigid_groups import Units, fitted, placed, single
from palpate.sensors.taxels.poking.solve import PlacesSolution, solve, validated
from palpate.sensors.taxels.poking.spacing import Spacing, by_scale
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import quaternion_from_rotation
from palpate.surfaces.surface import Surface

__all__ = ["METHODS", "TaxelCalibration", "calibrate_taxels"]

METHODS = ("free", "weighted", "surface", "taxels", "modules")
FEWEST = 3  # pokes of a module that nothing else is known of
ENOUGH = 10  # pokes in all
FARTHEST = 10.0  # m from the sensor to the link
NAMED = 12  # taxels in a sentence
RESCALED = 2  # fits with the spacing that pokes show
NOISIER, ASTRAY = 1.3, 20.0  # ratios of residuals to noise: above them a warning, and an error
LIKE = 3.0  # times the layout's spacing, up or down, beyond which pokes show nonsense
ALONE = (
    "there is only one arm configuration: the sensor's bias and the error of the link's frame cannot be told from a "
    "shift of all taxels"
)


@frozen_value
class TaxelCalibration:
    """The result of a calibration from pokes.

    Attributes:
        places: of the taxels, with covariance.
        used: number of pokes that were used.
        noise: ratio of the residuals to what their covariance explains; 1 for the paper's methods.
        nuisances: name -> errors estimated with the taxels: frames and bias (configurations, 6), common (6,),
            cross_talk (6, 6); empty for the paper's methods.
        validation: errors of pokes that a fit had not seen; empty for the paper's methods.
        spacing: of neighbouring taxels, as stated and as found; None for single taxels.
        size_deviation: standard deviation of the size of the whole skin, as a share; NaN for the paper's methods.
        notes, warnings: for the user, a sentence each.
    """

    places: TaxelPlaces
    used: int
    noise: float
    nuisances: dict[str, np.ndarray] = field(default_factory=lambda: {})
    validation: Validation = field(default_factory=Validation)
    spacing: Spacing | None = None
    size_deviation: float = np.nan
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def calibrate_taxels(
    pokes: Pokes,
    *,
    method: str = "modules",
    surface: Surface | None = None,
    start: TaxelPlaces | None = None,
    layout: ModuleLayout | None = None,
    priors: Priors | None = None,
    rescale: bool = False,
) -> TaxelCalibration:
    """Return the places of taxels, in the link's frame, from pokes, as a `TaxelCalibration`.

    Args:
        pokes: of all configurations.
        method: "free", "weighted", "surface": the paper's [taxel poking], each taxel separately, with equal weights,
            weighted by its response, or weighted and on the surface. "taxels": single taxels in one fit, with the
            sensor's bias and the errors of frames. "modules": rigid modules, also with cross-talk and a model of
            responses.
        surface: of the link, in its frame; "surface" needs one, "taxels" and "modules" are better with one.
        start: expected places of the taxels (CAD), weighted by the priors; None: nothing is known.
        layout: of modules; None: that of the start.
        priors: of the start and of the errors; None: the defaults.
        rescale: lay modules with the spacing that the pokes show, where it contradicts the layout's.

    Raises:
        InputError: an unknown method, a missing surface or layout, a mirrored layout, another number of taxels, a link
            that is too far away, normals that point into the body, or residuals or a spacing that no places explain.
        NotIdentifiable: fewer than ten pokes, or too few on a module.
    """
    if method not in METHODS:
        raise InputError(f"{method!r} is not known.", where="method", hint=f"Use one of {', '.join(METHODS)}.")
    for name, given in (("layout", layout), ("start", start)):
        if given is not None and len(given) != pokes.taxels:
            raise InputError(
                f"the {name} has {len(given)} taxels, but the pokes have {pokes.taxels}: it belongs to another skin.",
                where=name,
            )
    away = np.median(np.linalg.norm(pokes.origin, axis=1)) if len(pokes) else 0.0
    if away > FARTHEST:
        what = f"the link is {away:.3g} m from the sensor."
        raise InputError(what, where="pokes", hint="Write positions of poses in m: these look like mm.")
    believed = int(np.count_nonzero(pokes.weight > 0))
    if believed < ENOUGH:
        raise NotIdentifiable(
            f"{believed} pokes can be used, and at least {ENOUGH} are needed.",
            rank=believed,
            missing=("places of taxels",),
        )
    if method in ("taxels", "modules"):
        return _together(pokes, method == "modules", surface, start, layout, priors or Priors(), rescale=rescale)
    if method == "surface" and surface is None:
        raise InputError(
            "this method needs the link's surface.", where="method", hint="Add [surface] to the rig, or use 'weighted'."
        )
    return _each(pokes, method, surface)


def _each(pokes: Pokes, method: str, surface: Surface | None) -> TaxelCalibration:
    """Calibrate by the paper's methods."""
    equations = paper.normal_equations(pokes, weighted=method != "free")
    points = paper.free(equations) if method != "surface" or surface is None else paper.on_surface(equations, surface)
    rows = np.isfinite(points).all(axis=1)
    normals = np.full(points.shape, np.nan)
    if surface is not None and rows.any():
        normals[rows] = surface.project(points[rows])[1]
    force, torque = paper.in_link(pokes)
    size = np.linalg.norm(force, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = (torque[pokes.poke] - np.cross(points[pokes.taxel], force[pokes.poke])) / size[pokes.poke][:, None]
    share = np.where(np.isfinite(gap).all(axis=1), pokes.weight[pokes.poke], 0.0)
    square = np.bincount(pokes.taxel, share * np.nan_to_num((gap**2).sum(axis=1)), pokes.taxels)
    count = np.bincount(pokes.taxel, share, pokes.taxels)
    variance = square / np.maximum(2.0 * count - 3.0, 1.0)  # two rows an answer tell of a place, and three are taken
    covariance = np.full((pokes.taxels, 3, 3), np.nan)
    values, axes = np.linalg.eigh(equations.matrix[rows])
    inverse = 1.0 / np.maximum(values, 1e-6 * np.maximum(values[:, -1:], 1e-12))
    covariance[rows] = np.einsum("k,kia,ka,kja->kij", variance[rows], axes, inverse, axes)
    places = TaxelPlaces(points, normals, covariance, pokes=pokes.counts())
    doubt = "covariances are those of single taxels: they do not include errors that all pokes share"
    doubts = (doubt, ALONE) if pokes.configurations < 2 else (doubt,)
    used = int(np.count_nonzero(pokes.weight > 0))
    return TaxelCalibration(places, used, 1.0, notes=_untouched(places), warnings=doubts)


def _together(
    pokes: Pokes,
    modules: bool,
    surface: Surface | None,
    start: TaxelPlaces | None,
    layout: ModuleLayout | None,
    priors: Priors,
    *,
    rescale: bool,
) -> TaxelCalibration:
    """Fit all taxels in one, with all errors that are estimated."""
    points, outward, weight = _guessed(pokes, surface)
    if start is not None:
        cosine = (start.normals * outward).sum(axis=1)
        if (cosine < 0).sum() > 4 * (cosine > 0).sum():
            raise InputError(
                "the forces of the pokes pull along the normals of the start, as if they pointed into the body.",
                where="start",
                hint="Reverse them or, if they point outward, state the other acts_on in [force_torque].",
            )
    renumbered, doubts = list[str](), ()
    if modules:
        layout = layout if layout is not None or start is None else ModuleLayout.of(start, bent=True)
        if layout is None or not layout.modules:
            raise InputError(
                "modules need a layout.",
                where="method",
                hint="Give a layout, or a start whose taxels have module numbers, or use 'taxels'.",
            )
        few = _few(layout, points)
        if few and start is None:
            raise NotIdentifiable(
                f"fewer than {FEWEST} taxels answered on modules {', '.join(few[:NAMED])}: their places cannot be "
                "found. Poke them, or give their places by CAD as start.",
                rank=layout.modules - len(few),
                missing=tuple(f"module {number}" for number in few),
            )
        layout, start, renumbered = _numbered(layout, start, points, outward, 0.0 * weight if few else weight)
        begun = None if start is None else fitted(layout, start.positions, surface)
        units = begun or fitted(layout, points, surface, weight)
    else:
        begun = None if start is None else single(start.positions, surface, _facing(start.normals, outward))
        units = begun or single(points, surface, outward)
    priors = priors if modules else priors.of_single_taxels()
    deviations = None if begun is None else units.each(priors.start, priors.start_angle)
    solution = solve(pokes, units, priors, start=begun, deviations=deviations)
    stated = units.layout.spacing
    for _ in range(RESCALED if rescale and modules else 0):
        spacing = _spacing(stated, solution)
        if not spacing.contradicted:
            break
        if not stated / LIKE < spacing.found < stated * LIKE:
            raise InputError(
                f"the pokes show taxels {1e3 * spacing.found:.2f} +- {1e3 * spacing.deviation:.2f} mm from their "
                f"neighbours, not {1e3 * stated:.2f} mm as in the layout.",
                where="pokes",
                hint="Check that responses and wrenches in a row are of one poke, and the unit of the layout.",
            )
        units = replace(solution.units, layout=units.layout.spaced(spacing.found))
        begun = None if start is None else fitted(units.layout, start.positions, surface)
        solution = solve(pokes, units, priors, start=begun, deviations=deviations)
    if solution.noise > ASTRAY:
        raise InputError(
            f"torques are off by {solution.noise:.0f} times what noise explains, wherever the taxels are.",
            where="pokes",
            hint="Check axes, signs and units of the wrench, and the link's frame in the sensor's.",
        )
    left = validated(pokes, solution, priors, start=begun, deviations=deviations)
    solution = replace(solution, covariance=left.widening * solution.covariance)
    spacing = _spacing(stated, solution, left.widening) if modules else None
    places, size = _placed(pokes, solution), size_deviation(solution.units, solution.covariance)
    if spacing is not None:
        places, doubts = _scaled(places, solution, spacing), spacing.warnings("the pokes")
    nuisances = {name: getattr(solution.nuisances, name) for name in ("frames", "common", "bias", "cross_talk")}
    used = int(np.count_nonzero(solution.weight > 0))
    doubts = (*renumbered, *doubts, *_doubts(pokes, solution), *left.notes)
    if start is not None and modules:
        doubts = (*doubts, *moved_far(units.layout, start.positions, places.positions))
    if start is not None and surface is not None:
        doubts = (*doubts, *_beside(start, surface, priors.start))
    return TaxelCalibration(places, used, solution.noise, nuisances, left, spacing, size, _untouched(places), doubts)


def _beside(start: TaxelPlaces, surface: Surface, deviation: float) -> tuple[str, ...]:
    """Return a warning, or (), if the expected places are not on the surface, within their deviation [m]."""
    known = start.positions[np.isfinite(start.positions).all(axis=1)]
    off = float(np.median(np.linalg.norm(surface.project(known)[0] - known, axis=1))) if len(known) else 0.0
    if not off > deviation:
        return ()
    return (
        f"the expected places (start) are {1e3 * off:.2g} mm from the surface (median), and taxels are taken to lie on "
        "it: check that the mesh is this link's, with its cover, and in the frame of the start",
    )


def _spacing(stated: float, solution: PlacesSolution, widening: float = 1.0) -> Spacing:
    """Return the spacing that a solution shows, and the one that it has."""
    used, (scale, deviation) = solution.units.layout.spacing, solution.scale
    return Spacing(stated, scale * used, float(np.sqrt(widening)) * deviation * used, used)


def _scaled(places: TaxelPlaces, solution: PlacesSolution, spacing: Spacing) -> TaxelPlaces:
    """Return places whose covariance includes that of a spacing that was found."""
    if spacing.used == spacing.stated:
        return places
    along = spacing.deviation / spacing.used * by_scale(solution.units)
    covariance = places.covariance + np.einsum("ki,kj->kij", along, along)
    return replace(places, covariance=covariance, relative=np.sqrt(places.relative**2 + (along**2).sum(axis=1)))


def _guessed(
    pokes: Pokes, surface: Surface | None
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """Return places by the paper's method, outward directions, and the weight of each place."""
    equations = paper.normal_equations(pokes, weighted=True)
    points = paper.free(equations) if surface is None else paper.on_surface(equations, surface)
    return points, -equations.pressing, equations.weight


def _facing(normals: Float[np.ndarray, "k 3"], outward: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Return normals where known, else outward; where neither is, the sum of the others."""
    found = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, outward)
    return np.where(
        np.abs(found).max(axis=1, keepdims=True) > 0, found, found.sum(axis=0) + np.array([0.0, 0.0, 1e-12])
    )


def _few(layout: ModuleLayout, points: Float[np.ndarray, "k 3"]) -> list[str]:
    """Return the numbers of the modules on which too few taxels have a place."""
    count = np.bincount(layout.module[placed(layout, points)], minlength=layout.modules)
    return list(map(str, np.flatnonzero(count < FEWEST).tolist()))


def _numbered(
    layout: ModuleLayout,
    start: TaxelPlaces | None,
    points: Float[np.ndarray, "k 3"],
    outward: Float[np.ndarray, "k 3"],
    weight: Float[np.ndarray, " k"],
) -> tuple[ModuleLayout, TaxelPlaces | None, list[str]]:
    """Return layout and start in the numbering of the readings, and warnings where it is not the stated one.

    The layout is compared with the start, and then both with places by the paper's method.

    Raises:
        InputError: the layout is mirrored, which no numbering explains.
    """
    said = list[str]()
    if start is not None:
        facing = np.where(np.isfinite(start.normals).all(axis=1, keepdims=True), start.normals, outward)
        found = _unmirrored(found_numbering(layout, start.positions, facing))
        if found is not None and found.clear:
            layout = found.of(layout)
            said.append(f"the start contradicts the layout's numbers: its taxels {found}; modules are numbered like it")
    expected = None if start is None else start.positions
    found = _unmirrored(found_numbering(layout, points, outward, weight, start=expected))
    if found is None:
        return layout, start, said
    whose = "the layout's" if start is None else "the layout's and the start's"
    if not found.clear:
        said.append(
            f"the pokes do not show {whose} numbers for sure, which are used: taxels might {found}; poke more to be "
            "sure"
        )
        return layout, start, said
    if start is not None:
        start = replace(start, positions=start.positions[found.order], normals=start.normals[found.order])
    said.append(f"the pokes contradict {whose} numbers: taxels {found}; modules are numbered as they answer")
    return found.of(layout), start, said


def _unmirrored(found: Numbering | None) -> Numbering | None:
    """Return a numbering; raise an InputError if the layout is mirrored."""
    if found is not None and found.mirrored and found.clear:
        raise InputError(
            f"the layout of the modules is mirrored: taxels are {1e3 * found.stated:.1f} mm from it (rms), and "
            f"{1e3 * found.rms:.1f} mm from the same seen from the other side.",
            where="layout",
            hint="Layouts are seen from outside: change the sign of one of their coordinates.",
        )
    return found


def _placed(pokes: Pokes, solution: PlacesSolution) -> TaxelPlaces:
    units = solution.units
    points, normals = units.places
    absolute, relative = spreads(units, solution.covariance)
    module = np.where(np.isfinite(points).all(axis=1), -1 if units.alone else units.layout.module, -1)
    noise = np.sqrt(np.diag(pokes.noise)) * solution.noise
    reach = np.nan if solution.response is None else solution.response.reach
    return TaxelPlaces(points, normals, absolute, module, pokes.counts(), relative, reach, _poses(pokes), noise)


def _poses(pokes: Pokes) -> Float[np.ndarray, "d 8"]:
    found = list[np.ndarray]()
    for number in range(pokes.configurations):
        rows = np.flatnonzero((pokes.configuration == number) & (pokes.weight > 0))
        if len(rows):
            middle = rows[len(rows) // 2]
            found.append(np.r_[pokes.origin[middle], quaternion_from_rotation(pokes.rotation[middle]), len(rows)])
    return np.array(found).reshape(-1, 8)


def spreads(
    units: Units, covariance: Float[np.ndarray, "p p"]
) -> tuple[Float[np.ndarray, "k 3 3"], Float[np.ndarray, " k"]]:
    """Return covariances (k, 3, 3) [m^2] of taxels, and standard deviations (k,) [m] without one rigid motion of all.

    Both are NaN for taxels without a place.
    """
    rows, size = units.taxels, units.freedom
    points, by = units.places[0][rows], units.jacobian[rows]
    unit = units.layout.module[rows]
    known = covariance[: len(units) * size, : len(units) * size]
    blocks = known.reshape(len(units), size, len(units), size)[unit, :, unit, :]
    absolute = np.full((len(units.layout), 3, 3), np.nan)
    absolute[rows] = np.einsum("kif,kfg,kjg->kij", by, blocks, by)
    relative = np.full(len(units.layout), np.nan)
    away = points - points.mean(axis=0)
    turn = np.stack([np.cross(axis, away) for axis in np.eye(3)], axis=2)
    rigid = np.concatenate([np.tile(np.eye(3), (len(rows), 1, 1)), turn / max(np.abs(away).max(), 1e-9)], axis=2)
    basis = np.linalg.qr(rigid.reshape(-1, 6))[0].reshape(-1, 3, 6)
    # with F the derivatives, K the covariance and B the basis: the diagonal of (1 - B B') F K F' (1 - B B')
    moved = np.zeros((len(units), 6, size))
    np.add.at(moved, unit, np.einsum("kia,kif->kaf", basis, by))
    moved = np.moveaxis(moved, 1, 0).reshape(6, -1)  # B' F
    both = moved @ known
    own = np.einsum("afk,kif->kia", both.reshape(6, len(units), size)[:, unit].transpose(0, 2, 1), by)
    square = np.trace(absolute[rows], axis1=1, axis2=2) - 2.0 * np.einsum("kia,kia->k", basis, own)
    square += np.einsum("kia,ab,kib->k", basis, both @ moved.T, basis)
    relative[rows] = np.sqrt(square.clip(0.0))
    return absolute, relative


@takes_arrays
def size_deviation(units: Units, covariance: Float[np.ndarray, "p p"]) -> float:
    """Return the standard deviation of the factor by which all places grow about their mean.

    Args:
        units: modules or single taxels, as placed.
        covariance: (p, p) of their unknowns, then of others.

    Raises:
        InputError: covariance has another shape.
    """
    rows, size = units.taxels, units.freedom
    away = units.places[0][rows] - units.places[0][rows].mean(axis=0)
    along = np.zeros((len(units), size))
    share = away / max(float((away**2).sum()), 1e-300)
    np.add.at(along, units.layout.module[rows], np.einsum("kc,kcf->kf", share, units.jacobian[rows]))
    return float(np.sqrt(along.ravel() @ covariance[: along.size, : along.size] @ along.ravel()))


def _untouched(places: TaxelPlaces) -> tuple[str, ...]:
    rows = np.flatnonzero((places.pokes == 0) & (places.there | (places.module < 0))).tolist()
    if not rows:
        return ()
    listed = ", ".join(map(str, rows[:NAMED])) + (", ..." if len(rows) > NAMED else "")
    what = "they are placed by their modules" if places.there[rows].any() else "they have no place"
    return (f"{len(rows)} of {len(places)} taxels never answered, {what}: {listed}",)


def _doubts(pokes: Pokes, solution: PlacesSolution) -> tuple[str, ...]:
    said = list[str]()
    if pokes.configurations < 2:
        said.append(f"{ALONE}; their places relative to each other are not affected")
    if solution.noise > NOISIER:
        said.append(
            f"torques are off by {solution.noise:.1f} times what noise explains: check that one tip touched at a "
            "time, the link's frame, the surface and the layout of the modules"
        )
    return tuple(said)
