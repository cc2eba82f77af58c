"""Fit rigid modules to known places of taxels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.calibrate import TaxelCalibration
from palpate.sensors.taxels.poking.moved_modules import moved_far
from palpate.sensors.taxels.poking.numbering import Numbering, found_numbering
from palpate.sensors.taxels.poking.rigid_groups import Units, fitted
from palpate.sensors.taxels.poking.spacing import Spacing, scale_in_places
from palpate.surfaces.surface import Surface

_ROUNDS = 20  # of turning modules onto their mean
FEWEST = 3  # taxels of a module


def common_layout(places: TaxelPlaces, surface: Surface | None = None, *, spacing: float | None = None) -> ModuleLayout:
    """Return a `ModuleLayout` common to all modules: the mean of their flat places, turned onto each other.

    Args:
        places: places on equal modules, with as many indices each.
        surface: gives the outward side where the places do not.
        spacing: [m] to which the mean distance of consecutive taxels is scaled; None: not scaled.

    Raises:
        InputError: modules of different sizes, or none.
    """
    own = ModuleLayout.of(_outward(places, surface))
    size = int(np.bincount(own.module[own.module >= 0], minlength=1).max())
    slots = np.arange(len(places)).reshape(-1, size) if size and len(places) % size == 0 else np.zeros((0, 1), np.int64)
    slots = slots[(own.module[slots] >= 0).any(axis=1)]
    alike = own.module[slots].max(axis=1, keepdims=True, initial=-1)
    if not len(slots) or ((own.module[slots] != alike) & (own.module[slots] >= 0)).any():
        raise InputError(
            "a common layout needs modules with equal numbers of taxels, numbered one after the other.", where="layout"
        )
    flat = own.places[slots]
    whole = flat[np.isfinite(flat).all(axis=(1, 2))]
    mean = _mean(whole if len(whole) else flat)
    if spacing is not None:
        mean = mean * spacing / np.linalg.norm(mean - np.roll(mean, 1, axis=0), axis=1).mean()
    found = np.full((len(places), 2), np.nan)
    found[slots] = np.where((own.module[slots] >= 0)[..., None], mean, np.nan)
    return ModuleLayout(found, own.module)


def _mean(flat: Float[np.ndarray, "m t 2"]) -> Float[np.ndarray, "t 2"]:
    """Return the mean of modules that are turned onto it."""
    mean = flat[0]
    for _ in range(_ROUNDS):
        both = np.einsum("mta,tb->mab", flat, mean)
        angle = np.arctan2(both[:, 0, 1] - both[:, 1, 0], both[:, 0, 0] + both[:, 1, 1])
        turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
        mean = np.einsum("mab,mtb->mta", turn, flat).mean(axis=0)
    return mean


def place_modules(
    places: TaxelPlaces,
    layout: ModuleLayout | None = None,
    surface: Surface | None = None,
    *,
    rescale: bool = False,
) -> TaxelCalibration:
    """Fit modules to the places of their taxels; return the new places, without covariance, in a `TaxelCalibration`.

    Where the places contradict the layout's numbers or its handedness, it is fitted as they say, with a warning.

    Args:
        places: expected places of the taxels, with the module of each.
        layout: of the modules; None: `common_layout` of the places.
        surface: of the link, on which modules are bent; None: they are flat.
        rescale: lay modules with the spacing that the places show, where it contradicts the layout's.

    Raises:
        InputError: a layout of another skin, a module with fewer than three taxels, or no layout and unequal modules.
    """
    known = _outward(places, surface)
    layout = common_layout(known, surface) if layout is None else layout
    if len(layout) != len(places):
        raise InputError(
            f"the layout has {len(layout)} taxels, but there are {len(places)} places: it belongs to another skin.",
            where="layout",
        )
    usable = places.there & (layout.module >= 0)
    count = np.bincount(layout.module[usable], minlength=layout.modules)
    if not len(count) or count.min() < FEWEST:
        few = ", ".join(map(str, np.flatnonzero(count < FEWEST).tolist()))
        raise InputError(
            f"modules {few} have fewer than {FEWEST} taxels with a place, which is too few.", where="places"
        )
    numbering = found_numbering(layout, places.positions, known.normals)
    layout = numbering.of(layout) if numbering is not None and numbering.clear else layout
    stated, units = layout.spacing, fitted(layout, places.positions, surface)
    spacing = _spacing(stated, units, places)
    if rescale and spacing.contradicted and spacing.found > 0:
        layout = layout.spaced(spacing.found)
        units, spacing = fitted(layout, places.positions, surface), replace(spacing, used=spacing.found)
    points, normals = units.places
    points = np.where(places.there[:, None], points, np.nan)
    away = np.linalg.norm(points - places.positions, axis=1)
    made = replace(
        places,
        positions=points,
        normals=np.where(np.isfinite(points), normals, np.nan),
        covariance=np.full((len(places), 3, 3), np.nan),
        relative=np.full(len(places), np.nan),
        module=np.where(np.isfinite(points).all(axis=1), layout.module, -1),
    )
    said = f"taxels moved by {1e3 * np.nanmean(away):.2f} mm on average, {1e3 * np.nanmax(away):.2f} mm at most"
    doubts = (
        *(() if numbering is None else (_contradicted(numbering),)),
        *spacing.warnings("the places"),
        *moved_far(layout, places.positions, points),
        *(() if surface is not None else (_unsupported(layout, places),)),
    )
    return TaxelCalibration(made, 0, 1.0, spacing=spacing, notes=(said,), warnings=doubts)


def _spacing(stated: float, units: Units, places: TaxelPlaces) -> Spacing:
    """Return the spacing that places show, and the one of modules fitted to them.

    Flat modules are fitted to both, so that what a bend shortens cancels.
    """
    laid = np.where(places.there[:, None], units.places[0], np.nan)
    (found, deviation), (bent, _) = (
        scale_in_places(fitted(units.layout, each, None), each) for each in (places.positions, laid)
    )
    return Spacing(stated, stated * found / bent, stated * deviation / bent, stated)


def _contradicted(numbering: Numbering) -> str:
    """Return a warning that the places contradict the layout, or cast doubt on it."""
    whose = "handedness: seen from the other side its taxels" if numbering.mirrored else "numbers: its taxels"
    if numbering.clear:
        return f"the places contradict the layout's {whose} {numbering}; they are laid like that"
    return f"the places do not show for sure the layout's {whose} might {numbering}; they are laid as stated"


def _unsupported(layout: ModuleLayout, places: TaxelPlaces) -> str:
    """Return a warning with the error (rms) of each taxel's place, as predicted from the rest of its module."""
    usable = np.flatnonzero(places.there & (layout.module >= 0))
    order = np.zeros(len(layout), dtype=np.int64)
    for number in range(layout.modules):
        rows = usable[layout.module[usable] == number]
        order[rows] = np.arange(len(rows))
    error = np.full(len(layout), np.nan)
    for turn in range(int(order.max()) + 1):
        left = usable[(order[usable] == turn) & (np.bincount(layout.module[usable])[layout.module[usable]] > FEWEST)]
        weights = np.ones(len(layout))
        weights[left] = 0.0
        found = fitted(layout, places.positions, None, weights).places[0]
        error[left] = np.linalg.norm(found[left] - places.positions[left], axis=1)
    rms = 1e3 * float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else np.nan
    return (
        f"there is no surface: modules are laid flat and free in space, and left-out taxels are {rms:.2f} mm (rms) "
        "from where the rest of their module predicts them. If the places are known better than that, laying makes "
        "them worse: add the link's mesh as [surface], or keep the places as they are"
    )


def _outward(places: TaxelPlaces, surface: Surface | None) -> TaxelPlaces:
    """Return places with the surface's normals where they have none."""
    rows = places.there & ~np.isfinite(places.normals).all(axis=1)
    if surface is None or not rows.any():
        return places
    normals: Float[np.ndarray, "k 3"] = places.normals.copy()
    normals[rows] = surface.project(places.positions[rows])[1]
    return replace(places, normals=normals)
