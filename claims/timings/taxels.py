"""Taxels from pokes: a large skin from MCAP to its file; normal equations, compiled, beside NumPy's bincount."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from claims.clock import in_turns
from claims.process import palpate
from claims.row import Row, scratch
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking._accumulate import accumulate
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench
from palpate_lab.simulation.poke_log import Timing, simulate_poke_log
from palpate_lab.simulation.poke_session_files import TAXEL_TOPIC, WRENCH_TOPIC, write_arm, write_places, write_poke_log

ASKED, ROUNDS = 5.0, 14
SECONDS, MEBIBYTES = 15.0, 2e9 / 2**20
QUICK = Timing(period=0.405, ramp=0.05, hold=0.15)  # a robot's: three pokes a taxel in a million samples
RUNS = 3  # of which the median counts; the first of all compiles
RIG = f"""\
[surface]
mesh = "forearm.stl"
unit = "m"

[force_torque]
topic = "{WRENCH_TOPIC}"

[skin]
topic = "{TAXEL_TOPIC}"
count = COUNT

[pokes]
urdf = "arm.urdf"
sensor = "ft_sensor"
link = "forearm"
layout = "ring12"
start = "cad.txt"
"""


def by_bincount(
    force: np.ndarray, torque: np.ndarray, starts: np.ndarray, taxel: np.ndarray, weights: np.ndarray, sums: np.ndarray
) -> None:
    """What `accumulate` does, in NumPy: twelve sums over the answers, by taxel."""
    square = np.einsum("ni,ni->n", force, force)
    known = square > 0
    size = np.sqrt(np.where(known, square, 1.0))
    unit = force / size[:, None]
    x, y, z = unit.T
    flat = np.stack([1 - x * x, -x * y, -x * z, 1 - y * y, -y * z, 1 - z * z])
    lines = np.concatenate([flat, np.cross(unit, torque / size[:, None]).T, unit.T]) * known
    poke = np.repeat(np.arange(len(force)), np.diff(starts))
    for column, each in zip(lines, sums.T, strict=True):
        each += np.bincount(taxel, weights * column[poke], len(sums))


def drawn(pokes: int, taxels: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Forces, torques, starts, taxels and weights of pokes with three answers each on average."""
    starts = np.concatenate([[0], np.cumsum(rng.poisson(3.0, pokes))])
    answers = int(starts[-1])
    taxel, weights = rng.integers(taxels, size=answers), rng.random(answers)
    return rng.normal(0.0, 5.0, (pokes, 3)), rng.normal(0.0, 1.0, (pokes, 3)), starts, taxel, weights


def rows(small: bool) -> Iterator[Row]:
    yield from _large(*((4, 60) if small else (334, 12_000)), judged=not small)
    yield _sums(small)


def _large(modules: int, pokes: int, *, judged: bool) -> Iterator[Row]:
    """The command as a whole, its start included. Processor time, since what else runs there does not count in it."""
    with scratch() as folder:
        truth, said = large_log(folder, modules, pokes)
        words = ("calibrate", "taxels", folder / "pokes.mcap", "--rig", folder / "rig.toml", "-o", folder / "skin.toml")
        runs = [palpate(*words)[2:] for _ in range(1 + RUNS * judged)][-RUNS:]
        places = read_taxel_places(folder / "skin.toml")
    processor, peak = np.median(runs, axis=0).tolist()
    off = 1e3 * float(np.linalg.norm(places.positions - truth.positions, axis=1).mean())
    what = f"from MCAP to a skin file, from CAD: {said}"
    got = f"{processor:.1f} s of processor, {peak:,.0f} MiB at most"
    got += f" (median of {len(runs)} runs; places {off:.2f} mm off)"
    met = processor <= SECONDS and peak <= MEBIBYTES
    yield Row(what, f"<= {SECONDS:g} s and 2 GB", got, met if judged else None)


def large_log(folder: Path, modules: int, pokes: int) -> tuple[TaxelPlaces, str]:
    """Write pokes.mcap of many modules, and all that its calibration needs; returns where taxels are, and its size."""
    rng = np.random.default_rng(77)
    skin = Forearm.of(modules, rows=20 if modules >= 20 else 2)
    bench = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND)
    log = simulate_poke_log(bench.session(rng, pokes), rng, QUICK)
    write_poke_log(log, folder / "pokes.mcap")
    write_arm(bench.arm.upper, skin.cone, folder)
    write_places(skin.cad(rng), folder / "cad.txt")
    (folder / "rig.toml").write_text(RIG.replace("COUNT", str(len(skin.places))), encoding="utf-8")
    frames, taxels = log.taxels.shape
    return skin.places, f"{taxels:,} taxels, {pokes:,} pokes, {len(log.time):,} wrenches, {frames:,} frames"


def _sums(small: bool) -> Row:
    """Both in turns; of the rounds the median. NumPy takes 14 ms in one process and up to 34 in another."""
    pokes, taxels = (2_000 if small else 100_000), 4_000
    given = drawn(pokes, taxels, np.random.default_rng(0))
    out = np.zeros((taxels, 12))
    calls = {"compiled": lambda: accumulate(*given, out), "bincount": lambda: by_bincount(*given, out)}
    ours, theirs = (float(np.median(each)) for each in in_turns(calls, 1 if small else ROUNDS).values())
    what = f"normal equations of {taxels:,} taxels from {pokes:,} pokes, three answers each, over NumPy's bincount"
    got = f"{theirs / ours:.1f} x ({1e3 * ours:.2f} ms against {1e3 * theirs:.2f})"
    return Row(what, f">= {ASKED:g} x", got, None if small else theirs / ours >= ASKED)
