"""A short log for each estimator of contacts and each of its settings, with all that can be wrong with its samples.

Each has touches, lost readings, a gap, a clock that goes back, and a reading that is at its range, where there is one.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from palpate.contact import Locator, WrenchEstimator
from palpate.contact.taxel_settings import TaxelSettings
from palpate.optical.markers import MarkerColour, find_blobs
from palpate.optical.ring_response import RingResponse, ring_basis
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.sensors.fused.estimator import FusedEstimator
from palpate.sensors.fused.locator import FusedLocator
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.model import VOLTAGE, LoadCells
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.response import TaxelResponse
from palpate.signals.drift import Drift
from palpate.signals.filters import Butterworth, Filter, Kalman
from palpate.signals.motion import Motion
from palpate.signals.payload import Payload
from palpate.signals.recording import (
    AVERAGED,
    CELLS,
    FORCE,
    IMAGE,
    ORIENTATION,
    POSITION,
    TEMPERATURE,
    TORQUE,
    Recording,
)
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces import Cylinder, EllipticCylinder
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from palpate_lab.simulation.skin_bench import Rolled
from tests.support.bodies import BODIES
from tests.support.drawn_markers import drawn, nominal_view

RATE, REST = 25.0, 40  # Hz; samples at the start in which nothing touches
NOISE = np.array([0.02] * 3 + [5e-4] * 3)  # N, N m
FILTERS = (None, Kalman(1e-3, 2e-3), Butterworth(8.0), Butterworth(8.0, zero_phase=True))
PAYLOAD = Payload(np.array([0.0, 0.0, -5.0]), np.zeros(3), np.array([0.01, 0.0, 0.05]), np.zeros(3))
TIP = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
ARRAY = random_cells(LAYOUTS[4], np.random.default_rng(1))
WALKS = TaxelSettings(walk=1e-3)


@dataclass(frozen=True)
class Stream:
    """A log and the estimators that answer it.

    Attributes:
        name: of sensor and settings.
        make: a new estimator, tared where it takes a tare.
        log: to answer.
        live: whether samples can be answered as they come.
        ends: numbers of first samples after which something is half done.
    """

    name: str
    make: Callable[[], Any]
    log: Recording
    live: bool = True
    ends: tuple[int, ...] = (100,)


def pieces(log: Recording, *sizes: int) -> Iterator[Recording]:
    """Blocks of these sizes, over and over; 0: an empty one."""
    start, turn = 0, 0
    while start < len(log):
        size = sizes[turn % len(sizes)]
        yield log.picked(slice(start, start + size))
        start, turn = start + size, turn + 1


def _clock(count: int) -> np.ndarray:
    """Times [s] with a gap after three fifths, one that is none, and a step back after four fifths."""
    time = np.arange(count) / RATE
    time[3 * count // 5 :] += 1.0
    time[4 * count // 5 :] -= 2.5
    time[count // 2] = np.nan
    return time


def _pressing(count: int) -> np.ndarray:
    """Share of full pressure of each sample: touches that come and go, after the rest."""
    step = np.arange(count) - REST
    return np.where(step > 0, np.maximum(0.0, np.sin(step / 12.0)), 0.0)


@cache
def _wrenches(count: int = 300) -> Recording:
    """Of an arm that turns and shakes, with a drift of the zero."""
    rng, step = np.random.default_rng(0), np.arange(count) / RATE
    body = BODIES["ellipsoid"].analytic
    assert body is not None
    point = body.sample(1, rng)
    pushed = -4.0 * np.concatenate([n := body.normals(point)[0], np.cross(point[0], n)])
    turn = np.stack([0.2 * np.sin(step), 0 * step, 0.1 * np.sin(0.7 * step), np.ones(count)], axis=1)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    readings = _pressing(count)[:, None] * pushed + np.outer(step, [6e-3, -5e-3, 0.0, 2e-4, 0.0, 0.0])
    readings -= PAYLOAD.compensate(np.zeros((count, 6)), rotation_from_quaternion(turn), np.zeros((count, 3)))[0]
    readings += NOISE * rng.standard_normal((count, 6))
    readings[[120, 121], 2], readings[140, 1], turn[[130, 200]] = np.nan, 100.0, np.nan
    readings[150:158] = np.nan  # longer than a window of the zero
    channels = {FORCE: readings[:, :3], TORQUE: readings[:, 3:], ORIENTATION: turn}
    channels |= {POSITION: 0.05 * np.sin(3.0 * step[:, None]) * [1.0, 0.5, 0.2], TEMPERATURE: 300.0 + step[:, None]}
    return Recording(_clock(count), channels)


def _wrench(
    filter: Filter | None = None,
    drift: Drift | None = None,
    live: bool = True,
    source: str = "none",
    tared: bool = True,
    ages: float = 0.0,
) -> Any:
    sensor = ForceTorque(NOISE, limits=[60.0] * 3 + [5.0] * 3, drift=ages * NOISE)
    sensor = Compensation(sensor, PAYLOAD, Motion(source))
    locator = Locator(BODIES["ellipsoid"].mesh, friction=2.0, torsion=0.05)
    made = WrenchEstimator(locator, sensor, filter=filter, rate=RATE, live=live, drift=drift)
    if tared:
        made.tare(_wrenches().picked(slice(REST)))
    return made


@cache
def _voltages(count: int = 300) -> Recording:
    rng = np.random.default_rng(2)
    push = ARRAY.voltages(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
    volts = _pressing(count)[:, None] * push + 1e-4 * rng.standard_normal((count, 12))
    volts[90:130, 3:6] = 0.0  # a dead cell on the way
    volts[190:210, 2] += 0.01  # a channel of which the readings cannot tell
    volts[220] = np.nan
    return Recording(_clock(count), {VOLTAGE: volts})


def _cells(filter: Filter | None = None, drift: Drift | None = None, live: bool = True) -> Any:
    sensor = LoadCellArray(LoadCells(ARRAY.forward(), np.full(12, 1e-4)), seconds=0.3)
    made = WrenchEstimator(Locator(TIP), sensor, filter=filter, rate=RATE, live=live, drift=drift)
    made.tare(_voltages().picked(slice(REST)))
    return made


def _loads(count: int, rows: int, columns: int) -> np.ndarray:
    """Loads [N] under two round touches, one of which moves: (count, rows, columns)."""
    row, column = np.indices((rows, columns))
    step = np.arange(count)[:, None, None]

    def touch(at: float, along: np.ndarray) -> np.ndarray:
        return np.exp(-((row - at) ** 2 + (column - along) ** 2) / 2.0)

    pressing = _pressing(count)[:, None, None]
    corners = np.isin(row, [0, 5]) * np.isin(column, [0, 7]) * (1.0 - 0.5 * (row + column == 12))
    loads = touch(1.5, 2.0 + 0.02 * step) + (step > 90) * touch(rows - 2.0, columns - 2.5 + 0 * step)
    return pressing * np.where(step > 200, corners, loads)  # at last a rectangle, of which one corner is a ghost


CURVE = Intensity((Curve("polynomial", np.array([10.0]), np.zeros((1, 1)), largest=20.0),))  # counts per newton
SHEET, PITCH = TaxelBody.sheet(Rolled(rows=6, columns=8, radius=np.inf).layout()), 5e-3


RESPONSE = replace(TaxelResponse.guessed(48, PITCH), limits=np.array([-2.0, 0.9]))


def _skins() -> dict[str, tuple[TaxelBody, Intensity | None]]:
    """A sheet of eight bits, a sheet round a link, and taxels anywhere with three axes."""
    row, column = np.indices((6, 8)).reshape(2, -1)
    places, up = PITCH * np.column_stack([column, row, 0 * row]), np.tile([0.0, 0.0, 1.0], (48, 1))
    three = replace(TaxelBody.anywhere(places, up, along=(1.0, 0.0, 0.0)), response=RESPONSE)
    return {"sheet": (SHEET, CURVE), "anywhere": (TaxelBody.anywhere(places, up), CURVE), "three axes": (three, None)}


@cache
def _frames(shape: int, count: int = 220) -> Recording:
    rng, loads = np.random.default_rng(3), _loads(count, 6, 8)
    if shape == 3:
        frames = np.stack([0.3 * loads + 0.01, 0.01 - 0.1 * loads, loads], axis=-1).reshape(count, 48, 3)
        frames += 0.004 * rng.standard_normal(frames.shape)
        frames[60, 5], frames[100] = np.nan, np.nan
        return Recording(_clock(count), {CELLS: frames})
    cells = np.rint(np.mod(5.0 + 40.0 * loads + 0.7 * rng.standard_normal(loads.shape), 256.0))
    cells[60, 2, 4], cells[100], cells[110, 1] = np.nan, np.nan, 1e30
    return Recording(_clock(count), {CELLS: cells if shape == 2 else cells.reshape(count, -1)})


def _skin(kind: str, filter: Filter | None = None, settings: TaxelSettings | None = None) -> Any:
    body, curve = _skins()[kind]
    bad, noise = np.zeros(48, dtype=bool), np.full(48, 0.7 if curve else 0.004)
    aside = None if curve else np.stack([np.full((2, 48), 0.01), [noise, noise]])
    health = Health(np.full(48, 5.0 if curve else 0.0), noise, bad, bad, sideways=aside)
    return TaxelEstimator(body, curve, health, settings=settings, filter=filter, rate=RATE)


@cache
def _both() -> Recording:
    """Frames of the sheet, and the wrenches of its touches; once 3 N more than the skin feels, once none."""
    log, rng = _frames(2), np.random.default_rng(4)
    places, loads = _LINK.positions, _loads(len(log), 6, 8).reshape(len(log), -1)
    force = -4.0 * loads @ _LINK.normals
    torque = -4.0 * loads @ np.cross(places, _LINK.normals)
    noise = np.repeat([0.06, 4e-3], 3) * rng.standard_normal((len(log), 6))
    wrench = np.concatenate([force, torque], axis=1) + noise
    wrench[150:175, 2] -= 3.0
    wrench[80] = np.nan
    channels = {FORCE: wrench[:, :3], TORQUE: wrench[:, 3:], AVERAGED: np.ones((len(log), 1))}
    return Recording(log.time, dict(log.channels) | channels)


_LINK = TaxelBody.sheet(Rolled(rows=6, columns=8, radius=0.04).layout())


def _fused(filter: Filter | None = None, drift: Drift | None = None, live: bool = True) -> Any:
    bad = np.zeros(48, dtype=bool)
    skin = TaxelEstimator(_LINK, CURVE, Health(np.full(48, 5.0), np.full(48, 0.7), bad, bad), filter=filter, rate=RATE)
    sensor = ForceTorque(np.repeat([0.06, 4e-3], 3)).unloaded()
    sensor.tare(_both().picked(slice(REST)))
    return FusedEstimator(skin, sensor, FusedLocator(Cylinder(0.04, 0.2)), drift=drift, covered=True, live=live)


@cache
def _ring() -> MarkerRing:
    """A dent as wide as 0.3 rad, the same everywhere, and what shear drags along."""
    angle = 2.0 * np.pi * np.arange(64) / 64
    dent = np.exp(-0.5 * (np.mod(angle + np.pi, 2 * np.pi) - np.pi) ** 2 / 0.3**2)
    basis = ring_basis(angle, 8)
    shapes = np.linalg.lstsq(basis, np.stack([dent, np.gradient(dent, angle)], axis=1), rcond=None)[0].T
    coefficients = np.zeros((4, 2, 17, 1))
    coefficients[0, 0, :, 0], coefficients[1, 0, :, 0] = -1e-3 * shapes[0], -1e-4 * shapes[0]
    coefficients[0, 1, :, 0], coefficients[3, 1, :, 0] = 2e-4 * shapes[1], 5e-4 * shapes[0]
    misfit, spread, largest = np.full((2, 6), 2e-5), np.array([0.01, 0.05]), np.array([0.01, 8.0])
    response = RingResponse(coefficients, np.array([1e-3, 1e-4]), misfit, spread, largest, grip=0.5)
    view = nominal_view()
    rest = view.from_plane(view.rest)
    blobs = find_blobs(drawn(rest), COLOUR)
    nearest = np.linalg.norm(blobs.pixels[None] - rest[:, None], axis=-1).argmin(axis=1)
    return MarkerRing(0.055, view, COLOUR, blobs.pixels[nearest], blobs.areas[nearest], 0.2, response)


COLOUR = MarkerColour("red", 0.5, 0.007)


@cache
def _images() -> Recording:
    """At rest, a press that grows and leaves while another comes, with markers out of sight and useless images."""
    ring, rng, count = _ring(), np.random.default_rng(5), 24
    view, frames = ring.view, list[np.ndarray]()
    for k in range(count):
        pressed = np.zeros((24, 2))
        for at, force in ((0.5, 4.0 * (4 < k < 18)), (3.2, 3.0 * (k > 9))):
            pressed += force * ring.response.at(view.angles - at, np.full(24, at))[..., 0]
        place = view.from_plane(view.rest + np.einsum("mak,mk->ma", ring.axes(), pressed))
        seen = np.arange(24) != 7 if k < 4 or k in (12, 13) else np.arange(24) < (8 if k == 15 else 24)
        frames.append(drawn(place[seen], noise=2.0, rng=rng))
    frames[6] = np.zeros_like(frames[6])
    frames[20] = frames[19].copy()
    time = np.arange(count) / 30.0
    time[16:] -= 0.3
    return Recording(time, {IMAGE: np.stack(frames)})


def _named(kind: str, filter: Filter | None) -> str:
    return kind + ("" if filter is None else f", {type(filter).__name__}{' zero phase' * filter.zero_phase}")


def _forward(filter: Filter | None) -> bool:
    return filter is None or not filter.zero_phase


def _of(
    kind: str,
    make: Callable[..., Any],
    log: Recording,
    drift: Drift,
    filters: tuple[Filter | None, ...] = FILTERS,
    end: int = 100,
) -> Iterable[Stream]:
    """Of an estimator of wrenches: each filter, and a zero that is followed, live and in logs."""
    for filter in filters:
        yield Stream(_named(kind, filter), partial(make, filter), log, _forward(filter), (end,))
    yield Stream(f"{kind}, drift", partial(make, filters[-2], drift), log, ends=(end,))
    yield Stream(f"{kind}, drift of a log", partial(make, None, drift, live=False), log, live=False)


def _all() -> Iterable[Stream]:
    walk = np.repeat([5e-3, 2e-4], 3)
    yield from _of("wrench", _wrench, _wrenches(), Drift(walk, walk, 600.0, thermal_deviation=1e-2 * walk))
    yield Stream("wrench, drift alone", partial(_wrench, None, Drift(walk)), _wrenches())
    yield Stream("wrench of a log", partial(_wrench, live=False), _wrenches(), live=False)
    for tared in (True, False):
        name = "wrench, a zero that ages" + ", not tared" * (not tared)
        yield Stream(name, partial(_wrench, tared=tared, ages=0.1), _wrenches())
    yield Stream("wrench, poses", partial(_wrench, source="poses"), _wrenches(), live=False)
    yield from _of("load cells", _cells, _voltages(), Drift(np.full(12, 1e-5)))
    for kind, shape in (("sheet", 2), ("anywhere", 1), ("three axes", 3)):
        for filter in FILTERS if shape == 2 else FILTERS[2:]:
            yield Stream(_named(kind, filter), partial(_skin, kind, filter), _frames(shape), _forward(filter))
        yield Stream(f"{kind}, walk", partial(_skin, kind, None, WALKS), _frames(shape))
    yield from _of("skin and wrench", _fused, _both(), Drift(walk), (None, FILTERS[3]), 129)
    yield Stream("marker ring", lambda: RingEstimator(_ring()), _images(), ends=(5, 10, 16, 21))


@cache
def shaken(count: int = 1200) -> Recording:
    """Wrenches of an arm that turns and shakes."""
    step = np.arange(count) / 500.0
    turn = np.stack([np.sin(0.3 * step), 0 * step, 0 * step, np.cos(0.3 * step)], axis=1)
    tone = np.outer(np.sin(2 * np.pi * 23.0 * step), [0.5, 0.2, 0.3, 0.0, 0.0, 0.0])
    tone += 0.01 * np.random.default_rng(6).standard_normal(tone.shape)
    return Recording(step, {FORCE: tone[:, :3], TORQUE: tone[:, 3:], ORIENTATION: turn, POSITION: np.zeros((count, 3))})


STREAMS = tuple(_all())
