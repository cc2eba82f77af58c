"""Find how the taxels of modules are numbered, from places that are known roughly.

Of a module's taxels a on the layout and b in the plane seen from outside, as complex numbers about their middles, the
best turn and one scale for all modules leave the share 1 - (sum |a* b|)^2 / (sum |a|^2 sum |b|^2) of the squares.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.poking.rigid_groups import frame_about, placed
from palpate.spatial.arguments import frozen_value, takes_arrays

CLEAR = 6.0  # n log(squares of the next numbering / squares): of 220 sessions of 60 to 200 pokes wrong ones reach 4.5
TURNED = 0.8  # of the squares about a start, for numberings that are one but for turns of the modules
SAME = 0.01  # of the squares between two numberings of a layout that are one: of a symmetric module
FEWEST, TELLING = 3, 5  # taxels of a module with a place, and taxels of a module that has an order

Vectors = Float[np.ndarray, "k 3"]


@frozen_value
class Numbering:
    """A numbering of modules other than the one stated.

    Attributes:
        order: (k,) the taxel whose stated place each taxel has.
        first: index in its module of the first taxel's; backwards: the others follow downwards.
        mirrored: the layout also has to be seen from the other side.
        rms: [m] of the distances that are left; stated: [m] of those that the stated numbering leaves.
        clear: whether it is the only one that fits; else it is the best besides the stated one.
    """

    order: Int[np.ndarray, " k"]
    first: int
    backwards: bool
    mirrored: bool
    rms: float = nan
    stated: float = nan
    clear: bool = False

    def of(self, layout: ModuleLayout) -> ModuleLayout:
        """Return the `ModuleLayout` in this numbering, and mirrored if it has to be."""
        return ModuleLayout(layout.places[self.order] * [1.0, -1.0 if self.mirrored else 1.0], layout.module)

    def __str__(self) -> str:
        way = ("backwards" if self.backwards else "forwards") + (" on the mirrored layout" if self.mirrored else "")
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
    """Return the `Numbering` of modules that places show, clearly or not; None: they show the stated one.

    The numbers of all modules may begin at another taxel, run backwards, or be those of the mirrored layout. Without
    normals a mirrored layout cannot be told. With the squares S that it leaves and S' of the next one, a numbering is
    clear if n log(S' / S) > 6, for n = (sum w)^2 / sum w^2 places of weights w. If none is clear, the best one besides
    the stated is returned.

    Args:
        layout: as stated.
        places: (k, 3) [m] of the taxels, NaN if not known.
        outward: (k, 3) normals of any length, NaN or 0 if not known.
        weights: (k,) of the places; None: equal.
        start: (k, 3) [m] expected places in the layout's numbers, which choose between numberings that are alike on a
            symmetric module; None: the lowest first number.
    """
    share = _shares(layout, places, weights)
    total = float(share.sum())
    if not total:
        return None
    seen, sided = _seen(layout, places, outward, share)
    flat = np.nan_to_num(layout.places @ np.array([1.0, 1.0j]))
    ways, module = _ways(layout, both=bool(sided.any())), layout.module
    laid = [flat[way.order].conj() if way.mirrored else flat[way.order] for way in ways]
    left = np.array([round(_left(each, seen, share, module, sided), 9) for each in laid])
    count = total**2 / float(share @ share)
    kind = _kinds(laid, layout, sided)
    if not kind.any():
        return None
    off = left if start is None else _off(ways, places, start, share, module)
    best, sure = _best(left, kind, count)
    placed_best, placed_sure = _best(off, np.arange(len(ways)) if start is not None else kind, count)
    if placed_sure and not sure:
        best, sure = placed_best, True
    elif placed_sure and kind[placed_best] != kind[best]:
        sure = False
    if not sure:
        best = min(np.flatnonzero(kind != kind[0]).tolist(), key=lambda k: left[k])
    same = np.flatnonzero(kind == kind[best]).tolist()
    best = min((k for k in same if ways[k].mirrored == ways[same[0]].mirrored), key=lambda k: off[k])
    if sure and kind[best] == kind[0] and (start is None or off[best] >= TURNED * off[0]):
        return None
    turned = kind[best] == kind[0]
    squares = off[[best, 0]] if turned else left[[best, 0]] * _squares(seen[:, None], share, module)
    rms, stated = np.sqrt(squares / total).tolist()
    return replace(ways[best], rms=rms, stated=stated, clear=sure)


def _best(left: Float[np.ndarray, " w"], kind: Int[np.ndarray, " w"], count: float) -> tuple[int, bool]:
    """Return the numbering that leaves least, the first of equals, and whether it is clear with `count` places."""
    best = int(np.argmin(left))
    other = float(left[kind != kind[best]].min(initial=np.inf))
    return best, bool(count * np.log(other / max(float(left[best]), 1e-12 * other, 1e-300)) > CLEAR)


def _kinds(
    laid: list[Complex[np.ndarray, " k"]], layout: ModuleLayout, sided: Bool[np.ndarray, " m"]
) -> Int[np.ndarray, " w"]:
    """Return the kind (w,) of each numbering, 0 for the stated one: those of a kind differ by turns of the modules.

    Modules without a known outside (`sided` (m,) false) may also be turned over.
    """
    there = ((layout.module >= 0) & np.isfinite(layout.places).all(axis=1)).astype(np.float64)
    kinds, found = list[Complex[np.ndarray, " k"]](), list[int]()
    for each in laid:
        alike = [k for k, other in enumerate(kinds) if _left(each, other, there, layout.module, sided) < SAME]
        found.append(alike[0] if alike else len(kinds))
        if not alike:
            kinds.append(each)
    return np.array(found)


def _off(
    ways: list[Numbering],
    places: Vectors,
    start: Vectors,
    share: Float[np.ndarray, " k"],
    module: Int[np.ndarray, " k"],
) -> Float[np.ndarray, " w"]:
    """Return the squares [m^2] (w,) between places and a start in each numbering; inf for mirrored ones."""
    return np.array([np.inf if way.mirrored else _squares(places - start[way.order], share, module) for way in ways])


def _shares(layout: ModuleLayout, places: Vectors, weights: Float[np.ndarray, " k"] | None) -> Float[np.ndarray, " k"]:
    """Return the weight of each place; 0 if it is not known, or too few are of its module."""
    share = np.where(placed(layout, places), 1.0 if weights is None else np.maximum(weights, 0.0), 0.0)
    count = np.bincount(layout.module[share > 0], minlength=layout.modules)
    enough = np.zeros(len(layout), dtype=bool)
    enough[share > 0] = count[layout.module[share > 0]] >= FEWEST
    return np.where(enough, share, 0.0)


def _ways(layout: ModuleLayout, *, both: bool) -> list[Numbering]:
    """Return all numberings, as stated first; `both`: also of the mirrored layout."""
    rows, turns, block = _rows(layout), [(0, 1)], None
    if len(rows[0]) >= TELLING and len({*map(len, rows)}) == 1:
        block = np.stack(rows)
        turns = [(first, step) for step in (1, -1) for first in range(block.shape[1])]
    found = list[Numbering]()
    for mirrored in (False, True) if both else (False,):
        for first, step in turns:
            order = np.arange(len(layout))
            if block is not None:
                order[block] = block[:, (first + step * np.arange(block.shape[1])) % block.shape[1]]
            found.append(Numbering(order, first, step < 0, mirrored))
    return found


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
        real, imaginary = weight * np.real(values), weight * np.imag(values)
        return np.bincount(number, real, len(sided)) + 1j * np.bincount(number, imaginary, len(sided))

    a, b = a - (summed(a) / each)[number], b - (summed(b) / each)[number]
    same, other = np.abs(summed(a.conj() * b)), np.abs(summed(a * b))
    both = float(np.where(sided, same, np.maximum(same, other)).sum())
    squares = float(weight @ np.abs(a) ** 2) * float(weight @ np.abs(b) ** 2)
    return 1.0 - both**2 / squares if squares > 0 else 1.0


def _squares(away: np.ndarray, share: Float[np.ndarray, " k"], module: Int[np.ndarray, " k"]) -> float:
    """Return the weighted sum of squares [m^2] of vectors (k, d) about the mean of their module; NaN are left out."""
    total, there = 0.0, (share > 0) & np.isfinite(away).all(axis=1)
    for number in np.unique(module[there]):
        rows = there & (module == number)
        from_mean = away[rows] - np.average(away[rows], axis=0, weights=share[rows])
        total += float(share[rows] @ np.sum(np.abs(from_mean) ** 2, axis=1))
    return total
