"""Links that carry taxels: a conical forearm whose sheet unrolls without strain, or any surface with taxels on it.

The truth is geometry: taxels of known flat modules are laid on the unrolled cone, whose coordinates are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import atan, ceil, cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.modules import LAYOUTS, ModuleLayout
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial._arrays import Value, frozen

_TRIES = 200  # rounds of drawing places before an error


@dataclass(frozen=True)
class Cone:
    """A cone frustum about the link's z, narrower towards +z; it unrolls into a sector of a disc without strain.

    With a = atan(slope) a point at the distance q from the apex and the angle w about z lies, unrolled, at the polar
    coordinates (q, w sin a). Flat coordinates: s [m] round the link and t [m] along it, from the middle at w = 0;
    (s, t, outward) is right-handed.

    Args:
        radius: radius at the middle [m].
        slope: decrease of the radius per metre along z.
        length: length along z [m].
        middle: position of the frustum's middle along z [m]; the origin is the elbow.
    """

    radius: float = 0.032
    slope: float = 0.08
    length: float = 0.16
    middle: float = 0.105

    def __post_init__(self) -> None:
        if not (self.slope > 0 and self.length > 0 and self.radius > self.slope * self.length / 2):
            raise ValueError("a cone needs a positive slope and length, and a radius along all of it")

    @property
    def _half(self) -> float:
        return atan(self.slope)

    @property
    def apex(self) -> float:
        """Distance [m] from the middle to the apex, along the surface."""
        return self.radius / sin(self._half)

    def at(
        self, s: Float[np.ndarray, "*batch"], t: Float[np.ndarray, "*batch"]
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
        """Return the points [m] and outward unit normals at flat coordinates [m], both (*batch, 3)."""
        away = np.hypot(self.apex - t, s)
        angle = np.arctan2(s, self.apex - t) / sin(self._half)
        round_about, radius = np.stack([np.cos(angle), np.sin(angle)], axis=-1), away * sin(self._half)
        z = self.middle + (self.apex - away) * cos(self._half)
        points = np.concatenate([radius[..., None] * round_about, z[..., None]], axis=-1)
        up = np.full((*angle.shape, 1), sin(self._half))
        return points, np.concatenate([cos(self._half) * round_about, up], axis=-1)

    def unrolled(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Return the flat coordinates s, t (*batch, 2) [m] of points (*batch, 3).

        Off the surface they are those at the point's angle and height.
        """
        away = self.apex - (points[..., 2] - self.middle) / cos(self._half)
        turn = np.arctan2(points[..., 1], points[..., 0]) * sin(self._half)
        return np.stack([away * np.sin(turn), self.apex - away * np.cos(turn)], axis=-1)

    def mesh(self, around: int = 96, along: int = 40) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """Return a closed mesh, vertices (v, 3) [m] on the cone and faces (f, 3), with end caps, facing outward."""
        angle = 2 * pi * np.arange(around) / around
        z = self.length * (np.arange(along + 1) / along - 0.5)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = self.radius - self.slope * z
        side = np.concatenate(
            [radius[:, None, None] * ring, np.broadcast_to(z[:, None, None], (along + 1, around, 1))], axis=-1
        ).reshape(-1, 3)
        ends = np.array([[0.0, 0.0, z[0]], [0.0, 0.0, z[-1]]])
        vertices = np.concatenate([side, ends]) + np.array([0.0, 0.0, self.middle])
        here = np.arange(around * along).reshape(along, around)
        right, up = np.roll(here, -1, axis=1), here + around
        corner = np.roll(up, -1, axis=1)
        walls = np.stack([here, right, corner, here, corner, up], axis=-1).reshape(-1, 3)
        bottom = np.stack([np.full(around, len(side)), right[0], here[0]], axis=-1)
        top = np.stack([np.full(around, len(side) + 1), up[-1], corner[-1]], axis=-1)
        return vertices, np.concatenate([walls, bottom, top])


def _narrow(cone: Cone, long: float) -> float:
    """Return the circumference [m] at the narrower end of a sheet of this length."""
    return 2 * pi * (cone.radius - cone.slope * long / 2)


def _fitting(long: float, wide: float) -> Cone:
    """Return the usual cone, or a larger one on which a sheet of this size fits."""
    usual = Cone()
    if long <= usual.length and wide <= _narrow(usual, long):
        return usual
    slope, length = 0.02, max(usual.length, 1.1 * long)
    radius = max(usual.radius, 1.1 * wide / (2 * pi) + slope * length / 2)
    return Cone(radius, slope, length, length * usual.middle / usual.length)


@dataclass(frozen=True, eq=False)
class Forearm(Value):
    """A forearm with modules of one layout on a cone.

    Attributes:
        cone: the link.
        shape: (t, 2) [m] one module's taxels, NaN for a number without one.
        centres: (modules, 2) [m] true flat middles of the modules.
        angles: (modules,) [rad] angle of each on the sheet.
    """

    cone: Cone
    shape: Float[np.ndarray, "t 2"]
    centres: Float[np.ndarray, "m 2"]
    angles: Float[np.ndarray, " m"]

    def __post_init__(self) -> None:
        for name in ("shape", "centres", "angles"):
            object.__setattr__(self, name, frozen(getattr(self, name), name=name))

    @classmethod
    def of(
        cls, modules: int = 7, *, layout: str = "ring12", cone: Cone | None = None, rows: int = 2, gap: float = 6.5e-3
    ) -> Forearm:
        """Lay modules, triangles, in rows along the link, one up and one down, and return the `Forearm`.

        Args:
            modules: number of modules.
            layout: name in LAYOUTS.
            cone: None: the usual one, or where the rows do not fit on it, one on which they do.
            rows: number of rows side by side round the link.
            gap: distance [m] between the taxels of modules that face each other.

        Raises:
            InputError: an unknown layout, or modules that overlap on the given cone.
        """
        if layout not in LAYOUTS:
            raise InputError(
                f"the layout {layout!r} is unknown.", where="forearm", hint=f"Use one of {', '.join(LAYOUTS)}."
            )
        shape = LAYOUTS[layout]
        inner = float(-np.nanmin(shape[:, 1])) + gap / 2
        side, height = 2 * sqrt(3) * inner, 3 * inner
        columns = ceil(modules / rows)
        row, column = np.divmod(np.arange(modules), columns)
        down = (row + column) % 2
        s = (row - rows / 2 + (1 + down) / 3) * height
        t = (column - (columns - 1) / 2) * side / 2
        long, wide = side * (columns + 1) / 2, rows * height
        cone = cone or _fitting(long, wide)
        narrow = _narrow(cone, long)
        if wide > narrow or long > cone.length:
            raise InputError(
                f"{modules} modules in {rows} rows need {long:.3f} m along the link and {wide:.3f} m round it; "
                f"the link has {cone.length:.3f} m and {narrow:.3f} m.",
                where="forearm",
            )
        return cls(cone, shape, np.stack([s, t], axis=-1), np.where(down == 1, pi / 2, -pi / 2))

    @property
    def modules(self) -> int:
        """Number of modules."""
        return len(self.angles)

    @property
    def layout(self) -> ModuleLayout:
        """`ModuleLayout` of all its taxels."""
        return ModuleLayout.repeated(self.shape, self.modules)

    @cached_property
    def flat(self) -> Float[np.ndarray, "k 2"]:
        """True flat places of the taxels, (k, 2) [m]."""
        return self._laid(self.centres, self.angles)

    @cached_property
    def places(self) -> TaxelPlaces:
        """True places [m] and normals of the taxels on the link, as `TaxelPlaces`."""
        return self._on_link(self.flat)

    def _laid(self, centres: Float[np.ndarray, "m 2"], angles: Float[np.ndarray, " m"]) -> Float[np.ndarray, "k 2"]:
        c, s = np.cos(angles), np.sin(angles)
        turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
        return (np.einsum("mij,tj->mti", turn, self.shape) + centres[:, None]).reshape(-1, 2)

    def _on_link(self, flat: Float[np.ndarray, "k 2"]) -> TaxelPlaces:
        points, normals = self.cone.at(flat[:, 0], flat[:, 1])
        normals = np.where(np.isfinite(points), normals, np.nan)
        return TaxelPlaces(points, normals, module=self.layout.module)

    def cad(self, rng: np.random.Generator, position: float = 3e-3, angle: float = radians(5.0)) -> TaxelPlaces:
        """Return the `TaxelPlaces` that CAD states: each module moved on the sheet and turned, by normal errors.

        Args:
            rng: random numbers of the errors.
            position: standard deviation along each flat axis [m].
            angle: standard deviation [rad].
        """
        slid = self.centres + position * rng.standard_normal(self.centres.shape)
        return self._on_link(self._laid(slid, self.angles + angle * rng.standard_normal(self.modules)))

    def offset_from(self, taxel: Int[np.ndarray, " n"], offset: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Return the points (n, 3) [m] of the cone at flat offsets [m] from taxels."""
        flat = self.flat[taxel] + offset
        return self.cone.at(flat[:, 0], flat[:, 1])[0]

    def frame(self, points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, " n"]]:
        """Return axes (n, 3, 3) at points of the cone, and the curvature cos(a) / r (n,) [1/m] along the first.

        The rows of the axes are around the cone, along it to +z, and outward; a is the cone's half angle.
        """
        half, radius = atan(self.cone.slope), np.hypot(points[:, 0], points[:, 1])
        c, s, zero = points[:, 0] / radius, points[:, 1] / radius, np.zeros(len(points))
        up, out = np.full(len(points), sin(half)), cos(half)
        rows = [[-s, c, zero], [-sin(half) * c, -sin(half) * s, zero + out], [out * c, out * s, up]]
        return np.moveaxis(np.array(rows), -1, 0), out / radius

    def offsets(
        self, points: Float[np.ndarray, "n 3"], poke: Int[np.ndarray, " m"], taxel: Int[np.ndarray, " m"]
    ) -> Float[np.ndarray, "m 2"]:
        """Return the flat offsets (m, 2) [m] of taxels from points: geodesics, turned into the point's tangents."""
        here = self.cone.unrolled(points)
        away = self.flat[taxel] - here[poke]
        # round and along at a point are the flat axes turned by its polar angle
        turn = np.arctan2(here[:, 0], self.cone.apex - here[:, 1])[poke]
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=-1)


def nearby(tree: Any, points: Float[np.ndarray, "n 3"], reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of points (m,) and of the tree's entries within reach of them (m,), in the points' order."""
    found = tree.query_ball_point(points, reach, return_sorted=True)
    counts = np.fromiter((len(each) for each in found), dtype=np.int64, count=len(found))
    entries = np.fromiter((one for each in found for one in each), dtype=np.int64, count=int(counts.sum()))
    return np.repeat(np.arange(len(points)), counts), entries


def places_near(
    skin: Forearm,
    rng: np.random.Generator,
    count: int,
    *,
    reach: float = 5.9e-3,
    among: Int[np.ndarray, " j"] | None = None,
    clear: float = 9e-3,
) -> Float[np.ndarray, "n 3"]:
    """Draw points evenly over the part of the surface within reach of a taxel, (n, 3) [m].

    Args:
        skin: skin of the link.
        rng: random numbers of the places.
        count: number of points.
        reach: largest distance from a taxel [m].
        among: taxels to stay near; None: all. Points then keep `clear` [m] from every other one, so that none answers.
        clear: see `among`.

    Raises:
        InputError: there is no such place.
    """
    from scipy.spatial import cKDTree

    there = np.flatnonzero(skin.places.there)
    allowed = there if among is None else np.intersect1d(among, there)
    others = np.setdiff1d(there, allowed)
    tree = cKDTree(skin.places.positions[allowed])
    kept: list[np.ndarray] = []
    for _ in range(_TRIES):
        radius, angle = reach * np.sqrt(rng.random(4 * count)), 2 * pi * rng.random(4 * count)
        offset = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        points = skin.offset_from(allowed[rng.integers(len(allowed), size=4 * count)], offset)
        within = tree.query_ball_point(points, reach, return_length=True)  # where several reach, draws fall as often
        taken = rng.random(len(points)) * np.maximum(within, 1) < 1.0
        if len(others):
            taken &= cKDTree(skin.places.positions[others]).query(points)[0] > clear
        kept.append(points[taken])
        if sum(map(len, kept)) >= count:
            return np.concatenate(kept)[:count]
    what = "no place on the skin is near only the chosen taxels and far enough from the others."
    raise InputError(what, where="pokes", hint="Choose more taxels, next to each other.")
