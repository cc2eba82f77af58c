"""The `marker ring` paper, run again on a simulated barrel: figures 7 and 9 beside ours, and what they leave out."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from claims.page import asked, fill, table
from claims.papers.marker_ring import study
from claims.papers.marker_ring.bench import WAYS, Answer, Bench, Error, calibrated, errors
from claims.papers.marker_ring.study import DEEP_FROM, FLICKER, NOISE, NOISES, THIRD, Moving, Numbers, Sizes, Trouble
from claims.row import Row, expected
from palpate_lab.simulation.barrel import Indenter
from palpate_lab.simulation.ring_camera import Look
from palpate_lab.simulation.ring_session import Protocol, RingUnit

FOLDER = Path(__file__).parent
SEED = 300  # of the unit; nothing was chosen on it
OTHERS = range(2, 6)  # beyond it, those of more units for intervals and labels: presses of one share its calibration
PLATE, TIP = Indenter("plate", 0.0, 0.01), Indenter("tip", 0.0, 0.01, THIRD)
FULL = Sizes(
    coarse=False,
    protocol=Protocol(angles=24, hold=1, pause=1),
    angles=20,
    steps=10,
    pairs=20,
    apart=(20, 25, 30, 40, 50, 60),
    plates=6,
    speeds=(0.01, 0.02, 0.04, 0.07, 0.1),
    hidden=80,
    looks=24,
    short=24,
)
SMALL = replace(
    FULL,
    coarse=True,
    protocol=Protocol(12, (0.002, 0.004, 0.006, 0.008, 0.01), hold=1, pause=1, dragged=0),
    angles=4,
    steps=5,
    pairs=2,
    apart=(60,),
    plates=1,
    speeds=(0.04, 0.1),
    hidden=2,
    looks=1,
    short=12,
)


@dataclass(frozen=True)
class Measured:
    """Everything that the page shows.

    Attributes:
        plate, third: answers of presses with the plate and with the body that was not in the calibration.
        noises: noise of the camera -> way -> errors of the plate.
        several, moving, trouble: row by row.
        transfer: kind of calibration -> errors of ours on the second unit.
        others: number -> presses that their own calibration has not seen, and blobs that flicker, of more units.
    """

    plate: list[Answer]
    third: list[Answer]
    noises: dict[float, dict[str, list[Error]]]
    several: list[Numbers]
    moving: list[Moving]
    trouble: list[Trouble]
    transfer: dict[str, list[Error]]
    others: dict[int, tuple[list[Error], Trouble]]


def measured(sizes: Sizes, seed: int = SEED) -> Measured:
    unit, bench, rng = _unit(seed, sizes)
    session = bench.calibration(sizes.protocol)
    made = calibrated(session, unit.look)
    noises = dict[float, dict[str, list[Error]]]()
    for noise in NOISES if not sizes.coarse else ():
        look = Look(noise=noise)
        noisy, dice = Bench(replace(unit, look=look), seed), np.random.default_rng([seed, 2])
        answers = study.one_contact(noisy, calibrated(session, look), PLATE, sizes, dice)
        noises[noise] = {way: errors(answers, way) for way in WAYS}
    return Measured(
        study.one_contact(bench, made, PLATE, sizes, rng),
        study.one_contact(bench, made, TIP, sizes, rng),
        noises,
        study.several(bench, made, sizes, rng),
        study.moving(bench, made, sizes, rng),
        study.troubled(bench, made, sizes, seed),
        study.transfer(unit, made, sizes, seed),
        {seed + more: _another(seed + more, sizes) for more in (OTHERS if not sizes.coarse else ())},
    )


def _unit(seed: int, sizes: Sizes) -> tuple[RingUnit, Bench, np.random.Generator]:
    unit = RingUnit.drawn(seed, coarse=sizes.coarse, look=Look(noise=NOISE))
    return unit, Bench(unit, seed), np.random.default_rng([seed, 1])


def _another(seed: int, sizes: Sizes) -> tuple[list[Error], Trouble]:
    """Return what intervals and labels are judged on, of one more unit."""
    unit, bench, rng = _unit(seed, sizes)
    made = calibrated(bench.calibration(sizes.protocol), unit.look)
    answers = [each for body in (PLATE, TIP) for each in study.one_contact(bench, made, body, sizes, rng)]
    return errors(answers, "ours"), study.troubled(bench, made, sizes, seed, (FLICKER,))[0]


def degrees(found: Sequence[Error]) -> float:
    """Return the mean absolute error of the angle; NaN of none."""
    return float(np.degrees(np.mean([abs(each.angle) for each in found]))) if found else float("nan")


def newtons(found: Sequence[Error]) -> float:
    """Return the mean absolute error of the force; NaN of none."""
    return float(np.mean([abs(each.force) for each in found])) if found else float("nan")


def _times(found: Sequence[Error], other: Sequence[Error]) -> tuple[float, float]:
    return degrees(found) / degrees(other), newtons(found) / newtons(other)


def figures_of(made: Measured) -> dict[str, float]:
    """Return what expected.toml may ask of a run: degrees, newtons, shares and ratios."""
    got = dict[str, float]()
    for body, answers in (("plate", made.plate), ("third", made.third)):
        for way, end in (("ours", ""), ("theirs", "_theirs")):
            found = errors(answers, way)
            got |= {f"{body}_angle{end}": degrees(found), f"{body}_force{end}": newtons(found)}
    got["third_angle_deep"] = degrees([each for each in errors(made.third, "ours") if each.depth > DEEP_FROM])
    ratio = {each.name: _times(each.errors["ours"], made.several[0].errors["ours"]) for each in made.several}
    apart = {int(each.name.split()[1]): ratio[each.name] for each in made.several if each.count == 2}
    more = [each for each in made.several if each.count > 2]
    wide = [each for each in made.several if each.count == 2 and int(each.name.split()[1]) >= 25]
    got["numbers"] = min(each.right["ours"] for each in wide + more)
    got["apart_25"] = apart.get(25, (np.nan, np.nan))[0]
    got["apart_30"] = max(angle for at, (angle, _) in apart.items() if at >= 30)
    got["apart_30_force"] = max(force for at, (_, force) in apart.items() if at >= 30)
    got["three_four"], got["three_four_force"] = (max(ratio[each.name][k] for each in more) for k in (0, 1))
    speeds = {each.speed: each for each in made.moving}
    got["moving_slow"] = float(np.abs(speeds[0.04].held["ours"]).mean())
    got["moving_fast"] = float(np.abs(speeds[0.1].middle["ours"]).mean())
    got["labels"] = min(_labels(made).values())
    got["trouble_angle"] = max(each.times(made.trouble[0]) for each in made.trouble[1:])
    got["interval_angle"], got["interval_force"] = _inside(_unseen(made)["all of these"])
    few, full = (made.transfer[name] for name in ("few touches, from the first unit", "in full"))
    got["transfer"], got["transfer_force"] = _times(few, full)
    return got


def _labels(made: Measured) -> dict[str, float]:
    """Return the share of frames whose labels are all right, by the trouble; blobs that flicker on all units."""
    right = {each.name: each.right["ours"] for each in made.trouble}
    flicker = [each for each in made.trouble if each.name == FLICKER] + [each for _, each in made.others.values()]
    frames = np.array([each.frames for each in flicker])
    return right | {FLICKER: float(np.average([each.right["ours"] for each in flicker], weights=frames))}


def _unseen(made: Measured) -> dict[str, list[Error]]:
    """Return presses that calibration has not seen, by the body."""
    kinds = {
        "plate": errors(made.plate, "ours"),
        "third body": errors(made.third, "ours"),
        "tip, 4 to 8 mm": made.several[0].errors["ours"],
    }
    kinds |= {f"unit {seed}, plate and third body": found for seed, (found, _) in made.others.items()}
    return kinds | {"all of these": [each for found in kinds.values() for each in found]}


def _inside(found: Sequence[Error]) -> tuple[float, float]:
    """Return the shares of the errors of angle and force within 1.96 deviations."""
    angle = [abs(each.angle) < 1.96 * each.sd[0] for each in found]
    return float(np.mean(angle)), float(np.mean([abs(each.force) < 1.96 * each.sd[1] for each in found]))


def parts(made: Measured) -> dict[str, object]:
    more = {each.name: each.errors["ours"] for each in made.several[1:]}
    inside = [
        [name, f"{len(found)}", *(f"{100 * share:.1f}" for share in _inside(found))]
        for name, found in (_unseen(made) | more).items()
    ]
    noises = {NOISE: {way: errors(made.plate, way) for way in WAYS}} | made.noises
    full = made.transfer["in full"]
    units = [[name, _both(found), _ratio(found, full, 2)] for name, found in made.transfer.items()]
    speeds = list[list[str]]()
    for each in made.moving:
        off = [f"{np.abs(of[way]).mean():.3f}" for of in (each.middle, each.held) for way in WAYS]
        speeds.append([f"{1e3 * each.speed:.0f}", *off])
    forces = [f"{what}, {way}" for what in ("of a frame [N]", "as read [N]") for way in WAYS]
    return {
        "depth": _by_depth(made.plate, made.third),
        "noise": table(("noise", *WAYS), [[f"{at:g}", *(_both(noises[at][w]) for w in WAYS)] for at in sorted(noises)]),
        "numbers": of_numbers(made.several),
        "speed": table(("mm/s", *forces), speeds),
        "trouble": in_trouble(made.trouble, {seed: each for seed, (_, each) in made.others.items()}),
        "intervals": table(("95 % intervals of", "contacts", "angle holds [%]", "force holds [%]"), inside),
        "units": table(("calibration", "deg / N", "times that in full"), units),
    }


def _both(found: Sequence[Error]) -> str:
    return f"{degrees(found):.2f} / {newtons(found):.3f}"


def _ratio(found: Sequence[Error], other: Sequence[Error], digits: int = 1) -> str:
    return " / ".join(f"{each:.{digits}f}" for each in _times(found, other))


def _by_depth(plate: Sequence[Answer], third: Sequence[Answer]) -> str:
    columns = [errors(answers, way) for answers in (plate, third) for way in WAYS]
    depths = sorted({round(1e3 * each.depth) for each in columns[-1]})
    rows = [
        [f"{depth} mm", *(_both([each for each in found if round(1e3 * each.depth) == depth]) for found in columns)]
        for depth in depths
    ]
    rows.append(["all", *map(_both, columns)])
    spread = [np.std(np.abs([(np.degrees(each.angle), each.force) for each in found]), axis=0) for found in columns]
    rows.append(["deviation of these", *(f"{angle:.2f} / {force:.3f}" for angle, force in spread)])
    return table(("depth", *(f"{body}, {way}" for body in ("plate", "third body") for way in WAYS)), rows)


def of_numbers(several: Sequence[Numbers]) -> str:
    """Return a row a number and distance; times the errors of one."""
    rows = list[list[str]]()
    for each in several:
        found = {way: (each.errors[way], several[0].errors[way]) for way in WAYS}
        cells = [(f"{100 * each.right[way]:.0f}", _both(own), _ratio(own, one)) for way, (own, one) in found.items()]
        rows.append([each.name, *(cell for group in cells for cell in group)])
    heads = [f"{way}: {what}" for way in WAYS for what in ("numbers right [%]", "deg / N", "times one")]
    return table(("contacts", *heads), rows)


def in_trouble(trouble: Sequence[Trouble], elsewhere: Mapping[int, Trouble]) -> str:
    """Return a row a trouble, those of other units last, of which there are no clean frames."""
    rows = list[list[str]]()
    others = {f"{each.name}, unit {seed}": each for seed, each in elsewhere.items()}
    for name, each in ({each.name: each for each in trouble} | others).items():
        right = [f"{100 * each.right[way]:.2f}" for way in WAYS]
        there = [f"{100 * each.answered[way]:.0f}" for way in WAYS]
        off = [f"{np.degrees(np.abs(each.angle[way]).mean()):.2f}" if len(each.angle[way]) else "-" for way in WAYS]
        times = f"{each.times(trouble[0]):.2f}" if name not in others else "-"
        rows.append([name, f"{each.frames}", *right, f"{100 * each.seen:.1f}", *there, *off, times])
    heads = "|frames|labels right [%], theirs|ours|markers seen [%], ours|touches found [%], theirs|ours"
    return table(f"{heads}|angle [deg], theirs|ours|ours, times clean".split("|"), rows)


def rows(small: bool) -> Iterator[Row]:
    begin = time.process_time()
    made = measured(SMALL if small else FULL)
    found = expected(FOLDER, figures_of(made))
    if not small:
        fill(FOLDER, asked=asked(found, "paper"), took=time.process_time() - begin, **parts(made))
    yield from found
