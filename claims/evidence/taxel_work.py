"""Calibrated taxels at work: touches located with them, frames a second, and a real skin's modules laid on its link."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from time import perf_counter

import numpy as np

from claims.evidence.taxel_limit import inside_ellipse, priors_of
from claims.row import Row, shared, skipped
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking import calibrate_taxels
from palpate.sensors.taxels.poking.module_placement import common_layout, place_modules
from palpate.sensors.taxels.poking.registration import register_places
from palpate.signals.recording import CELLS, Recording
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench
from palpate_lab.simulation.skin_touches import SkinTouches, simulate_touches

SEED = 300
NEAR = 6e-3  # m: farther off than that, a contact is not that touch's
BESIDE = 2.5e-3  # m: of a taxel's middle
APART = (12e-3, 15e-3, 18e-3)  # m, middles of two touches; neighbours are 6 mm apart
SPACING = 5.5e-3  # m, between neighbours, as the paper says it


def rows(small: bool) -> Iterator[Row]:
    """Touches of a calibrated skin, speed, the real skin."""
    yield from _touched(*((1, 200, 20) if small else (60, 1000, 100)))
    yield from _speed(small)
    yield from _icub(small)


# --- the skin at work


@dataclass(frozen=True)
class _Judged:
    """Touches, or pairs of them, as they were found.

    Attributes:
        away: [m] of contacts from the single touches that they are.
        count: contacts each touch, or pair, was taken for.
        held: single touches whose 95 % ellipse holds them.
        told: which pairs were told apart; beside: of which both lie beside a taxel.
    """

    away: np.ndarray
    held: np.ndarray
    count: np.ndarray
    told: np.ndarray
    beside: np.ndarray


def _touched(sessions: int, pokes: int, touches: int) -> Iterator[Row]:
    """Sessions of pokes each calibrate a skin from CAD, which is then touched; beside it the skin as it truly is."""
    places, single = list[float](), {True: list[_Judged](), False: list[_Judged]()}
    pairs = {apart: {True: list[_Judged](), False: list[_Judged]()} for apart in APART}
    for seed in range(SEED, SEED + sessions):
        rng = np.random.default_rng(seed)
        bench = PokeBench.drawn(rng, skin=_skin(), errors=MIX, tip=HAND)
        found = _calibrated(bench, pokes, rng)
        truth = bench.skin.places
        places.append(float(np.linalg.norm(found.positions - truth.positions, axis=1).mean()))
        one = simulate_touches(bench, rng, touches)
        both = {apart: simulate_touches(bench, rng, touches, spacing=apart) for apart in APART}
        for true, where in ((True, truth), (False, found)):
            single[true].append(_judged(where, one, 1))
            for apart, two in both.items():
                pairs[apart][true].append(_judged(where, two, 2))
    off = {true: np.concatenate([each.away for each in of]) for true, of in single.items()}
    ratio = float(np.median(off[False]) / np.median(off[True]))
    each = [np.median(a.away) / np.median(b.away) for a, b in zip(single[False], single[True], strict=True)]
    of = f"{sessions} sessions of {pokes:,} pokes, {touches} touches each"
    got = (
        f"{ratio:.2f} ({min(each):.2f} to {max(each):.2f} by session; {1e3 * np.median(off[False]):.2f} mm against "
        f"{1e3 * np.median(off[True]):.2f}; places off by {1e3 * np.mean(places):.2f} mm on average)"
    )
    judged = sessions > 1  # one session is worth little
    what = f"one touch on a skin calibrated from CAD, {of}: median place error over that with the true places"
    yield Row(what, "<= 1.5", got, ratio <= 1.5 if judged else None)
    yield _ellipses({true: [one.held for one in of] for true, of in single.items()}, of, judged=judged)
    split = sum(int((one.count > 1).sum()) for one in single[False])
    yield Row("the same: one touch told as several", "", f"{split} of {sessions * touches}")
    for apart, by in pairs.items():
        told, true_told = (np.concatenate([one.told for one in by[true]]) for true in (False, True))
        beside = np.concatenate([one.beside for one in by[False]])
        got = (
            f"{told.mean():.1%} ({true_told.mean():.1%} with the true places; {told[beside].mean():.1%} of the "
            f"{beside.sum()} where both touch within {1e3 * BESIDE:g} mm of a taxel)"
        )
        asked = apart == APART[0]
        met = bool(told.mean() >= 0.95) if asked and judged else None
        what = f"two touches whose middles are {1e3 * apart:.0f} mm apart, neighbours 6 mm: told apart"
        yield Row(what, ">= 95 %" * asked, got, met)


def _ellipses(held: dict[bool, list[np.ndarray]], of: str, *, judged: bool) -> Row:
    """Touches of one session share what is wrong with its skin: the deviation is of the means of sessions."""
    share = {true: np.array([each.mean() for each in by]) for true, by in held.items()}
    found, off = float(share[False].mean()), float(share[False].std(ddof=1)) if judged else 0.0
    got = (
        f"{found:.1%} +- {off / len(held[False]) ** 0.5:.1%} ({share[False].min():.1%} to {share[False].max():.1%} by "
        f"session; with the true places, taken for exact, {share[True].mean():.1%})"
    )
    what = f"95 % ellipses of one touch on a skin calibrated from CAD, {of}: truth inside"
    return Row(what, "93-97 %", got, 0.93 <= found <= 0.97 if judged else None)


@cache
def _skin() -> Forearm:
    return Forearm.of()


def _calibrated(bench: PokeBench, pokes: int, rng: np.random.Generator) -> TaxelPlaces:
    skin, priors = _skin(), priors_of(bench.errors)
    surface, start = Mesh.from_arrays(*skin.cone.mesh()), skin.cad(rng)
    made = calibrate_taxels(bench.session(rng, pokes).pokes, surface=surface, start=start, priors=priors)
    return made.places


def _judged(places: TaxelPlaces, touches: SkinTouches, several: int) -> _Judged:
    """In the middle frame of each touch, or of each pair of them."""
    body = TaxelBody.placed(places.positions, places.normals, covariance=places.covariance, bits=8)
    found = TaxelEstimator(body).run(Recording(touches.time, {CELLS: touches.frames}))
    away, held, count, told = list[float](), list[bool](), list[int](), list[bool]()
    for k in range(0, len(touches.start), several):
        rows = np.flatnonzero((found.sample == (touches.start[k] + touches.end[k]) // 2) & found.located)
        count.append(len(rows))
        far = np.linalg.norm(found.estimate.point[rows, None] - touches.point[None, k : k + several], axis=2)
        if several == 1 and len(rows):
            row = rows[int(far[:, 0].argmin())]
            away.append(float(far[:, 0].min()))
            off = found.estimate.point[[row]] - touches.point[k]
            held.append(bool(inside_ellipse(off, found.estimate.covariance[[row]])[0]))
        if several == 2:
            two = len(rows) == 2
            told.append(two and bool(min(max(far[0, 0], far[1, 1]), max(far[0, 1], far[1, 0])) < NEAR))
    to_taxels = np.linalg.norm(touches.point[:, None] - _skin().places.positions, axis=2).min(axis=1)
    beside = (to_taxels < BESIDE).reshape(-1, several).all(axis=1)
    return _Judged(np.array(away), np.array(held), np.array(count), np.array(told, dtype=bool), beside)


# --- real time


def _speed(small: bool) -> Iterator[Row]:
    """Frames in which two touches come and go, one after the other, again and again."""
    for modules, along, asked in ((7, 2, 10_000), (21 if small else 334, 3 if small else 20, 500)):
        skin = _skin() if modules == 7 else Forearm.of(modules, rows=along)
        rng = np.random.default_rng(SEED)
        bench = PokeBench.drawn(rng, skin=skin)
        touches = simulate_touches(bench, rng, 10 if small or modules > 7 else 100, spacing=APART[1])
        block = np.tile(touches.frames[:-1], (1 if small else 20, 1))
        recording = Recording(np.arange(len(block)) / 50.0, {CELLS: block})
        body = TaxelBody.placed(skin.places.positions, skin.places.normals, bits=8)
        took = list[float]()
        for _ in range(2 if small else 4):  # the first compiles
            estimator = TaxelEstimator(body)
            begin = perf_counter()
            estimator.run(recording)
            took.append(perf_counter() - begin)
        rate = len(block) / min(took)
        met = None if small else rate >= asked  # never judged where others may be running
        what = f"{len(body):,} taxels anywhere, two touches at once, in blocks: frames a second"
        yield Row(what, f">= {asked:,}", f"{rate:,.0f} (best of {len(took)})", met)


# --- a real skin


def _icub(small: bool) -> Iterator[Row]:
    """Taxels estimated from wrenches (`nomesh`), laid as rigid modules on the link; and what the authors made.

    The link is registered to the estimates alone; once more, and not judged, to the authors' result.
    """
    folder = shared()
    if folder is None or not (folder / "data" / "icub").is_dir():
        yield from skipped("icub: modules laid on the link", "")
        return
    data = folder / "data" / "icub"
    link = Mesh.load(data / "icub_r_forearm.dae", "m")
    own, theirs = (read_taxel_places(data / f"right_forearm_{kind}.txt") for kind in ("nomesh", "mesh"))
    patch, settled = (read_taxel_places(data / f"pos_right_forearm_lower_{kind}.txt") for kind in ("nomesh", "mesh"))
    for name, given, authors, most in (("all 23", own, theirs, 3.6), ("84 patch", patch, settled, 3.2)):
        for to, places in {"themselves": given, "the authors' result": theirs}.items():
            if small and not (places is given is patch):
                continue
            found = register_places(places, link)
            surface, off = link.transformed(found.pose), 1e3 * found.distances
            got = (
                f"{np.nanmean(off):.2f} mm mean, {np.nanmax(off):.2f} worst; {found.validation}; "
                f"{len(found.others)} other poses fit as well"
            )
            yield Row(f"icub, {name}: link registered to {to}, points off it", "", got)
            for spacing in (None, SPACING):
                kept = "as estimated" if spacing is None else f"scaled to {1e3 * spacing:g} mm"
                layout = common_layout(given, surface, spacing=spacing)
                laid = place_modules(given, layout, surface).places
                what = f"icub, {name}: link registered to {to}, layout {kept}"
                yield _laid(what, (given, laid, authors), surface, most, judged=not small and places is given)


def _laid(
    what: str, places: tuple[TaxelPlaces, TaxelPlaces, TaxelPlaces], surface: Mesh, most: float, *, judged: bool
) -> Row:
    """Of places as given, as laid, and as the authors have them; `most` [mm] on average they may have moved."""
    given, laid, authors = places
    rows = given.there & laid.there
    moved = 1e3 * np.linalg.norm(laid.positions - given.positions, axis=1)[rows]
    off = 1e3 * np.linalg.norm(surface.project(laid.positions[rows])[0] - laid.positions[rows], axis=1)
    theirs = 1e3 * np.linalg.norm(authors.positions - given.positions, axis=1)[authors.there & given.there]
    spread = variation(laid)
    got = (
        f"{off.mean():.4f} mm from the mesh; moved {moved.mean():.2f} mm, {moved.max():.2f} at most (the authors' "
        f"{theirs.mean():.2f}, {theirs.max():.2f}); variation {spread:.3f} (before {variation(given):.3f}, the "
        f"authors' {variation(authors):.3f})"
    )
    met = off.mean() <= 0.1 and moved.mean() <= most and spread <= 0.16
    target = f"<= 0.1 mm from the mesh, moved <= {most} mm, variation of neighbours' distances <= 0.16"
    return Row(what, target, got, met if judged else None)


def variation(places: TaxelPlaces) -> float:
    """Of the distances of neighbours in the ring of each module: their standard deviation over their mean."""
    found = list[np.ndarray]()
    for number in range(places.modules):
        ring = places.positions[places.there & (places.module == number)]
        found.append(np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1))
    distance = np.concatenate(found)
    return float(distance.std() / distance.mean())
