"""Speed and memory of `palpate estimate` as a whole process, on logs of a million samples and more.

It depends on the machine and on what else runs there; ratios between formats count.
"""

from collections.abc import Iterator
from pathlib import Path

from claims.evidence.long_logs import write_log
from claims.process import palpate
from claims.row import Row, scratch
from palpate_lab.simulation import simulate_session, write_session
from palpate_lab.simulation.session import Session


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, wrenches and poses at 1 kHz, payload, filter, full answers; small judges nothing."""
    many, most = (2_000, 4_000) if small else (1_000_000, 10_000_000)
    with scratch() as folder:
        session = simulate_session(facets=2_000 if small else 20_000)
        prepare(session, folder)
        asked = {"mcap mcap": 100_000, "mcap parquet": 100_000, "parquet parquet": None, "csv csv": None}
        for formats, least in asked.items():
            source, result = formats.split()
            got, prepared, _ = _run(session, folder, source, result, many)
            target = "" if least is None else f">= {least:,} a second"
            met = None if small or least is None else prepared >= least
            yield Row(f"{source} in, {result} out, {many:,} samples", target, got, met)
        got, _, peak = _run(session, folder, "mcap", "mcap", most)
        yield Row(f"mcap in, mcap out, {most:,} samples", "<= 400 MB", got, None if small else peak <= 400)


def prepare(session: Session, folder: Path) -> None:
    write_session(session, folder)
    palpate("calibrate", "payload", "free_motion.csv", "--rig", "rig.toml", "-o", "payload.toml", cwd=folder)


def _run(session: Session, folder: Path, source: str, result: str, samples: int) -> tuple[str, float, float]:
    """A whole process in words, its samples a second without the start, and its peak of memory [MiB]."""
    log, output = folder / f"log.{source}", folder / f"contacts.{result}"
    write_log(log, session, samples)
    printed, took, _, peak = palpate("estimate", log, "--rig", folder / "rig.toml", "-o", output)
    [timing] = [line for line in printed.splitlines() if line.strip().startswith("time")]
    prepared = float(timing.split(";")[1].split()[0].replace(",", ""))
    log.unlink()
    output.unlink()
    got = f"{samples / took:,.0f} a second, start included ({prepared:,.0f} without), {peak:.0f} MiB at most"
    return got, prepared, peak
