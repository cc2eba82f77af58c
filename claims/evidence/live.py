"""What a live stream says of itself: losses over a killed receiver, damaged lines, and good ones that are no damage.

Damage is another sign, or another leading digit, of one number of a line; the impacts are half sines of 0.3 to 5 ms
whose force meets the sensor off its axis, on a structure that rings.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import polars as pl

from claims.row import Row, scratch, shared, skipped
from palpate.live.line_damage import sealed
from palpate.live.lines import LineFrames
from palpate.live.netft_device import NetFtDevice

NOISE = np.repeat([0.02, 0.001], 3)  # N, N m
FAR = 12.0  # steps, in units of the usual one between two lines, from which damage must be found
COUNTS = {"received": r"([\d,]+) received", "lost": r"lost +([\d,]+) samples", "away": r"([\d,]+) of them while"}
RIG = """\
[surface]
kind = "sphere"
radius = 0.05
[force_torque]
noise = {{ force = 0.02, torque = 0.001 }}
[estimate]
contact = {{ on = 0.5, off = 0.3 }}
{source}"""


def rows(small: bool) -> Iterator[Row]:
    """Losses, damage, and no damage."""
    yield _losses(2 if small else 5)
    yield from _damaged(200 if small else 1000)
    yield _impacts(5_000 if small else 100_000)
    yield from _real()


def _losses(kills: int) -> Row:
    """A Net F/T that counts, and a receiver that is killed while it sends."""
    with scratch() as folder, ExitStack() as stack:
        device = NetFtDevice()
        (folder / "rig.toml").write_text(RIG.format(source=device.open()), encoding="utf-8")
        stack.callback(device.close)
        command = [sys.executable, "-m", "palpate", "live", "--rig", str(folder / "rig.toml")]
        out = stack.enter_context((folder / "out.txt").open("wb"))
        running = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
        stack.callback(running.kill)
        sent = _sent(device, folder / "out.txt", running, kills)
        text = (folder / "out.txt").read_text()
    found = {
        name: int(each[1].replace(",", "")) if (each := re.search(how, text)) else -1 for name, how in COUNTS.items()
    }
    got = f"{sent:,} sent, {found['received']:,} received, {found['lost']:,} lost, {found['away']:,} of them meanwhile"
    what = f"Net F/T at 1 kHz, receiver killed {kills} times: samples that are neither received nor lost"
    left = sent - found["received"] - found["lost"]
    return Row(what, "0", f"{left}; {got}", left == 0 and found["away"] > 0)


def _sent(device: NetFtDevice, out: Path, running: subprocess.Popen[bytes], kills: int) -> int:
    """Send until the receiver came back from so many kills, end `palpate live`, and return how many were sent."""
    rng, sent, end = np.random.default_rng(0), 0, time.monotonic() + 60.0 * (1 + kills)
    for kill in range(kills + 1):
        while out.read_text().count("while the receiver did not run") < kill or sent < 1000 * (1 + kill):
            if running.poll() is not None or time.monotonic() > end:
                raise RuntimeError(out.read_text())
            heard = device.send(np.zeros(20, dtype=np.int64), rng.normal(size=(20, 6)) * NOISE)
            sent += 20 if heard or sent else 0
            time.sleep(0.02)
        if kill < kills:
            os.kill(_receiver(running.pid), signal.SIGKILL)
    time.sleep(0.5)
    running.send_signal(signal.SIGINT)
    running.wait(60.0)
    return sent


def _receiver(pid: int) -> int:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return next(int(each) for each in children if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes())


def _damaged(count: int) -> Iterator[Row]:
    """A hand that presses, moves and lets go; every seventh line damaged."""
    rng, every = np.random.default_rng(1), 7
    time_s = np.arange(40 + every * count) * 1e-3
    press = 2.0 * (1.0 + np.sin(2 * np.pi * 0.5 * time_s))[:, None]
    values = press * [0.4, -0.3, -1.5, 0.02, 0.03, -0.01] + [1.1, -2.3, 4.2, 0.13, -0.21, 0.34]
    values += rng.normal(size=values.shape) * NOISE
    lines, usual = _lines(values), np.median(np.abs(np.diff(values, axis=0)), axis=0)
    chosen = 40 + every * np.arange(count)
    changed = [_damage(lines[k], rng) for k in chosen]
    far = np.array([size > FAR * usual[which] for _, which, size in changed])
    for seal in (True, False):
        sent = list(lines)
        for k, (line, *_) in zip(chosen.tolist(), changed, strict=True):
            sent[k] = line
        ends = [sealed(line) if seal else b"" for line in lines]
        got = _read([line + end for line, end in zip(sent, ends, strict=True)])
        if seal:
            silent = len(got) - (len(lines) - count)
            yield Row(f"{count:,} damaged lines, with checksums: read in silence", "0", str(silent), silent == 0)
            continue
        odd = np.asarray(np.isnan(got).any(axis=1))
        silent, small = int(np.sum(~odd[chosen] & far)), int(np.sum(~odd[chosen] & ~far))
        what = f"{count:,} damaged lines without checksums, those that change a number by > {FAR:g} usual steps"
        got_text = f"{silent} of {far.sum():,}; of {np.sum(~far):,} that change less, {small:,}"
        yield Row(f"{what}: read in silence", "0", got_text, silent == 0)
        alarms = int(odd.sum() - odd[chosen].sum())
        yield Row("the sound lines between them: doubtful", "0", f"{alarms} of {len(lines) - count:,}", alarms == 0)


def _impacts(count: int) -> Row:
    """At 1 kHz, an impact of 1 to 50 N each quarter of a second."""
    rng, time_s = np.random.default_rng(2), np.arange(count) * 1e-3
    values = rng.normal(size=(count, 6)) * NOISE
    starts = np.arange(0.3, time_s[-1] - 0.1, 0.25)
    for start in starts + rng.uniform(0, 1e-3, len(starts)):
        after = np.clip(time_s - start, 0.0, None)
        lasts, peak = rng.uniform(3e-4, 5e-3), 10 ** rng.uniform(0, 1.7)
        ring = 0.3 * np.exp(-after / rng.uniform(2e-3, 2e-2)) * np.sin(2 * np.pi * rng.uniform(150, 450) * after)
        force = peak * (np.where(after < lasts, np.sin(np.pi * after / lasts), 0.0) + ring)
        way, lever = rng.normal(size=3), rng.normal(size=3) * 0.03
        way /= np.linalg.norm(way)
        values += force[:, None] * np.concatenate([way, np.cross(lever, way)])
    odd = int(np.isnan(_read(_lines(values))).any(axis=1).sum())
    return Row(f"{len(starts):,} impacts at 1 kHz: sound samples that are doubtful", "0", str(odd), odd == 0)


def _real() -> Iterator[Row]:
    """Logs of a sensor that a finger strokes, and of one that is loaded."""
    what = "real logs of a pad, as lines: doubtful"
    if (folder := shared()) is None:
        yield from skipped(what, "0")
        return
    names = [f"ft_wrench_{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    logs = sorted((folder / "data" / "pad").glob("*.csv"))
    read = [_read(_lines(pl.read_csv(log).select(names).to_numpy())) for log in logs]
    odd = sum(int(np.isnan(each).any(axis=1).sum()) for each in read)
    yield Row(what, "0", f"{odd} of {sum(map(len, read)):,} samples", odd == 0)


def _lines(values: np.ndarray) -> list[bytes]:
    return [",".join(f"{value:.4f}" for value in row).encode() for row in values.tolist()]


def _damage(line: bytes, rng: np.random.Generator) -> tuple[bytes, int, float]:
    """Return a line in which one number has another sign or leading digit, that number's index, and its change."""
    parts = line.split(b",")
    which = int(rng.integers(len(parts)))
    before, digits = parts[which], parts[which].lstrip(b"-")
    minus = before[:1] == b"-"
    if rng.random() < 0.5:
        minus = not minus
    else:
        digits = rng.choice([each for each in "0123456789" if each != chr(digits[0])]).encode() + digits[1:]
    parts[which] = b"-" * minus + digits
    return b",".join(parts), which, abs(float(parts[which]) - float(before))


def _read(lines: list[bytes]) -> np.ndarray:
    """Return the samples (n, 6) of lines, after a first one that is cut, as they come from a port."""
    frames, parts = LineFrames(6), list[np.ndarray]()
    values, lost = np.empty((1024, 6)), np.zeros(1024, dtype=np.int64)
    for start in range(0, len(lines), 512):
        frames.feed(b"\n" + b"\n".join(lines[start : start + 512]) + b"\n")
        while count := frames.take(values, lost):
            parts.append(values[:count].copy())
    return np.concatenate(parts)
