"""Size of a skin whose taxels are found from pokes that also fall between its modules and round about it.

Contacts and wrenches are the laboratory's; pokes lie up to 16 mm from the next taxel, and responses fall off as a bell
or with a long tail, neither of which the calibration is given.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from claims.row import Row
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking import calibrate_taxels
from palpate.sensors.taxels.poking.evaluate import compare_places
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Cone, Forearm, nearby, places_near
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench

REACH, FAR = 16e-3, 25e-3  # m: of pokes from the next taxel, and of responses
WIDTH = 3e-3  # m
NOISE, THRESHOLD, GAIN = 0.3, 1.5, 15.0  # counts, counts, counts/N
ENOUGH = ">= 93 %"
KERNELS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "bell": lambda r: np.exp(-(r**2) / (2 * WIDTH**2)),
    "long tail": lambda r: (1 + r**2 / (4 * WIDTH**2)) ** -2.0,
}


@dataclass(frozen=True)
class Worn:
    """A skin on a link, and whether the link's surface is given."""

    skin: Forearm
    surface: bool = True

    @cached_property
    def mesh(self) -> Mesh | None:
        return Mesh.from_arrays(*self.skin.cone.mesh()) if self.surface else None


WORN = {
    "next to each other": Worn(Forearm.of()),
    "12 mm apart": Worn(Forearm.of(gap=12e-3)),
    "20 mm apart": Worn(Forearm.of(6, gap=20e-3)),
    "on a radius of 20 mm": Worn(Forearm.of(4, gap=8e-3, cone=Cone(radius=0.020, slope=0.04))),
    "on a radius of 80 mm": Worn(Forearm.of(gap=8e-3, cone=Cone(radius=0.080))),
    "12 mm apart, no surface": Worn(Forearm.of(gap=12e-3), surface=False),
}


def rows(small: bool) -> Iterator[Row]:
    """The size's error in deviations, all layouts with a surface together, and the relative error beside the stated."""
    inside, total, sizes = 0, 0, (range(1), [*KERNELS][:1]) if small else (range(10), KERNELS)
    for name, worn in WORN.items():
        if small and name != "12 mm apart":
            continue
        found = np.array([_found(worn, seed, kernel) for seed, kernel in product(*sizes)])
        size, deviation, rms, stated = found.T
        within = int(np.count_nonzero(np.abs(size) <= 2 * deviation))
        yield Row(
            f"size of the skin within 2 deviations, {name}, {len(found)} sessions",
            "" if worn.surface else ENOUGH,
            f"{within / len(found):.0%}; mean {100 * size.mean():+.2f} %, stated +- {100 * deviation.mean():.2f} %",
            None if worn.surface else within >= 0.93 * len(found),
        )
        inside, total = inside + within * worn.surface, total + len(found) * worn.surface
        ratio = float(np.sqrt((rms**2).mean() / (stated**2).mean()))
        got = f"{1e3 * np.sqrt((rms**2).mean()):.2f} and {1e3 * np.sqrt((stated**2).mean()):.2f} mm"
        yield Row(f"relative error and stated, {name}", "within 20 %", got, None if small else 0.8 <= ratio <= 1.2)
    what = f"size of the skin within 2 deviations, all layouts with a surface, {total} sessions"
    yield Row(what, ENOUGH, f"{inside / total:.0%}", inside >= 0.93 * total)


def _found(worn: Worn, seed: int, kernel: str) -> tuple[float, float, float, float]:
    """Return the error of the size and its deviation, the relative error (rms) and the stated one [m]."""
    rng = np.random.default_rng([51, seed, len(kernel)])
    pokes, start = _session(worn.skin, rng, KERNELS[kernel])
    found = calibrate_taxels(pokes, surface=worn.mesh, start=start, layout=worn.skin.layout)
    errors = compare_places(found.places, worn.skin.places)
    if errors.motion is None:
        raise RuntimeError("too few taxels have a place")
    places = errors.motion.apply(found.places.positions)
    places, true = (each - each.mean(axis=0) for each in (places, worn.skin.places.positions))
    size = float((places * true).sum() / (true**2).sum()) - 1.0
    rms = [float(np.sqrt((each**2).mean())) for each in (errors.relative, found.places.relative)]
    return size, found.size_deviation, rms[0], rms[1]


def _session(
    skin: Forearm, rng: np.random.Generator, kernel: Callable[[np.ndarray], np.ndarray]
) -> tuple[Pokes, TaxelPlaces]:
    """Return pokes whose answers are those of a kernel, and the places by CAD."""
    bench = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND)
    points = places_near(skin, rng, 1200, reach=REACH)
    made = bench.poke_at(points, bench.directions(points, rng), bench.arm.shared(len(points)), rng)
    poke, taxel = nearby(cKDTree(skin.places.positions), made.contacts, FAR)
    normals = skin.places.normals
    facing = np.einsum("mc,mc->m", normals[taxel], skin.frame(made.contacts)[0][poke, 2]) > 0.2
    poke, taxel = poke[facing], taxel[facing]
    away = np.linalg.norm(skin.offsets(made.contacts, poke, taxel), axis=1)
    exact = GAIN * made.force[poke] * bench.gains[taxel] * kernel(away)
    counts = np.rint(exact + NOISE * rng.standard_normal(exact.shape))
    rows = counts > THRESHOLD
    answers = np.bincount(poke[rows], minlength=len(points))
    starts = np.concatenate([[0], np.cumsum(answers)])
    pokes = replace(made.pokes, starts=starts, taxel=taxel[rows], response=counts[rows], threshold=THRESHOLD)
    return pokes, skin.cad(rng)
