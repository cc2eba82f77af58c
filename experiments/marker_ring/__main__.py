"""`python -m experiments.marker_ring [--small]`: figures 7 and 9 beside ours, and what they leave out, into README.md.

With --small a coarse barrel is pressed a few times, what is found is printed, and nothing is written.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads cost more than they save

import numpy as np

from experiments.check import Check, checks_of, table
from experiments.marker_ring import study
from experiments.marker_ring.bench import Answer, Bench, Error, calibrated, errors
from experiments.marker_ring.page import (
    by_depth,
    degrees,
    in_trouble,
    newtons,
    of_noise,
    of_numbers,
    of_speed,
    of_units,
    page,
)
from experiments.marker_ring.study import DEEP_FROM, FLICKER, NOISE, NOISES, THIRD, Moving, Numbers, Sizes, Trouble
from palpate_lab.simulation.barrel import Indenter
from palpate_lab.simulation.ring_camera import Look
from palpate_lab.simulation.ring_session import Protocol, RingUnit

__all__ = ["FULL", "SMALL", "Measured", "checks", "figures_of", "main", "measured"]

FOLDER = Path(__file__).parent
SEED = 300  # of the unit; nothing was chosen on it
OTHERS = range(2, 6)  # beyond it, those of more units for intervals and labels: presses of one share its calibration
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
    """All of it."""
    unit = RingUnit.drawn(seed, coarse=sizes.coarse, look=Look(noise=NOISE))
    bench, rng = Bench(unit, seed), np.random.default_rng([seed, 1])
    session = bench.calibration(sizes.protocol)
    made = calibrated(session, unit.look)
    plate, third = Indenter("plate", 0.0, 0.01), Indenter("tip", 0.0, 0.01, THIRD)
    noises = dict[float, dict[str, list[Error]]]()
    for noise in NOISES if not sizes.coarse else ():
        look = Look(noise=noise)
        other = calibrated(session, look)
        answers = study.one_contact(
            Bench(replace(unit, look=look), seed), other, plate, sizes, np.random.default_rng([seed, 2])
        )
        noises[noise] = {way: errors(answers, way) for way in ("ours", "theirs")}
    return Measured(
        study.one_contact(bench, made, plate, sizes, rng),
        study.one_contact(bench, made, third, sizes, rng),
        noises,
        study.several(bench, made, sizes, rng),
        study.moving(bench, made, sizes, rng),
        study.troubled(bench, made, sizes, seed),
        study.transfer(unit, made, sizes, seed),
        {seed + more: _another(seed + more, sizes) for more in (OTHERS[:1] if sizes.coarse else OTHERS)},
    )


def _another(seed: int, sizes: Sizes) -> tuple[list[Error], Trouble]:
    """What intervals and labels are judged on, of one more unit."""
    unit = RingUnit.drawn(seed, coarse=sizes.coarse, look=Look(noise=NOISE))
    bench, rng = Bench(unit, seed), np.random.default_rng([seed, 1])
    made = calibrated(bench.calibration(sizes.protocol), unit.look)
    bodies = Indenter("plate", 0.0, 0.01), Indenter("tip", 0.0, 0.01, THIRD)
    answers = [each for body in bodies for each in study.one_contact(bench, made, body, sizes, rng)]
    return errors(answers, "ours"), study.troubled(bench, made, sizes, seed, (FLICKER,))[0]


def figures_of(made: Measured) -> dict[str, float]:
    """What expected.toml may ask of a run: degrees, newtons, shares and ratios."""
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
    """Share of the frames whose labels are all right, by the trouble; blobs that flicker on all units."""
    right = {each.name: each.right["ours"] for each in made.trouble}
    flicker = [each for each in made.trouble if each.name == FLICKER] + [each for _, each in made.others.values()]
    frames = np.array([each.frames for each in flicker])
    return right | {FLICKER: float(np.average([each.right["ours"] for each in flicker], weights=frames))}


def _unseen(made: Measured) -> dict[str, list[Error]]:
    """Presses that calibration has not seen, by the body."""
    kinds = {
        "plate": errors(made.plate, "ours"),
        "third body": errors(made.third, "ours"),
        "tip, 4 to 8 mm": made.several[0].errors["ours"],
    }
    kinds |= {f"unit {seed}, plate and third body": found for seed, (found, _) in made.others.items()}
    return kinds | {"all of these": [each for found in kinds.values() for each in found]}


def _inside(found: Sequence[Error]) -> tuple[float, float]:
    """Shares of the errors of angle and force within 1.96 deviations."""
    angle = [abs(each.angle) < 1.96 * each.sd[0] for each in found]
    return float(np.mean(angle)), float(np.mean([abs(each.force) < 1.96 * each.sd[1] for each in found]))


def _times(found: Sequence[Error], other: Sequence[Error]) -> tuple[float, float]:
    return degrees(found) / degrees(other), newtons(found) / newtons(other)


def checks(made: Measured) -> list[Check]:
    """All that expected.toml asks for, measured."""
    return checks_of(FOLDER / "expected.toml", figures_of(made))


def _parts(made: Measured) -> dict[str, str]:
    """Name in the page -> Markdown."""
    more = {each.name: each.errors["ours"] for each in made.several[1:]}
    kinds = _unseen(made) | more
    inside = [
        [name, f"{len(found)}", *(f"{100 * share:.1f}" for share in _inside(found))] for name, found in kinds.items()
    ]
    return {
        "depth": by_depth(made.plate, made.third),
        "noise": of_noise({NOISE: {way: errors(made.plate, way) for way in ("theirs", "ours")}} | made.noises),
        "numbers": of_numbers(made.several),
        "speed": of_speed(made.moving),
        "trouble": in_trouble(made.trouble, {seed: each for seed, (_, each) in made.others.items()}),
        "intervals": table(("95 % intervals of", "contacts", "angle holds [%]", "force holds [%]"), inside),
        "units": of_units(made.transfer),
    }


def main() -> int:
    """0 when everything that is asked for is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.marker_ring", description=__doc__)
    parser.add_argument("--small", action="store_true", help="a coarse barrel, few presses; nothing is written")
    parser.add_argument("--seed", type=int, default=SEED, help="another unit; nothing is written")
    asked = parser.parse_args()
    begin = time.process_time()
    made = measured(SMALL if asked.small else FULL, asked.seed)
    found = checks(made)
    for check in found:
        print(" | ".join(check.cells()))
    parts = _parts(made)
    print("\n\n".join(parts.values()))
    if asked.small or asked.seed != SEED:
        return 0 if all(check.met for check in found) else 1
    (FOLDER / "README.md").write_text(page(found, parts, time.process_time() - begin), encoding="utf-8")
    return 0 if all(check.met for check in found) else 1


if __name__ == "__main__":
    sys.exit(main())
