"""Contacts of a taxel sheet: are they where, how hard and who they are, on a bench, on real signals, in time?

The bench (`palpate_lab.simulation.skin_bench`) presses a sheet of 6 x 22 cells of 10 mm round a cylinder of 71 mm with
patches of pressure, Hertz's and flat, and reads it as the paper's sheet is described: 8 bits, 10 counts a kPa up to
2.8 kPa and 200 kPa at the end of the range, with noise of one count before rounding and gains that differ by 2 %. Each
cell was calibrated with 60 simulated presses of a load cell. The noise and the gains are ours: the paper gives
neither. Mean pressures are 10 to 80 kPa, drawn evenly in their logarithm; a frame is judged alone, unfiltered.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from claims.clock import timed
from claims.evidence.response import held_out
from claims.row import Row, shared, skipped
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95, Status
from palpate.errors import PalpateError
from palpate.evaluation.instruments import judge, medians, touch_rows, wand_points, wrench_points
from palpate.sensors.taxels.calibrate import identify_intensity, identify_resistive
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import Health, examine
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.signals.recording import CELLS, Recording
from palpate.spatial._arrays import frozen
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.shapes import icosphere
from palpate_lab.simulation.skin_bench import PaperSheet, Patch, Rolled, Wand, paper_sheet, press, read_out
from palpate_lab.simulation.skin_session import SkinSession, load_cell_presses, simulate_protocol

SHEET = Rolled()
WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)  # cells
NEWTONS = (1.0, 3.0, 10.0, 30.0)
AGED = 0.02  # by which the gain of each cell is off from its calibration
GRAVITY = 9.80665
EXPLAINED = 0.5  # of a coordinate's variance, below which the readings do not know it


def rows(small: bool) -> Iterator[Row]:
    """Bench, identities, real signals, validation, speed, bad input."""
    yield from _single(20 if small else 1_000)
    yield from _ellipses(2 if small else 40)
    yield from _pairs(20 if small else 1_000)
    yield from _moving(1 if small else 60)
    yield from _taxel_force()
    yield from _strip(12 if small else 1)
    yield from _validation(1 if small else 200)
    yield from _speed(300 if small else 5_000, judged=not small)
    yield from _bad()


# --- the bench


@cache
def _model() -> tuple[PaperSheet, Intensity, Health]:
    rng = np.random.default_rng(61)
    model = paper_sheet(SHEET, rng)
    force, counts, cell = load_cell_presses(SHEET, model, rng)
    intensity = identify_intensity(force, counts, cell, shape=(SHEET.rows, SHEET.columns), top=255.0)
    idle = read_out(model, np.zeros((100, SHEET.rows, SHEET.columns)), rng)
    return model, intensity, examine(idle, TaxelBody.sheet(SHEET.layout()), seconds=10.0)


def _skin() -> TaxelEstimator:
    _, intensity, health = _model()
    return TaxelEstimator(TaxelBody.sheet(SHEET.layout()), intensity, health)


def _drawn(rng: np.random.Generator, width: float, flat: bool) -> Patch:
    half = width / 2 - 0.5
    row, column = rng.uniform(half, SHEET.rows - 1 - half + 1e-9), rng.uniform(half, SHEET.columns - 1 - half)
    return Patch(row, column, width / 2, _newtons(rng, width), flat)


def _newtons(rng: np.random.Generator, width: float) -> float:
    """Of a mean pressure of 10 to 80 kPa; a kPa on a cell is a tenth of a newton."""
    return float(np.pi * (width / 2) ** 2 * np.exp(rng.uniform(np.log(1.0), np.log(8.0))))


def _single(count: int) -> Iterator[Row]:
    rng, skin, model = np.random.default_rng(62), _skin(), _model()[0]
    apart, short, square, wrong = [], [], [], 0
    narrow: dict[str, float] = {}
    for width in WIDTHS:
        for flat in (False, True):
            pressed = [press(SHEET, [_drawn(rng, width, flat)]) for _ in range(count // len(WIDTHS) + 1)]
            frames = read_out(model, np.stack([each.loads for each in pressed]), rng)
            mine: list[float] = []
            for k, each in enumerate(pressed):
                skin.reset()
                found = skin.update(0.0, frames.channels[CELLS][k])
                wrong += not found.located[0] or len(found) != 1
                best = int(np.argmax(found.features["load"]))
                off = found.estimate.point[best] - each.point[0]
                mine.append(float(np.linalg.norm(off)))
                size = np.linalg.norm(each.force[0])
                short.append(abs(np.linalg.norm(found.estimate.force[best]) / size - 1.0))
                square.append(off @ np.linalg.pinv(found.estimate.covariance[best], rcond=1e-6) @ off)
            apart += mine
            if width in (1.0, 6.0):
                narrow[f"{width:g} wide, {'flat' if flat else 'Hertz'}"] = 1e3 * float(np.median(mine))
    text = f"{len(apart):,} patches, Hertz and flat, {WIDTHS[0]:g} to {WIDTHS[-1]:g} cells wide"
    by = ", ".join(f"{name} {value:.2f}" for name, value in narrow.items())
    median, p95 = 1e3 * np.median(apart), 1e3 * np.percentile(apart, 95)
    got = f"{median:.2f} mm median, {p95:.2f} mm 95 % ({by})"
    yield Row(f"position, {text}", "<= 1.0 mm median", got, median <= 1.0)
    share = 100 * float(np.median(short))
    got = f"{share:.2f} % median, {100 * np.percentile(short, 95):.1f} % 95 %"
    yield Row("force of the same", "<= 3 % median", got, share <= 3.0)
    yield Row("truth in the 95 % ellipse, the same", "", f"{np.mean(np.array(square) <= CHI2_95):.1%}")
    yield Row("frames of one patch not found as one touch, the same", "", f"{wrong} of {len(apart):,}")


def _ellipses(count: int) -> Iterator[Row]:
    """Whether the ellipse holds the middle of one touch, by its width and its force; gains are off by `AGED`.

    A touch that saturates a cell, or is not found as one, is not judged. Of bounded errors, as those of touches of one
    to two cells, an ellipse for touches of any width holds more than its share.
    """
    rng, skin, fresh = np.random.default_rng(68), _skin(), _model()[0]
    model = replace(fresh, gain=frozen(fresh.gain * (1.0 + AGED * rng.standard_normal(fresh.gain.shape))))
    pooled: list[bool] = []
    for width in WIDTHS:
        said, mine = list[str](), list[bool]()
        for force in NEWTONS:
            drawn = [replace(_drawn(rng, width, flat), force=force) for flat in (False, True) for _ in range(count)]
            held = [each for each in (_holds(skin, model, patch, rng) for patch in drawn) if each is not None]
            said.append(f"{force:g} N {np.mean(held):.0%} of {len(held)}" if held else f"{force:g} N none found")
            mine += held
        pooled += mine
        of = f"{width:g} cells wide, of {2 * count} each, gains off by {AGED:.0%}"
        what = f"skin ellipses, touches {of}: truth inside"
        share = float(np.mean(mine))
        yield Row(what, "93-97 %", f"{share:.1%} ({', '.join(said)})", None if count < 40 else 0.93 <= share <= 0.97)
    share = float(np.mean(pooled))
    met = 0.90 <= share <= 0.99 if count < 40 else 0.93 <= share <= 0.97
    yield Row("skin ellipses, all of these", "93-97 %", f"{share:.1%} of {len(pooled):,}", met)


def _holds(skin: TaxelEstimator, model: PaperSheet, patch: Patch, rng: np.random.Generator) -> bool | None:
    """Whether the 95 % ellipse holds the middle of a patch; None where it is not found as one, or saturated."""
    pressed = press(SHEET, [patch])
    skin.reset()
    found = skin.update(0.0, read_out(model, pressed.loads[None], rng).channels[CELLS][0])
    if len(found) != 1 or found.estimate.status[0] != Status.CONTACT:
        return None
    off = found.estimate.point[0] - pressed.point[0]
    return bool(off @ np.linalg.pinv(found.estimate.covariance[0], rcond=1e-6) @ off <= CHI2_95)


def _pairs(count: int) -> Iterator[Row]:
    """Two and three at once, by the gap between their edges."""
    for gap in (2.0, 1.0):
        told, apart, total = 0, list[float](), 0
        for width in (1.0, 2.0):
            for flat in (False, True):
                one, where = _told_apart(count // 4, 2, width, flat, gap)
                told, total = told + one, total + count // 4
                apart += where
        got = f"{told / total:.1%} of {total:,}; position {1e3 * np.median(apart):.2f} mm median"
        what = f"two touches, 1 and 2 cells wide, {gap:g} cells between their edges, any direction: told apart"
        yield Row(what, "" if gap < 2 else ">= 95 %", got, None if gap < 2 else told / total >= 0.95)
    told, _ = _told_apart(count // 2, 3, 1.0, False, 2.0)
    what = "three touches, 1 cell wide, 2 cells between their edges: told apart"
    yield Row(what, ">= 95 %", f"{told / (count // 2):.1%}", told / (count // 2) >= 0.95)
    told = sum(_told_apart(count // 4, 2, 1.0, flat, 1.0, spare=0.0)[0] for flat in (False, True))
    got = f"{told / (2 * (count // 4)):.1%}"
    what = (
        "two touches, 1 cell wide, *middles* exactly 2 cells apart: told apart (where both lie astride two cells, four "
    )
    yield Row(f"{what}cells read alike)", "", got)


def _told_apart(
    count: int, several: int, width: float, flat: bool, gap: float, spare: float = 0.25
) -> tuple[int, list[float]]:
    """How many of so many sets of touches were found as such, and the errors [m] of their positions."""
    rng, skin, model = np.random.default_rng(63), _skin(), _model()[0]
    sets = [_apart(rng, several, width, flat, width + gap, spare) for _ in range(count)]
    pressed = [press(SHEET, patches) for patches in sets]
    frames = read_out(model, np.stack([each.loads for each in pressed]), rng)
    told, errors = 0, list[float]()
    for k, each in enumerate(pressed):
        skin.reset()
        found = skin.update(0.0, frames.channels[CELLS][k])
        if found.located[0] and len(found) == several:
            told += 1
            distance = np.linalg.norm(found.estimate.point[:, None] - each.point[None], axis=-1)
            errors += distance.min(axis=0).tolist()
    return told, errors


def _apart(rng: np.random.Generator, several: int, width: float, flat: bool, least: float, spare: float) -> list[Patch]:
    """Patches whose middles are `least` to `least + spare` cells apart, each from the one before, in any direction."""
    half = width / 2 - 0.5
    while True:
        patches = [_drawn(rng, width, flat)]
        for _ in range(several - 1):
            angle, far = rng.uniform(0, 2 * np.pi), least + spare * rng.random()
            row, column = patches[-1].row + far * np.cos(angle), patches[-1].column + far * np.sin(angle)
            patches.append(Patch(row, column, width / 2, _newtons(rng, width), flat))
        inside = all(
            half <= p.row <= SHEET.rows - 1 - half and half <= p.column <= SHEET.columns - 1 - half for p in patches
        )
        far = [np.hypot(a.row - b.row, a.column - b.column) for k, a in enumerate(patches) for b in patches[:k]]
        if inside and min(far) >= least - 1e-9:
            return patches


def _moving(count: int) -> Iterator[Row]:
    """Two or three touches that wander for 4 s at up to 0.1 m/s, over the seam too, coming as close as a cell's gap."""
    rng, model = np.random.default_rng(64), _model()[0]
    kept = total = lost = 0
    for number in range(count):
        several = 2 + number % 2
        path = _paths(rng, several)
        newtons = [_newtons(rng, 1.5) for _ in range(several)]
        pressed = [
            press(SHEET, [Patch(*place, 0.75, force) for place, force in zip(places, newtons, strict=True)])
            for places in path
        ]
        found = _skin().run(read_out(model, np.stack([each.loads for each in pressed]), rng))
        same, judged, missing = _identities(found, [each.point for each in pressed])
        kept, total, lost = kept + same, total + judged, lost + missing
    got = f"{kept / total:.2%} of {total:,} samples of touches; {lost / (total + lost):.2%} were not found"
    what = f"identities while 2 or 3 touches move, {count} runs of 4 s at 50 Hz, a cell or more between edges"
    yield Row(what, ">= 99 %", got, kept / total >= 0.99)


def _paths(rng: np.random.Generator, several: int) -> np.ndarray:
    """(200, several, 2) rows and columns: smooth wandering round the sheet, never nearer than 2.5 cells."""
    time = np.arange(200) / 50.0
    while True:
        waves = rng.uniform(0.1, 0.5, (several, 2, 2)) * 2 * np.pi
        phase = rng.uniform(0, 2 * np.pi, (several, 2, 2))
        swing = np.sin(time[:, None, None, None] * waves + phase).mean(axis=-1)
        row = 2.5 + 2.0 * swing[..., 0]
        column = rng.uniform(0, 22, several) + 3.0 * swing[..., 1] + rng.uniform(-2, 2, several) * time[:, None]
        column = np.mod(column, SHEET.period)
        apart = np.abs(column[:, :, None] - column[:, None])
        apart = np.minimum(apart, SHEET.period - apart)
        distance = np.hypot(apart, row[:, :, None] - row[:, None]) + 99.0 * np.eye(several)
        if distance.min() >= 2.5:
            return np.stack([row, column], axis=-1)


def _identities(found: Contacts, points: list[np.ndarray]) -> tuple[int, int, int]:
    """Samples of true touches that carry the identity that their touch carries mostly; all samples; and those lost."""
    named: list[list[int]] = [[] for _ in range(len(points[0]))]
    missing = 0
    for sample, true in enumerate(points):
        rows = np.flatnonzero((found.sample == sample) & found.located)
        for k, point in enumerate(true):
            away = np.linalg.norm(found.estimate.point[rows] - point, axis=1)
            if len(rows) and away.min() < 0.008:
                named[k].append(int(found.identity[rows[int(np.argmin(away))]]))
            else:
                missing += 1
    kept = sum(int(np.bincount(names).max()) for names in named if names)
    return kept, sum(map(len, named)), missing


# --- real signals


def _taxel_force() -> Iterator[Row]:
    what = "taxel_force: the resistive model, fitted on every other block of 20 rows and judged on the rest"
    folder = shared()
    if folder is None:
        yield from skipped(what, "no worse than the published parameters")
        return
    force, reading, reference, layer, block = taxel_force_runs(folder)
    published = _resistive(force, reference, 16.963, np.array([0.502, 1.620])[layer])
    for even in (0, 1):
        train, test = block % 2 == even, block % 2 != even
        fitted = identify_resistive(
            force[train], reading[train], scale=1024.0, reference=reference[train], layer=layer[train], floor=20.0
        )
        series = np.array([curve.parameters[1] for curve in fitted])[layer]
        ours = _resistive(force, reference, float(fitted[0].parameters[0]), series)
        rms = [float(np.sqrt(np.mean((model - reading)[test] ** 2))) for model in (ours, published)]
        half = "odd" if even == 0 else "even"
        got = f"rmse {rms[0]:.1f} against {rms[1]:.1f} of 1024, {np.count_nonzero(test)} rows"
        yield Row(f"{what} ({half} blocks)", "<= the published", got, rms[0] <= rms[1])


def taxel_force_runs(folder: Path) -> tuple[np.ndarray, ...]:
    """Force [N], mean of five readings, reference [kOhm], layer and block of each row of the three runs."""
    parts: list[np.ndarray] = []
    for name, reference, layer, zero, loaded, kilograms in (
        ("10k-nosil-cylindertip.1614926403.33.txt", 10.0, 0, 1660130, 1667333, 0.160),
        ("none.1614726111.69.txt", 1.0, 0, 8322237, 8341540, 0.050),
        ("thin.1614725386.31.txt", 1.0, 1, 8322237, 8341540, 0.050),
    ):
        table = np.loadtxt(folder / "data" / "taxel_force" / name)
        force = np.maximum((table[:, 0] - zero) / (loaded - zero) * kilograms * GRAVITY, 0.0)
        ones = np.ones(len(table))
        parts.append(np.stack([force, table[:, 1] / 5, reference * ones, layer * ones, np.arange(len(table)) // 20]))
    force, reading, references, layers, blocks = np.concatenate(parts, axis=1)
    return force, reading, references, layers.astype(np.int64), blocks.astype(np.int64)


def _resistive(force: np.ndarray, reference: np.ndarray, half: float, series: np.ndarray) -> np.ndarray:
    return np.maximum(20.0, 1024.0 * (1.0 - reference * force / (2 * half + series * force)))


def _strip(every: int) -> Iterator[Row]:
    """The note beside the data names its figures SW35, SW75, SW100 but lists the files in alphabetical order.

    Its correlations 0.991, 0.994 and 0.988 are those of SW100, SW35 and SW75, to three digits; so are its errors. Each
    file is judged by the figure that is its own.
    """
    folder = shared()
    for name, file, centroid, mapped, correlated in (
        ("SW100", "norm_SW100-RATIO0-P250.csv", 2.8, 2.4, 0.991),
        ("SW35", "norm_SW35-RATIO100-P250.csv", 2.3, 2.1, 0.994),
        ("SW75", "norm_SW75-RATIO85-P250.csv", 3.1, 2.8, 0.988),
    ):
        what = f"strip, {name}, held out by rows of Y"
        if folder is None:
            yield from skipped(what, f"<= {centroid} and {mapped} mm")
            continue
        table = np.loadtxt(folder / "data" / "strip" / file, delimiter=",", skiprows=1)
        table = table[table[:, 3:].sum(axis=1) > 0][::every]
        x, y, strips = table[:, :1], table[:, 1:2], table[:, 3:]
        middle = (strips @ np.arange(7.0) / strips.sum(axis=1))[:, None]
        group = np.unique(y, return_inverse=True)[1].ravel()
        off = _straight(middle, x, group)
        both = float(np.corrcoef(middle[:, 0], x[:, 0])[0, 1])
        everywhere = _straight(middle, x, group, held_out=False)
        note = f"{everywhere:.2f} fitted to all rows as the note does; correlation {both:.3f}, there {correlated}"
        got = f"{off:.2f} mm rmse, {note}"
        yield Row(f"{what}: x by the centroid on a line", f"<= {centroid} mm", got, round(off, 1) <= centroid)
        error, _ = held_out(strips, x, group)
        got = f"{error:.2f} mm rmse, by a Gaussian process"
        yield Row(f"{what}: x by a calibrated map", f"<= {mapped} mm", got, error <= mapped)
        blind = held_out(strips, y, group)[1] < EXPLAINED
        said = "the readings say nothing of y" if blind else "nothing said"
        yield Row(f"{what}: y", "reported as not observable", said, blind)


def _straight(middle: np.ndarray, x: np.ndarray, group: np.ndarray, *, held_out: bool = True) -> float:
    """Rmse [mm], each row of Y by a straight line through the others, or through all."""
    design, found = np.column_stack([np.ones(len(x)), middle]), np.empty_like(x)
    for row in np.unique(group):
        out = group == row
        use = ~out if held_out else np.ones_like(out)
        found[out] = design[out] @ np.linalg.lstsq(design[use], x[use], rcond=None)[0]
    return float(np.sqrt(np.mean((found - x) ** 2)))


# --- validation


@dataclass
class Judged:
    """Errors [m], angles [rad] and the paper's measure of all touches of many sessions."""

    truth: list[np.ndarray] = field(default_factory=list)
    sensor: list[np.ndarray] = field(default_factory=list)
    wand: list[np.ndarray] = field(default_factory=list)
    turned: list[np.ndarray] = field(default_factory=list)
    paper: list[float] = field(default_factory=list)
    flat: list[np.ndarray] = field(default_factory=list)  # from sensor and wand: the paper's mean position errors
    refused: int = 0
    lost: int = 0


def _validation(count: int) -> Iterator[Row]:
    """The 19-touch protocol, once with a fine wand and once with patches over several cells."""
    yield from _small_touches(protocol(count, 0.3), count)
    yield from _wide_touches(protocol(count, 3.0), count)


def protocol(count: int, width: float) -> Judged:
    """The paper's 19 touches, `count` times, `width` cells wide, held against sensor, wand and truth."""
    surface, skin, judged = SHEET.layout().mesh(), _skin(), Judged()
    for k in range(count):
        session = simulate_protocol(np.random.default_rng([65, k]), model=_model()[0], width=width)
        _judge(session, skin, surface, judged)
    return judged


def _judge(session: SkinSession, skin: TaxelEstimator, surface: Mesh, judged: Judged) -> None:
    """One session against its truth, the sensor below and the wand."""
    skin.reset()
    found = skin.run(session.frames)
    held = [rows[4:-4] for rows in touch_rows(found)]  # of each touch, without the ramps
    touches, at = medians(found, held), [found.sample[rows] for rows in held]
    judged.truth.append(np.linalg.norm(touches.point - session.point, axis=1))
    wrench = np.stack([np.median(session.wrench[rows], axis=0) for rows in at])
    reference = wrench_points(surface, wrench, alone=np.ones(len(at), dtype=bool))
    report = judge(touches, reference)
    judged.sensor.append(report.report.errors)
    judged.turned.append(report.report.turned)
    judged.paper.append(report.paper_direction)
    judged.refused += sum(map(bool, reference.refused))
    pose = np.stack([_middle(session.wand[rows]) for rows in at])
    lost = np.isnan(pose).any(axis=1)
    turn = rotation_from_quaternion(np.where(lost[:, None], [0, 0, 0, 1.0], pose[:, 3:]))
    tip = Wand().radius * icosphere(16)[0]
    seen = wand_points(surface, tip, turn, np.where(lost[:, None], np.nan, pose[:, :3]))
    by_wand = judge(touches, seen)
    judged.wand.append(by_wand.report.errors)
    means = [np.nan if s is None else s.mean for s in (report.paper_position, by_wand.paper_position)]
    judged.flat.append(np.array(means))
    judged.lost += sum(map(bool, seen.refused))


def _small_touches(judged: Judged, count: int) -> Iterator[Row]:
    what, target = f"the 19-touch protocol, {count} times, touches smaller than a cell", "<= 3.83 + 0.3 mm"
    truth, sensor, wand = map(_mean, (judged.truth, judged.sensor, judged.wand))
    got = f"{truth:.2f} mm; a perfect map that names the cell 3.83 mm; the paper 4.2 mm with z set to zero"
    yield Row(f"{what}: mean distance from the truth", target, got, truth <= 4.13)
    got = f"{sensor:.2f} mm, {judged.refused} of {19 * count} refused"
    yield Row(f"{what}: from the equivalent force of the sensor below", target, got, sensor <= 4.13)
    got = f"{wand:.2f} mm, {judged.lost} of {19 * count} lost or apart; the paper 14.0 mm"
    yield Row(f"{what}: from the tracked wand", target, got, wand <= 4.13)
    got = f"{_directions(judged)}; within a cell the normal of this link turns by 16 deg, which one cell cannot tell"
    yield Row(f"{what}: directions, by the paper's measure", "", got)


def _wide_touches(judged: Judged, count: int) -> Iterator[Row]:
    what = f"the 19-touch protocol, {count} times, patches 3 cells wide"
    middle = 1e3 * float(np.median(np.concatenate(judged.truth)))
    got = f"{middle:.2f} mm median, {_mean(judged.truth):.2f} mean"
    got += f"; from the sensor below {_mean(judged.sensor):.2f} mean"
    yield Row(f"{what}: distance from the truth", "<= 1.0 mm median", got, middle <= 1.0)
    share = 100 * float(np.nanmean(judged.paper))
    yield Row(f"{what}: directions, by the paper's measure", "<= 1.5 %", _directions(judged), share <= 1.5)


def _mean(errors: list[np.ndarray]) -> float:
    return 1e3 * float(np.nanmean(np.concatenate(errors)))


def _directions(judged: Judged) -> str:
    degrees = np.degrees(float(np.nanmean(np.concatenate(judged.turned))))
    return f"{100 * float(np.nanmean(judged.paper)):.2f} %, in space {degrees:.2f} deg; the paper 2.9 %"


def _middle(poses: np.ndarray) -> np.ndarray:
    known = np.isfinite(poses).all(axis=1)
    return np.median(poses[known], axis=0) if known.any() else np.full(7, np.nan)


# --- speed


def _speed(count: int, *, judged: bool) -> Iterator[Row]:
    """One frame in a loop, three touches on it; the plain chain of OpenCV on the same frames."""
    for shape, target in (((6, 22), "<= 100 us"), ((64, 64), ">= 2,000 frames/s")):
        skin, frames = _loaded(shape)
        ours, values = _looped(skin, frames, skin.empty(64), count)
        rate = 1e6 / ours
        met = ours <= 100.0 if shape[0] == 6 else rate >= 2000
        got = f"{ours:.1f} us a frame ({rate:,.0f} frames/s), {values:.0f} us as values; {_opencv(frames, count)}"
        what = f"{shape[0]} x {shape[1]}, 3 touches: frame to contacts in a loop, median"
        yield Row(what, target, got, met if judged else None)


def _looped(skin: TaxelEstimator, frames: np.ndarray, out: np.ndarray, count: int) -> tuple[float, float]:
    into = timed(lambda k: skin.update_into(0.02 * k, frames[k % len(frames)], out), count)
    values = timed(lambda k: skin.update(0.02 * k, frames[k % len(frames)]), count)
    return float(np.median(into)), float(np.median(values))


def _loaded(shape: tuple[int, int]) -> tuple[TaxelEstimator, np.ndarray]:
    rng, sheet = np.random.default_rng(66), Rolled(*shape, radius=np.inf)
    model = paper_sheet(sheet, rng, unequal=0.0)
    places = [(1.5, 3.0), (shape[0] - 2.5, shape[1] / 2), (shape[0] / 2, shape[1] - 4.0)]
    loads = press(sheet, [Patch(*place, 1.0, 6.0) for place in places]).loads
    plain = Curve("polynomial", np.array([10.0]), np.zeros((1, 1)), largest=25.0)
    still = read_out(model, np.zeros((20, *shape)), rng)
    body = TaxelBody.sheet(sheet.layout())
    health = examine(still, body, seconds=10.0)
    pressed = read_out(model, np.repeat(loads[None], 64, axis=0), rng)
    return TaxelEstimator(body, Intensity((plain,)), health), pressed.channels[CELLS]


def _opencv(frames: np.ndarray, count: int) -> str:
    """The paper's chain: adaptive threshold, contours, centroid of each; no forces, no identities."""
    try:
        import cv2
    except ImportError:
        return "OpenCV is not installed"
    images = np.clip(frames, 0, 255).astype(np.uint8)

    def chain(k: int) -> list[tuple[float, float]]:
        image = images[k % len(images)]
        mask = cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, 11, -8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        made = []
        for outline in outlines:
            inside = np.zeros_like(image)
            cv2.drawContours(inside, [outline], -1, 1, cv2.FILLED)
            moments = cv2.moments(image * inside)
            made.append((moments["m01"] / moments["m00"], moments["m10"] / moments["m00"]))
        return made

    took = np.median(timed(chain, count))
    return f"the plain OpenCV chain (threshold, contours, centroids; nothing else) {took:.1f} us"


# --- bad input


def _bad() -> Iterator[Row]:
    """Each is refused with a sentence, or answered with a status; nothing raises but ours."""
    model, intensity, health = _model()
    rng, skin = np.random.default_rng(67), _skin()
    body, other = skin.body, TaxelBody.sheet(Rolled(5, 22).layout())
    idle = read_out(model, np.zeros((40, 6, 22)), rng)
    lacking, stuck = idle.channels[CELLS][0].copy(), np.repeat(idle.channels[CELLS][:1] * 20 % 250, 40, axis=0)
    lacking[2, 3] = np.nan
    loads = press(SHEET, [Patch(2.0, 5.0, 1.5, 90.0)]).loads
    rising = np.linspace(0, 2.5, 60)[:, None, None] * loads
    over = read_out(model, np.concatenate([np.zeros((5, 6, 22)), rising]), rng, wraps=True)
    wrapped = skin.run(over).estimate.status[-1] == Status.SATURATED and any(
        "wrapped around from one end" in note for note in skin.notes()
    )
    skin.reset()
    said = {
        "wrong frame size": skin.update(0.0, np.zeros((5, 22))).estimate.status[0] == Status.INVALID,
        "a frame of NaN": skin.update(0.0, np.full((6, 22), np.nan)).estimate.status[0] == Status.INVALID,
        "one cell NaN: answered": skin.update(0.0, lacking).estimate.status[0] == Status.NO_CONTACT,
        "8-bit wrap-around: noticed, saturated": wrapped,
        "all cells stuck": _refuses(lambda: examine(Recording(idle.time, {CELLS: stuck}), body)),
        "too few frames": _refuses(lambda: examine(idle.picked(slice(0, 3)), body)),
        "a map of another size": _refuses(lambda: TaxelEstimator(other, intensity, health)),
    }
    failed = [name for name, good in said.items() if not good]
    got = f"{len(said) - len(failed)} of {len(said)}: {', '.join(said)}{'; not ' if failed else ''}{', '.join(failed)}"
    yield Row("bad input: a sentence, or a row with a status", "all", got, not failed)


def _refuses(step: Callable[[], object]) -> bool:
    try:
        step()
    except PalpateError:
        return True
    return False
