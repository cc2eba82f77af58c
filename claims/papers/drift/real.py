"""Real recordings: a zero is followed, and no touch is eaten."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from claims.papers.drift.study import Line
from claims.papers.drift.world import drift_of
from palpate.contact import Locator, WrenchEstimator
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals.drift import Drift
from palpate.signals.noise import Noise, rest_noise
from palpate.signals.recording import FORCE, TORQUE, Recording
from palpate.signals.zero_filter import ZeroStatus
from palpate.surfaces import plane

PRESSED = 1.5  # N
TARE, TOUCHED = 200, 100  # samples


def _read(path: Path) -> tuple[pl.DataFrame, Recording]:
    """The table, and its wrenches; y and z were swapped by the driver."""
    table = pl.read_csv(path)
    names = [f"ft_wrench_{part}_{axis}" for part in ("force", "torque") for axis in "xzy"]
    if names[0] not in table.columns:
        names = [name.replace("ft_wrench_", "") for name in names]
    seen = table.select(names).to_numpy().astype(float)
    time = table["timestamp"].to_numpy().astype(float) - float(table["timestamp"][0])
    return table, Recording(time, {FORCE: seen[:, :3], TORQUE: seen[:, 3:]})


def _estimator(noise: Noise, drift: Drift | None, live: bool) -> WrenchEstimator:
    surface = plane((0.0, 0.008, 0.0), (0.0, 1.0, 0.0), half_width=0.2)
    sensor = Compensation(ForceTorque(noise.deviation, spectrum=noise.spectrum))
    return WrenchEstimator(Locator(surface, on=0.5, off=0.3), sensor, live=live, drift=drift)


def pad(folder: Path, log: str, walk: float) -> Iterator[Line]:
    """A pad on an ATI Gamma: contacts with and without following [mm, N]."""
    table, recording = _read(folder / log)
    time, seen = recording.time, recording.wrenches()
    noise = rest_noise(seen)
    if noise is None:
        return
    force = {}
    for name, drift in (("tare alone", None), ("followed", drift_of(walk))):
        made = _estimator(noise, drift, live=False)
        parts = list(made.stream(recording.picked(slice(k, k + 500)) for k in range(0, len(recording), 500)))
        point, force[name] = (
            np.concatenate([getattr(part.estimate, field) for part in parts]) for field in ("point", "force")
        )
        status = np.concatenate([part.estimate.status for part in parts])
        pressed = np.linalg.norm(seen[:, :3], axis=1) > PRESSED
        figures = {"seconds": float(time[-1]), "answered": float(np.mean(status[pressed] <= 1))}
        if "opti_x" in table.columns:
            x, y = table.select("opti_x", "opti_y").to_numpy().T
            off = point - np.column_stack([x - 0.06, np.full(len(x), 0.008), 0.142 - y])
            figures["mean error mm"] = float(1e3 * np.nanmean(np.linalg.norm(off[pressed], axis=1)))
        history = made.zero_history()
        if history is not None:
            figures["free"] = float(np.mean(history.status == ZeroStatus.FREE))
            moved = np.linalg.norm((history.zero - history.zero[0])[:, :3], axis=1)
            figures["zero moved N, most"] = float(moved.max())
            figures["its deviation N, most"] = float(history.deviation[:, :3].max())
            both = np.linalg.norm(force["followed"] - force["tare alone"], axis=1)
            figures["force differs N, most"] = float(np.nanmax(both))
        yield Line(f"{log}, {name}, walk {1e3 * walk:g} mN/sqrt(s)", figures)
        for said in (*made.notes(), *made.warnings()):
            yield Line(f"  {said}", {})


def aged(path: Path, walk: float, ages: tuple[float, ...] = (0.0, 60.0, 600.0, 3600.0)) -> Iterator[Line]:
    """The touches of a pad's log so many seconds [s] after its tare, in which nothing was read: what is known then."""
    _, recording = _read(path)
    seen = recording.wrenches()
    noise = rest_noise(seen)
    if noise is None:
        return
    first = int(np.argmax(np.linalg.norm(seen[:, :3], axis=1) > PRESSED))
    rest, touched = recording.picked(slice(0, TARE)), recording.picked(slice(first, first + TOUCHED))
    for age in ages:
        made = _estimator(noise, drift_of(walk), live=True)
        made.tare(rest)
        made.run(rest)
        later = replace(touched, time=touched.time - touched.time[0] + rest.time[-1] + age)
        one, history = made.run(later).estimate, made.zero_history()
        assert history is not None
        ellipses = np.linalg.eigvalsh(one.covariance[np.isfinite(one.covariance).all(axis=(1, 2))])[:, -1]
        figures = {
            "zero unsure N": float(history.deviation[-1, :3].mean()),
            "walk alone N": float(walk * np.sqrt(age + later.time[-1] - later.time[0])),
            "place unsure mm": float(1e3 * np.sqrt(np.median(ellipses))) if len(ellipses) else np.nan,
            "answered": float(np.mean(one.status <= 1)),
        }
        yield Line(f"{path.name}, a tare {age:g} s old, walk {1e3 * walk:g} mN/sqrt(s)", figures)
