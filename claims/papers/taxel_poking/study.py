"""Sessions of simulated pokes, and how far every method is off in each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from claims.evidence.taxel_limit import priors_of
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking import calibrate_taxels, paper
from palpate.sensors.taxels.poking.evaluate import compare_places
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench, PokeErrors

FIRST = 200  # seed: the errors of MIX and the tip of HAND were chosen on others
SKIN = Forearm.of()
SURFACE = Mesh.from_arrays(*SKIN.cone.mesh())
ALONE = {
    "noise only": (),
    "+ bias": ("bias_force", "bias_torque"),
    "+ frames": ("frame", "frame_angle"),
    "+ common": ("common", "common_angle"),
    "+ cross-talk": ("cross_talk",),
}


def alone(name: str) -> PokeErrors:
    noise = {"noise_force", "noise_torque", "lever"}
    return replace(MIX, **{field.name: 0.0 for field in fields(MIX) if field.name not in {*noise, *ALONE[name]}})


@dataclass(frozen=True)
class Found:
    """Distances [m] from the truth over the taxels.

    Attributes:
        mean, deviation, worst, rms: as they are.
        expected: root mean square that the covariance expects; None of methods that give none.
        relative, relative_worst: mean and largest once one rigid motion of all taxels is taken off.
    """

    mean: float
    deviation: float
    worst: float
    relative: float
    relative_worst: float
    rms: float
    expected: float | None = None

    @classmethod
    def of(cls, positions: np.ndarray, covariance: np.ndarray | None = None) -> Found:
        made = compare_places(TaxelPlaces(positions, np.full(positions.shape, np.nan)), SKIN.places)
        off, left = made.absolute, made.relative
        rms = np.sqrt(np.mean(off**2))
        square = None if covariance is None else np.nanmean(np.trace(covariance, axis1=1, axis2=2))
        expected = None if square is None else float(np.sqrt(square))
        return cls(*map(float, (off.mean(), off.std(), off.max(), left.mean(), left.max(), rms)), expected=expected)


def mean_of(found: Iterable[Found]) -> float:
    """[m] over the means of sessions or datasets; NaN of none."""
    means = [one.mean for one in found]
    return float(np.mean(means)) if means else float("nan")


@dataclass(frozen=True)
class Session:
    """One session: a bench, and pokes of it.

    Args:
        seed: of everything drawn.
        pokes: how many.
        errors: of sensor and robot.
    """

    seed: int
    pokes: int
    errors: PokeErrors = MIX

    def made(self) -> Pokes:
        rng = np.random.default_rng(self.seed)
        bench = PokeBench.drawn(rng, skin=SKIN, errors=self.errors, tip=HAND)
        return bench.session(rng, self.pokes).pokes

    def averaged(self, *, surface: bool) -> tuple[list[Found], list[Found]]:
        """The paper's way: each dataset alone, and the mean over datasets 1 to n."""
        pokes, singles = self.made(), list[np.ndarray]()
        for number in range(pokes.configurations):
            own = paper.normal_equations(pokes.picked(pokes.configuration == number), weighted=True)
            singles.append(paper.on_surface(own, SURFACE) if surface else paper.free(own))
        there = np.isfinite(np.stack(singles)).all(axis=2)
        total = np.cumsum(np.where(there[..., None], np.stack(singles), 0.0), axis=0)
        count = np.cumsum(there, axis=0)[..., None]
        running = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return [Found.of(places) for places in singles], [Found.of(places) for places in running]

    def together(self, methods: Sequence[str]) -> dict[str, Found]:
        """By all datasets at once.

        Args:
            methods: "averaged, surface" is the paper's; "pooled" puts the normal equations together; "modules" and
                "taxels" estimate all errors too, from nothing or, where ", CAD" stands behind, from CAD.
        """
        pokes = self.made()
        return {name: self._found(name, pokes) for name in methods}

    def _found(self, name: str, pokes: Pokes) -> Found:
        if name == "pooled":
            return Found.of(paper.on_surface(paper.normal_equations(pokes, weighted=True), SURFACE))
        if name == "pooled, free":
            return Found.of(paper.free(paper.normal_equations(pokes, weighted=True)))
        if name == "averaged, surface":
            return self.averaged(surface=True)[1][-1]
        method, _, begun = name.partition(", ")
        start = SKIN.cad(np.random.default_rng((self.seed, 1))) if begun else None
        layout = SKIN.layout if method == "modules" and start is None else None
        found = calibrate_taxels(
            pokes, method=method, surface=SURFACE, start=start, layout=layout, priors=priors_of(self.errors)
        )
        return Found.of(found.places.positions, found.places.covariance)
