"""Speed against the targets. It depends on the machine and on what else runs."""

from collections.abc import Iterator

import numpy as np

from claims.row import Row
from claims.timings.measure import BEGINNER, FACETS, FLAT, FULL, Meshes, batches, singles


def rows(small: bool) -> Iterator[Row]:
    """20k facets, and 1M for the flat kernel; small takes 2k for both."""
    sizes = (2_000, 2_000) if small else (20_000, 1_000_000)
    text = f"{sizes[0] // 1000}k facets"
    meshes = Meshes(sizes[0])
    yield from _one(singles(meshes, 100 if small else 2_000, 0.05 if small else 0.5), text)
    yield from _many(batches(meshes, 1_000 if small else 100_000), text)
    large = singles(meshes if small else Meshes(sizes[1]), 100 if small else 2_000, 0.05 if small else 0.5)
    got = f"{_both(large[FLAT])}; facets only {_both(large[FACETS])}"
    yield Row(f"flat kernel into `out`, {sizes[1]:,} facets", "<= 5 us p50", got, np.median(large[FLAT]) <= 5)


def _one(times: dict[str, np.ndarray], size: str) -> Iterator[Row]:
    (middle, late), full, loop = np.percentile(times[FLAT], [50, 99]), times[FULL], times[BEGINNER]
    target = "<= 2 us p50, <= 5 us p99"
    got = f"{_both(times[FLAT])}; facets only {_both(times[FACETS])}"
    yield Row(f"flat kernel into `out`, {size}", target, got, middle <= 2 and late <= 5)
    yield Row(f"full answer, smooth, h/R 0.3, {size}", "<= 10 us p50", _both(full), np.median(full) <= 10)
    yield Row(f"{BEGINNER}, {size}", "<= 20 us p50", _both(loop), np.median(loop) <= 20)
    for name, least in (
        ("NumPy, three products a facet", 100),
        ("NumPy, closed form", None),
        ("4 x 4 solves, batched", 1_000),
        ("embreex, one ray, zero pitch", None),
    ):
        if name in times:
            ratio = np.median(times[name]) / middle
            got = f"{ratio:,.1f} x the flat kernel ({_both(times[name])})"
            met = None if least is None else ratio >= least
            yield Row(f"{name}, {size}", "" if least is None else f">= {least:,} x", got, met)


def _many(rates: dict[str, float], size: str) -> Iterator[Row]:
    rate = {name: 1e-6 * each for name, each in rates.items()}
    for name, least in (("flat, h/R 0.05", 0.8), ("full, h/R 0.3", 0.4)):
        got, target = f"{rate[name]:.2f} million/s", f">= {least} million/s a thread"
        yield Row(f"{name}, {size}", target, got, rate[name] >= least)
    if "embreex, h = 0" in rate:
        names = ("flat, h = 0", "flat, facets only, h = 0", "flat, facets only, h = 0, sorted")
        shares = {name: rate[name] / rate["embreex, h = 0"] for name in names}
        got = ", ".join(f"{name} {share:.2f}" for name, share in shares.items())
        got += f" (embreex {rate['embreex, h = 0']:.2f} million/s)"
        yield Row(f"ratio to embreex at zero pitch, {size}", ">= 0.5; the aim is 1", got, max(shares.values()) >= 0.5)


def _both(times: np.ndarray) -> str:
    return "p50 {:.2f} us, p99 {:.2f} us".format(*np.percentile(times, [50, 99]))
