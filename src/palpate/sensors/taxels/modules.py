"""Describe rigid modules of taxels by the places of taxels on flat modules."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value

_SPACING = 6.533e-3  # m, between neighbours of the lattice of iCub's later triangles
_TELLING, _ROUNDS = 6, 3  # taxels that say how a module is bent; turns until its middle is level
_STEP = 6.0e-3  # m, between neighbours along the edge of its earlier ones
_MOST = 10_000  # modules of a skin


@frozen_value
class ModuleLayout(Value):
    """Flat places of k taxels on their modules.

    Attributes:
        places: (k, 2) [m] in the plane of each taxel's module, about its middle; NaN for an index without a taxel.
        module: (k,) index of each taxel's module; -1: none.

    Raises:
        InputError: places are not (k, 2), or `module` is not of k taxels.
    """

    places: Float[np.ndarray, "k 2"]
    module: Int[np.ndarray, " k"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, tail=(2,), name="places"))
        module = np.array(self.module, dtype=np.int64)
        module.flags.writeable = False
        object.__setattr__(self, "module", module)
        if len(module) != len(self.places):
            raise InputError(
                f"{len(self.places)} places need {len(self.places)} module numbers, not {len(module)}.", where="layout"
            )

    def __len__(self) -> int:
        return len(self.places)

    @property
    def modules(self) -> int:
        """Return one more than the largest index of a module."""
        return int(self.module.max(initial=-1)) + 1

    @classmethod
    def repeated(cls, places: Float[np.ndarray, "t 2"], modules: int) -> ModuleLayout:
        """Return the `ModuleLayout` of equal modules with taxel places (t, 2) [m], numbered one after the other.

        Raises:
            InputError: a number of modules that is negative or above 10,000.
        """
        if not 0 <= modules <= _MOST:
            raise InputError(f"modules must be from 0 to {_MOST:,}, not {modules}.")
        return cls(np.tile(places, (modules, 1)), np.repeat(np.arange(modules), len(places)))

    @classmethod
    def of(cls, places: TaxelPlaces, *, bent: bool = False) -> ModuleLayout:
        """Return the `ModuleLayout` of taxel places, each module laid into the plane that fits it best.

        It is seen from the side of the normals, or of z where they are not known.

        Args:
            places: places of taxels with modules.
            bent: flatten modules that are bent as their link is, instead of projecting them.
        """
        flat = np.full((len(places), 2), np.nan)
        module = np.where(places.there, places.module, -1)
        for number in np.unique(module[module >= 0]):
            rows = np.flatnonzero(module == number)
            away = places.positions[rows] - places.positions[rows].mean(axis=0)
            outward = np.nan_to_num(places.normals[rows]).sum(axis=0)
            outward = outward if outward.any() else np.array([0.0, 0.0, 1.0])
            axes = np.linalg.svd(away, full_matrices=True)[2]
            axes[2] *= np.sign(axes[2] @ outward) or 1.0
            axes[1] = np.cross(axes[2], axes[0])
            flat[rows] = _unbent(away, axes) if bent and len(rows) >= _TELLING else away @ axes[:2].T
        return cls(flat, module)

    @property
    def spacing(self) -> float:
        """Return the mean distance [m] of taxels from the nearest one of their module; 0.0 without two on a module."""
        near = list[float]()
        for number in range(self.modules):
            rows = (self.module == number) & np.isfinite(self.places).all(axis=1)
            gaps = np.linalg.norm(self.places[rows, None] - self.places[rows], axis=2)
            near += gaps[~np.eye(len(gaps), dtype=bool)].reshape(len(gaps), -1).min(axis=1, initial=np.inf).tolist()
        return float(np.mean([gap for gap in near if np.isfinite(gap)] or [0.0]))

    def spaced(self, spacing: float) -> ModuleLayout:
        """Return the `ModuleLayout` scaled to a `spacing` [m].

        Raises:
            InputError: a spacing that is not positive and finite, or no module with two taxels at different places.
        """
        mean = self.spacing
        if not (0 < spacing < np.inf and mean > 0):
            raise InputError(f"a layout cannot be scaled to a spacing of {spacing:g} m.", where="spacing")
        return ModuleLayout(self.places * (spacing / mean), self.module)


def _unbent(away: Float[np.ndarray, "t 3"], axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "t 2"]:
    """Return flat places p + (p' K p) K p / 6 of points on a bent sheet of curvature K, to fourth order."""
    for _ in range(_ROUNDS):  # until the third axis is normal to the sheet in the middle
        lean, _ = _bend(away @ axes.T)
        outward: Float[np.ndarray, "3"] = axes[2] - lean @ axes[:2]
        along: Float[np.ndarray, "3"] = axes[0] - (axes[0] @ outward) / (outward @ outward) * outward
        frame = np.stack([along, np.cross(outward, along), outward])
        axes = frame / np.linalg.norm(frame, axis=1, keepdims=True)
    flat = away @ axes[:2].T
    pull = flat @ _bend(away @ axes.T)[1]
    return flat + (flat * pull).sum(axis=1, keepdims=True) * pull / 6.0


def _bend(points: Float[np.ndarray, "t 3"]) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 2"]]:
    """Fit a height of second degree to points; return its slope and curvature [1/m] in the origin."""
    x, y, height = points.T
    forms = np.column_stack([np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2])
    scale = np.abs(forms).max(axis=0)
    found = np.asarray(np.linalg.lstsq(forms / scale, height, rcond=1e-6)[0], dtype=np.float64) / scale
    return found[1:3], found[np.array([[3, 4], [4, 5]])]


def _ring() -> Float[np.ndarray, "12 2"]:
    """Return twelve taxels along the edge of a triangle: iCub's earlier modules."""
    angle = np.pi / 2 + 2 * np.pi / 3 * np.arange(4)
    corners = 4 * _STEP / np.sqrt(3) * np.column_stack([np.cos(angle), np.sin(angle)])
    share = np.arange(4)[:, None] / 4
    return np.concatenate([corners[k] + share * (corners[k + 1] - corners[k]) for k in range(3)])


def _lattice() -> Float[np.ndarray, "10 2"]:
    """Return ten taxels on a triangular lattice, four to a side: iCub's later modules."""
    rows = [(column - row / 2, -row * np.sqrt(3) / 2) for row in range(4) for column in range(row + 1)]
    places = _SPACING * np.array(rows)
    return places - places.mean(axis=0)


LAYOUTS: dict[str, Float[np.ndarray, "t 2"]] = {
    "ring12": _ring(),
    "triangle10": _lattice(),
    "triangle10+2": np.insert(_lattice(), [6, 9], np.nan, axis=0),  # 6 and 10 are thermal pads
}
"""Name -> places (t, 2) [m] of the taxels of one module, NaN for an index without a taxel."""
