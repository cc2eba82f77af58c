"""Scenes for the law of rig keys: a small rig with a log, and what Palpate makes of both."""

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import polars as pl

import palpate
from palpate.files.logs import join
from palpate.files.logs.layout import WRENCH_COLUMNS
from palpate.live.source import source_of
from palpate.sensors.force_torque.drift import wrench_drift
from palpate.sensors.load_cells.commands import CalibrateLoadCells
from palpate.sensors.taxels.poking.commands import CalibrateTaxels
from palpate.setup.rig import Rig, check_rig
from palpate.signals.recording import IMAGE, Recording
from palpate.spatial.pose import Pose
from palpate.surfaces import Surface

V03 = Path(__file__).parents[1] / "v03"
TOLD = tomllib.loads((Path(__file__).parents[1] / "laws" / "rig_keys.toml").read_text())
Table = dict[str, Any]
Log = dict[str, np.ndarray]
PLACES = np.array([[0.003, 0.001, 0.1], [0.001, -0.002, 0.002], [-0.02, 0.03, 0.01], [0.4, 0.1, -0.02]])


def merged(one: Table, other: Table) -> Table:
    """Tables of both; values of the other win, and its "DELETED" removes a key."""
    made = dict(one)
    for key, value in other.items():
        inner = made.get(key, {}) if isinstance(value, dict) else None
        made[key] = merged(inner, value) if isinstance(inner, dict) else value
    return {key: value for key, value in made.items() if not isinstance(value, str) or value != "DELETED"}


def placed(value: Any, folder: Path) -> Any:
    """Return a table with the folder in place of MADE, and that of `tests/v03` in place of V03."""
    if isinstance(value, dict):
        return {key: placed(inner, folder) for key, inner in value.items()}
    return value.replace("MADE", str(folder)).replace("V03", str(V03)) if isinstance(value, str) else value


@dataclass(frozen=True)
class Scene:
    """What is made of a rig: a function from it, or from the table of a robot, and the folder of `rig_files`.

    `home` is the folder of `tests/v03` in which the rig's paths begin.
    """

    answer: Callable[[Any, Path], Any]
    home: str = "six-axis"

    def of(self, table: Table, folder: Path) -> dict[str, Any]:
        """Return place -> number, text or array of all that is made of a rig's table."""
        table = placed(table, folder)
        rig = table if "robot" in table else check_rig(table, V03 / self.home / "rig.toml")
        made = dict(leaves(self.answer(rig, folder)))
        assert made, "an answer without a number says nothing"
        return made


def rig_of(scene: str) -> Table:
    """Return the table of a scene's rig."""
    own = TOLD["rig"].get({"wrist": "robot", "live sheet": "flat"}.get(scene, scene))
    return tomllib.loads((V03 / SCENES[scene].home / "rig.toml").read_text()) if own is None else own


def leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield place and value of each number, text and array in a value."""
    value = _plain(value)
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from leaves(inner, f"{place}.{key}")
    elif _numeric(value):
        yield place, np.asarray(value, dtype=float)
    elif isinstance(value, (list, tuple)):
        for k, inner in enumerate(value):
            yield from leaves(inner, f"{place}[{k}]")
    elif value is None or isinstance(value, (str, bytes)):
        yield place, value


def _plain(value: Any) -> Any:
    if isinstance(value, pl.DataFrame):
        return {each.name: each.to_numpy() if each.dtype.is_numeric() else str(each.to_list()) for each in value}
    if isinstance(value, Surface):
        return value.project(PLACES), value.size, value.centre
    if isinstance(value, Pose):
        return value.rotation, value.translation
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: getattr(value, each.name) for each in fields(value)}
    ours = type(value).__module__.startswith("palpate") and hasattr(value, "__dict__")
    return {"class": type(value).__name__, **vars(value)} if ours else value


def _numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except ValueError:
        return False


def same(one: dict[str, Any], other: dict[str, Any], rtol: float = 1e-9) -> bool:
    """Return whether two answers are equal, numbers but for rounding."""
    return one.keys() == other.keys() and all(_alike(each, other[place], rtol) for place, each in one.items())


def _alike(one: Any, other: Any, rtol: float) -> bool:
    if not isinstance(one, np.ndarray) or not isinstance(other, np.ndarray):
        return type(one) is type(other) and one == other
    size = np.max(np.abs(one), initial=0.0, where=np.isfinite(one))
    return one.shape == other.shape and np.allclose(one, other, rtol=rtol, atol=rtol * size, equal_nan=True)


@cache
def _logged(name: str, rows: int) -> Log:
    table = pl.read_csv(V03 / name / "log.csv", n_rows=rows)
    return {column: table[column].to_numpy().astype(float) for column in table.columns}


def estimated(log: Callable[[], Log], frame: str = "surface") -> Callable[[Rig, Path], Any]:
    return lambda rig, folder: palpate.estimate(log(), rig, frame=frame).to_polars()


def six() -> Log:
    """The start of the log of a probe, with columns that it does not need."""
    log = dict(_logged("six-axis", 130))
    log |= {f"a{axis}": 0.3 * np.sin(3 * log["time"] + k) for k, axis in enumerate("xyz")}
    return log | {"celsius": 20.0 + 0.5 * log["time"] ** 2}


def sheet() -> Log:
    """A sheet of 6 x 8 cells: one blob, two that grow together, one that jumps, one that is lost for a while."""
    rng, time = np.random.default_rng(0), np.arange(140) / 100.0
    row, column = (each.ravel() for each in np.mgrid[:6, :8])

    def blob(frames: slice, y: float, x: float, size: float = 60.0) -> None:
        counts[frames] += size * np.exp(-((row - y) ** 2 + (column - x) ** 2) / 1.5)

    counts = 20.0 + rng.normal(0.0, 1.0, (140, 48))
    blob(slice(40, 60), 2, 2)
    blob(slice(60, 80), 2, 2)
    blob(slice(60, 80), 2, 4.6, 50.0)
    blob(slice(85, 95), 2, 2)
    blob(slice(95, 105), 2, 4)
    blob(slice(110, 118), 4, 5)
    blob(slice(124, 132), 4, 5)
    counts = np.clip(np.rint(counts), 0, 255)
    return {"time": time} | {f"c{k}": counts[:, k] for k in range(48)} | {f"d{k}": counts[:, -k - 1] for k in range(48)}


def unseen() -> Log:
    """A skin on a sensor, which for a while feels more than the skin does."""
    log = dict(_logged("skin_and_wrench", 110))
    mount = Pose.from_quaternion([0.0, 0.0, 0.6, 0.8], [0.010, -0.020, 0.060])
    force, point = np.array([-1.0, 0.0, 0.0]), np.array([0.0355, 0.0, 0.045])
    wrench = mount.wrench_matrix() @ np.concatenate([force, np.cross(point, force)])
    share = 8.0 * np.clip(log["time"] - log["time"][-1] + 0.5, 0.0, None) ** 2
    return log | {name: log[name] + share * wrench[k] for k, name in enumerate(WRENCH_COLUMNS)}


def jumped() -> Log:
    """The same at rest for five seconds, in which the sensor's bias jumps by what no touch explains."""
    rest = {name: np.tile(values[:40], 6) for name, values in _logged("skin_and_wrench", 110).items()}
    time = 0.02 * np.arange(240)
    return rest | {"time": time, "tx": rest["tx"] + 0.3 * (time > 1.5), "fx": rest["fx"] + 0.3 * (time > 1.5)}


def axes() -> Log:
    """Twelve taxels with three axes, twice; a few are pressed in the middle."""
    rng, time = np.random.default_rng(0), np.arange(80) / 100.0
    log = {"time": time, "celsius": 20.0 + time}
    for k in range(12):
        for axis, size in zip("xyz", (0.2, -0.1, 1.0), strict=True):
            push = size * np.where((time > 0.4) & (time < 0.6), np.exp(-((k - 5) ** 2) / 3.0), 0.0)
            log[f"{k + 1}_{axis}"] = push + rng.normal(0.0, 0.002, 80)
            log[f"{k + 1}_b{axis}"] = 2.0 * push + rng.normal(0.0, 0.002, 80)
    return log


def plate() -> Log:
    """Four single-axis cells in N, which bear 6 N by their distances."""
    rng, time = np.random.default_rng(0), np.arange(200) / 100.0
    share = np.array([0.4, 0.3, 0.2, 0.1])
    loads = 6.0 * share * ((time > 1.2) & (time < 1.8))[:, None] + rng.normal(0.0, 0.005, (200, 4))
    return {"time": time} | {f"u{k + 1}": loads[:, k] for k in range(4)}


def lived(rig: Rig, folder: Path) -> Any:
    """Contacts of the sheet by an estimator that has not seen a log."""
    with palpate.open_log(sheet(), rig) as opened:
        recording = join(list(opened))
    estimator = rig.estimator()
    estimator.tare(recording.picked(slice(0, 40)))
    return estimator.run(recording).to_polars()


def untimed(log: Callable[[], Log]) -> Callable[[], Log]:
    return lambda: {name: values for name, values in log().items() if name != "time"}


@cache
def images() -> np.ndarray:
    """A ring's markers at rest, and pushed by one and by two bodies, of which one moves."""
    from palpate.files.models import read_model
    from palpate.sensors.marker_ring.model import MarkerRing
    from tests.support.drawn_markers import drawn

    ring, rng = read_model(V03 / "marker_ring" / "ring.toml", MarkerRing), np.random.default_rng(0)
    plane, frames = ring.view.to_plane(ring.rest), list[np.ndarray]()
    steps = [[], [], [], [], [], [(2.2, 4.0)], [(2.2, 1.5)], [(2.2, 0.7)], [(2.2, 0.4)], [(2.2, 4.0)], [(2.4, 4.0)]]
    for bodies in [*steps, [(2.4, 4.0), (4.0, 4.0)], [], [(2.4, 4.0)], [(2.4, 4.0), (3.0, 4.0)]]:
        ways = np.zeros((24, 2))
        for angle, depth in bodies:
            away = np.angle(np.exp(1j * (ring.view.angles - angle)))
            ways -= 1e-3 * depth * np.exp(-(away**2) / 0.08)[:, None] * [1.0, 0.1]
        pixels = ring.view.from_plane(plane + np.einsum("mak,mk->ma", ring.axes(), ways))
        frames.append(drawn(pixels, np.sqrt(ring.area / np.pi), noise=2.0, rng=rng))
    return np.stack(frames)


def ringed(rig: Rig, folder: Path) -> Any:
    frames = images()
    recording = Recording(np.arange(len(frames)) / 30.0, {IMAGE: frames})
    return rig.resolve("marker_ring", recording).prepared().estimator.run(recording).to_polars()


def read(name: str) -> Callable[[Rig, Path], Any]:
    """The samples of a file of `rig_files`, as the rig reads them."""

    def answer(rig: Rig, folder: Path) -> Any:
        with palpate.open_log(folder / name, rig) as opened:
            found = join(list(opened))
        return [found.time, dict(found.channels)]

    return answer


def section(kind: str, part: str) -> Callable[[Rig, Path], Any]:
    """A value of the sensor's section."""

    def answer(rig: Rig, folder: Path) -> Any:
        value = getattr(rig.resolve(kind).sensors[kind].section, part)
        return value() if callable(value) else value

    return answer


def captured(module: str, function: str, call: Callable[[], object]) -> Any:
    """What a call gives to a function of a module, which does not run."""
    taken = list[Any]()

    def take(*given: Any, **named: Any) -> None:
        taken.append([[list(each) if isinstance(each, Iterator) else each for each in given], named])
        raise _Taken

    with mock.patch(f"{module}.{function}", take), suppress(_Taken):
        call()
    return taken


class _Taken(Exception):
    """The function was called."""


def squared(rig: Rig, folder: Path) -> Any:
    """What the compiled equation of a superquadric is made of."""
    return captured("palpate.surfaces._function", "superquadric", rig.resolve().link.surface)


def calibrated(command: type[Any], function: str, log: str) -> Callable[[Rig, Path], Any]:
    """What a command of `palpate calibrate` gives to the function that fits, of a log of `rig_files`."""

    def answer(rig: Rig, folder: Path) -> Any:
        run = command(folder / log, folder / "rig.toml", folder / "made.toml")
        with mock.patch.object(command, "stated", rig), mock.patch.object(command, "record", return_value={}):
            return captured(command.__module__, function, run.identify)

    return answer


def drifting() -> Log:
    """A minute and more in which the bias walks and the sensor turns slowly."""
    rng, time = np.random.default_rng(0), np.arange(800) / 10.0
    log = dict(zip(WRENCH_COLUMNS, 1e-3 * rng.normal(size=(6, 800)).cumsum(axis=1), strict=True))
    log |= {"time": time, "qx": np.sin(0.02 * time), "qy": 0 * time, "qz": 0 * time, "qw": np.cos(0.02 * time)}
    return log | {axis: 0 * time for axis in "xyz"}


def drifted(log: Callable[[], Log]) -> Callable[[Rig, Path], Any]:
    """What `palpate calibrate drift` finds."""

    def answer(rig: Rig, folder: Path) -> Any:
        with palpate.open_log(log(), rig) as opened:
            return wrench_drift(opened.setup, join(list(opened)), None, 0.1)

    return answer


def sourced(rig: Rig, folder: Path) -> Any:
    """The source of live samples; of a serial port also how it is opened."""
    source = source_of(rig.stream(), rig.resolve())
    opened = captured("serial", "Serial", source.open) if rig.stream().kind == "serial" else []
    return [{name: each for name, each in vars(source).items() if name != "_stated"}, opened]


def robot(table: Table, folder: Path, frame: str = "base") -> Any:
    """Contacts of the sensors of a robot."""
    (folder / "robot.toml").write_text("\n".join(f"{key} = {_inline(value)}" for key, value in table.items()))
    return palpate.estimate(folder / "log.mcap", folder / "robot.toml", frame=frame).to_polars()


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_inline(inner)}" for key, inner in value.items()) + "}"
    return json.dumps(value)


SCENES = {
    "six": Scene(estimated(six, "base")),
    "episodes": Scene(read("episodes.parquet")),
    "untimed": Scene(estimated(untimed(six))),
    "surface": Scene(lambda rig, _: rig.resolve().link.surface()),
    "equation": Scene(lambda rig, _: rig.resolve().link.surface()),
    "superquadric": Scene(squared),
    "cells": Scene(estimated(lambda: _logged("load_cells", 200)), "load_cells"),
    "plate": Scene(estimated(plate)),
    "design": Scene(section("load_cells", "nominal")),
    "bench": Scene(calibrated(CalibrateLoadCells, "identify_load_cells", "bench.csv")),
    "flat": Scene(estimated(sheet)),
    "live sheet": Scene(lived),
    "untimed skin": Scene(estimated(untimed(sheet))),
    "skin": Scene(estimated(lambda: _logged("skin", 110)), "skin"),
    "axes": Scene(estimated(axes)),
    "places": Scene(section("skin", "body")),
    "shape": Scene(section("skin", "shape")),
    "fused": Scene(estimated(unseen), "skin_and_wrench"),
    "jumped": Scene(estimated(jumped), "skin_and_wrench"),
    "ring": Scene(ringed, "marker_ring"),
    "ring body": Scene(section("marker_ring", "body"), "marker_ring"),
    "messages": Scene(read("log.mcap")),
    "voltages": Scene(read("log.mcap"), "load_cells"),
    "frames": Scene(read("log.mcap")),
    "images": Scene(read("log.mcap")),
    "robot": Scene(robot),
    "wrist": Scene(partial(robot, frame="sensor")),
    "pokes": Scene(calibrated(CalibrateTaxels, "find_pokes", "pokes_log.csv")),
    "poke messages": Scene(calibrated(CalibrateTaxels, "find_pokes", "log.mcap")),
    "poked": Scene(calibrated(CalibrateTaxels, "calibrate_taxels", "pokes.csv")),
    "drift": Scene(drifted(drifting)),
    "source": Scene(sourced),
}
