"""Find how the taxels of modules are numbered, from places that are known roughly.

Of a module's taxels a on the layout and b in the plane seen from outside, as complex numbers about their middles, the
best turn and one scale for all modules leave the share 1 - (sum |a* b|)^2 / (sum |a|^2 sum |b|^2) of the squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.poking.rigid_groups import frame_about, placed
from palpate.spatial.arguments import takes_arrays

__all__ = ["Numbering", "found_numbering"]

CLEAR = 0.8  # of the squares that the stated numbering leaves: 0.89 at least the other way round, if it is right
ALIKE = 0.99  # of the squares: numberings that differ by less are the same on a symmetric module
FEWEST, TELLING = 3, 5  # taxels of a module with a place, and taxels of a module that has an order

Vectors = Float[np.ndarray, "k 3"]


@takes_arrays
@dataclass(frozen=True, eq=False)
class Numbering:
    """A numbering of modules that fits their taxels better than the one stated.

    Attributes:
        order: (k,) the taxel whose stated place each taxel has.
        first: index in its module of the first taxel's; backwards: the others follow downwards.
        mirrored: the layout also has to be seen from the other side.
        rms: [m] of the distances that are left; stated: [m] of those that the stated numbering leaves.
    """

    order: Int[np.ndarray, " k"]
    first: int
    backwards: bool
    mirrored: bool
    rms: float
    stated: float

    def of(self, layout: ModuleLayout) -> ModuleLayout:
        """Return the `ModuleLayout` in this numbering."""
        return ModuleLayout(layout.places[self.order], layout.module)

    def __str__(self) -> str:
        way = "backwards" if self.backwards else "forwards"
        return (
            f"begin at number {self.first} of a module and run {way}: so they fit to {1e3 * self.rms:.1f} mm (rms), "
            f"and as stated to {1e3 * self.stated:.1f} mm"
        )


@takes_arrays
def found_numbering(
    layout: ModuleLayout,
    places: Vectors,
    outward: Vectors,
    weights: Float[np.ndarray, " k"] | None = None,
    *,
    start: Vectors | None = None,
) -> Numbering | None:
    """Return the `Numbering` of modules that fits places clearly better than the layout's; None: there is none.

    The numbers of all modules may begin at another taxel, run backwards, or be those of the mirrored layout. Without
    normals a mirrored layout cannot be told.

    Args:
        layout: as stated.
        places: (k, 3) [m] of the taxels, NaN if not known.
        outward: (k, 3) normals of any length, NaN or 0 if not known.
        weights: (k,) of the places; None: equal.
        start: (k, 3) [m] expected places in the layout's numbers, which choose between numberings that are alike on a
            symmetric module; None: the lowest first number.
    """
    known = placed(layout, places)
    share = np.where(known, 1.0 if weights is None else np.maximum(weights, 0.0), 0.0)
    count = np.bincount(layout.module[share > 0], minlength=layout.modules)
    share = np.where((layout.module >= 0) & (count[layout.module] >= FEWEST), share, 0.0)
    rows, length = _rows(layout), float(share.sum())
    if not length:
        return None
    seen, sided = _seen(layout, places, outward, share)
    flat = np.nan_to_num(layout.places @ np.array([1.0, 1.0j]))
    if len(rows[0]) >= TELLING and len({*map(len, rows)}) == 1:
        block, size = np.stack(rows), len(rows[0])
        turns = [(first, step) for step in (1, -1) for first in range(size)]
    else:
        block, turns = None, [(0, 1)]
    found = list[tuple[float, tuple[int, int, bool], Int[np.ndarray, " k"]]]()
    for mirrored in (False, True) if sided.any() else (False,):
        for first, step in turns:
            order = np.arange(len(layout))
            if block is not None:
                order[block] = block[:, (first + step * np.arange(block.shape[1])) % block.shape[1]]
            shape = flat[order].conj() if mirrored else flat[order]
            found.append((_left(shape, seen, share, layout.module, sided), (first, step, mirrored), order))
    least = min(left for left, _, _ in found)
    alike = [one for one in found if ALIKE * one[0] <= least + 1e-9]
    alike = [one for one in alike if one[1][2] == alike[0][1][2]]

    def off(order: Int[np.ndarray, " k"]) -> float:
        return 0.0 if start is None else _off(start[order], places, share, layout.module)

    left, (first, step, mirrored), order = min(alike, key=lambda one: off(one[2]))
    stated = found[0][0]
    if left >= CLEAR * stated:
        if off(order) >= CLEAR * off(found[0][2]):
            return None
        return Numbering(
            order, first, step < 0, mirrored, *((off(each) / length) ** 0.5 for each in (order, found[0][2]))
        )
    spread = _spread(seen, share, layout.module)
    return Numbering(
        order, first, step < 0, mirrored, *(float((part * spread / length) ** 0.5) for part in (left, stated))
    )


def _rows(layout: ModuleLayout) -> list[Int[np.ndarray, " t"]]:
    there = np.isfinite(layout.places).all(axis=1)
    return [np.flatnonzero((layout.module == number) & there) for number in range(layout.modules)]


def _seen(
    layout: ModuleLayout, places: Vectors, outward: Vectors, share: Float[np.ndarray, " k"]
) -> tuple[Complex[np.ndarray, " k"], Bool[np.ndarray, " m"]]:
    """Return taxels in the plane of their module, seen from outside, and whether the outside of each is known."""
    seen, sided = np.zeros(len(layout), dtype=np.complex128), np.zeros(layout.modules, dtype=bool)
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    unit = np.divide(outward, length, out=np.zeros_like(outward), where=length > 0)
    for number in range(layout.modules):
        rows = np.flatnonzero((layout.module == number) & (share > 0))
        if not len(rows):
            continue
        normal = share[rows] @ unit[rows]
        sided[number] = bool(np.linalg.norm(normal) > 0)
        away = places[rows] - places[rows].mean(axis=0)
        normal = normal if sided[number] else np.linalg.svd(away, full_matrices=True)[2][2]
        frame = frame_about(normal[None], np.array([[1.0, 0.0, 0.0]]))[0]
        seen[rows] = away @ frame[:, :2] @ np.array([1.0, 1.0j])
    return seen, sided


def _left(
    flat: Complex[np.ndarray, " k"],
    seen: Complex[np.ndarray, " k"],
    share: Float[np.ndarray, " k"],
    module: Int[np.ndarray, " k"],
    sided: Bool[np.ndarray, " m"],
) -> float:
    """Return the share of the squares of seen places that a layout leaves; without a side the better one counts."""
    here = share > 0
    number, weight, a, b = module[here], share[here], flat[here], seen[here]
    each = np.bincount(number, weight, len(sided))
    each[each == 0] = 1.0

    def summed(values: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, " m"]:
        return np.bincount(number, weight * values.real, len(sided)) + 1j * np.bincount(
            number, weight * values.imag, len(sided)
        )

    a, b = a - (summed(a) / each)[number], b - (summed(b) / each)[number]
    same, other = np.abs(summed(a.conj() * b)), np.abs(summed(a * b))
    both = float(np.where(sided, same, np.maximum(same, other)).sum())
    squares = float(weight @ np.abs(a) ** 2) * float(weight @ np.abs(b) ** 2)
    return 1.0 - both**2 / squares if squares > 0 else 1.0


def _off(start: Vectors, places: Vectors, share: Float[np.ndarray, " k"], module: Int[np.ndarray, " k"]) -> float:
    """Return the weighted sum of squares [m^2] of places from expected ones, about the middles of their modules."""
    total = 0.0
    for number in np.unique(module[share > 0]):
        rows = (module == number) & (share > 0) & np.isfinite(start).all(axis=1)
        if rows.any():
            away = places[rows] - start[rows]
            away = away - np.average(away, axis=0, weights=share[rows])
            total += float(share[rows] @ np.sum(away**2, axis=1))
    return total


def _spread(seen: Complex[np.ndarray, " k"], share: Float[np.ndarray, " k"], module: Int[np.ndarray, " k"]) -> float:
    """Return the weighted sum of squares [m^2] of seen places about the middles of their modules."""
    total = 0.0
    for number in np.unique(module[share > 0]):
        rows = (module == number) & (share > 0)
        away = seen[rows] - np.average(seen[rows], weights=share[rows])
        total += float(share[rows] @ np.abs(away) ** 2)
    return total
