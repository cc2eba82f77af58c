"""README.md of this folder: theirs beside ours, what was asked, what differs and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from evidence.machine import machine
from experiments.check import Check, table
from experiments.marker_ring.bench import Answer, Error, errors
from experiments.marker_ring.study import Moving, Numbers, Trouble

__all__ = [
    "by_depth",
    "degrees",
    "in_trouble",
    "newtons",
    "of_noise",
    "of_numbers",
    "of_speed",
    "of_units",
    "page",
]

WAYS = ("theirs", "ours")


def degrees(found: Sequence[Error]) -> float:
    """Mean absolute error of the angle."""
    return float(np.degrees(np.mean([abs(each.angle) for each in found]))) if found else float("nan")


def newtons(found: Sequence[Error]) -> float:
    """Mean absolute error of the force."""
    return float(np.mean([abs(each.force) for each in found])) if found else float("nan")


def _both(found: Sequence[Error]) -> str:
    return f"{degrees(found):.2f} / {newtons(found):.3f}"


def by_depth(plate: Sequence[Answer], third: Sequence[Answer]) -> str:
    """Figure 7: a row a depth."""
    columns = [errors(answers, way) for answers in (plate, third) for way in WAYS]
    depths = sorted({round(1e3 * each.depth) for each in columns[-1]})
    rows = [
        [f"{depth} mm", *[_both([e for e in found if round(1e3 * e.depth) == depth]) for found in columns]]
        for depth in depths
    ]
    rows.append(["all", *[_both(found) for found in columns]])
    spread = [np.std([abs(each.angle) for each in found]) for found in columns]
    force = [np.std([abs(each.force) for each in found]) for found in columns]
    rows.append(["deviation of these", *[f"{np.degrees(a):.2f} / {f:.3f}" for a, f in zip(spread, force, strict=True)]])
    heads = [f"{body}, {way}" for body in ("plate", "third body") for way in WAYS]
    return table(("depth", *heads), rows)


def of_noise(noises: Mapping[float, Mapping[str, Sequence[Error]]]) -> str:
    """Errors of the plate at other noises of the camera."""
    return table(
        ("noise", *WAYS), [[f"{at:g}", *[_both(found[way]) for way in WAYS]] for at, found in sorted(noises.items())]
    )


def of_numbers(several: Sequence[Numbers]) -> str:
    """A row a number and distance; times the errors of one."""
    rows = list[list[str]]()
    for each in several:
        row = [each.name]
        for way in WAYS:
            found, one = each.errors[way], several[0].errors[way]
            ratio = f"{degrees(found) / degrees(one):.1f} / {newtons(found) / newtons(one):.1f}"
            row += [f"{100 * each.right[way]:.0f}", _both(found), ratio]
        rows.append(row)
    heads = [f"{way}: {what}" for way in WAYS for what in ("numbers right [%]", "deg / N", "times one")]
    return table(("contacts", *heads), rows)


def of_speed(moving: Sequence[Moving]) -> str:
    """Figure 9: a row a speed."""
    rows = [
        [
            f"{1e3 * each.speed:.0f}",
            *[f"{np.abs(errors_[way]).mean():.3f}" for errors_ in (each.middle, each.held) for way in WAYS],
        ]
        for each in moving
    ]
    heads = [f"{what}, {way}" for what in ("of a frame [N]", "as read [N]") for way in WAYS]
    return table(("mm/s", *heads), rows)


def in_trouble(trouble: Sequence[Trouble], elsewhere: Mapping[int, Trouble]) -> str:
    """A row a trouble, those of other units last, of which there are no clean frames."""
    rows = list[list[str]]()
    others = {f"{each.name}, unit {seed}": each for seed, each in elsewhere.items()}
    for name, each in ({each.name: each for each in trouble} | others).items():
        right = [f"{100 * each.right[way]:.2f}" for way in WAYS]
        there = [f"{100 * each.answered[way]:.0f}" for way in WAYS]
        off = [f"{np.degrees(np.abs(each.angle[way]).mean()):.2f}" if len(each.angle[way]) else "-" for way in WAYS]
        times = f"{each.times(trouble[0]):.2f}" if name not in others else "-"
        rows.append([name, f"{each.frames}", *right, f"{100 * each.seen:.1f}", *there, *off, times])
    heads = ("frames", "labels right [%], theirs", "ours", "markers seen [%], ours")
    return table(
        ("", *heads, "touches found [%], theirs", "ours", "angle [deg], theirs", "ours", "ours, times clean"), rows
    )


def of_units(transfer: Mapping[str, Sequence[Error]]) -> str:
    """Errors on the second unit by its calibration."""
    full = next(iter(transfer.values()))
    rows = [
        [name, _both(found), f"{degrees(found) / degrees(full):.2f} / {newtons(found) / newtons(full):.2f}"]
        for name, found in transfer.items()
    ]
    return table(("calibration", "deg / N", "times that in full"), rows)


def page(checks: Sequence[Check], parts: Mapping[str, str], took: float) -> str:
    """The whole page.

    Args:
        checks: what was asked.
        parts: "depth", "noise", "numbers", "speed", "trouble", "intervals", "units", as Markdown.
        took: [s] of processor time.
    """
    asked = table(("figure", "paper", "got", "asked", ""), [check.cells() for check in checks])
    lines = "\n".join(f"- {line}" for line in [*machine(), f"{took:.0f} s of processor time in all"])
    return _PAGE.format(asked=asked, machine=lines, **parts)


_PAGE = """# A ring of markers that a camera watches: figures 7 and 9 of `marker ring`, and several contacts

Written by `python -m experiments.marker_ring`; what it asks for stands in [expected.toml](expected.toml).

{machine}

The paper has a real barrel; its images are not public. This one is simulated (`palpate_lab.simulation.barrel`): an
elastic body of uneven thickness in 3D finite elements, unilateral contact with friction, and a fisheye camera whose
frames have blur, noise, shadows and JPEG. Everything goes through those frames: both ways see the same pixels, and
nothing else. Truth is the centre of pressure, and the force of the contact, of the mechanics.

**Theirs** is the paper's way (`palpate_lab.papers.ring`, `theirs.py`): a filter of hue, saturation and value,
centres of the white areas, numbers by sorting about their mean, windows of three, two lines, and a cubic of
displacement and angle fitted to the plate's presses. What it leaves open is settled in its favour: see `theirs.py`.
**Ours** is `palpate calibrate marker-ring` and `estimate`: a response learned from a plate (100 mm) and a round tip
(radius 10 mm) at 24 angles each, 1 to 10 mm. The third body is a round tip of radius 25 mm, which calibration has not
seen. The unit (seed 300) was not looked at while anything was chosen. The lens is known, as from a board; where the
camera stands is not.

Errors are means of absolute values: angle [deg] / force [N].

## What was asked

{asked}

## Figure 7: one contact

Each body at 20 angles, deeper step by step. The paper reports 1.12 deg (deviation 0.6) and 0.12 N (0.045), about 2 deg
at 1 to 2 mm and 1.5 deg beyond, for the plate that it was calibrated with.

{depth}

Other noise of the same camera, calibrated and judged with the plate; 1.1 is what everything else here has:

{noise}

## Several contacts

Round tips of radius 10 mm, 4 to 8 mm deep. The paper says that contacts must be 49.54 deg apart. *times one*: the error
over that of a single contact at the same depths.

{numbers}

## Figure 9: moving

The plate comes down to 8 mm without a stop, 30 frames a second, the shutter open for half of each (five instants are
drawn into a frame). *of a frame*: against the force in the middle of its exposure. *as read*: against the force at
200 Hz of what the newest finished frame said, as the paper compares with its force sensor: at 30 frames a second the
force has moved on by then, whatever the estimator. The paper is content up to 40 mm/s.

{speed}

## Trouble in the picture

The third body, 3 to 6 mm deep, in 12 frames from the unloaded skin on. *Hidden*: any 4 of the 24 markers, for all of
a touch; *blobs*: ten red discs of 2 to 10 px radius anywhere, the same in all frames of a touch, or others in each.
Hue in OpenCV's units of 2 deg. Labels of a frame are right where every marker that is reported lies within 3 px of
where it is, none that is hidden is reported, and half of them are.

{trouble}

## Intervals

{intervals}

## Another unit

Its wall, silicone, lens, tilt and offset differ. Judged with the third body, ours only.

{units}

## What differs, and why

- **No noise of the camera puts the baseline on both of the paper's figures.** Angle [deg] / force [N] of the plate on
  this unit, by the noise: none 0.38 / 0.042; 0.5 0.51 / 0.046; 0.7 0.55 / 0.053; 0.9 0.66 / 0.053; 0.95 1.87 / 0.055;
  1.0 1.42 / 0.057; 1.1 1.59 / 0.059; 1.2 3.28 / 0.062; 1.3 2.83 / 0.062; at 1.4 it answers 123 of 200 presses, 97 of
  them more than 5 degrees off. Its angle leaps over 1.12 deg between 0.9 and 0.95, where 5 presses of 1 mm fall into a
  wrong window of three, each worth 0.2 to 0.4 deg of the mean; without such presses it grows from 0.38 deg to 0.74 at
  1.3, and from 2 mm on it is 0.55 at 1.1, where the paper speaks of 1.5. Its force is 0.042 N off without any noise,
  which is what the cubic leaves, and all noise up to 1.3 adds no more than 0.046 N to that (in squares): 0.09 to
  0.15 N lies where it no longer finds the markers. A force gauge's own errors and silicone that creeps would add to it;
  neither is in the simulation. The noise, 1.1, was chosen on another barrel, where their angle was 0.8 deg at 1.0 and
  1.9 deg at 1.2. At 1.4 ours refuses to calibrate this unit: it does not find 24 markers.
- **Their force knows one body.** The cubic of the plate's presses is wrong by newtons under a narrower body: the third
  one here, and the tips of "several contacts".
- **A plate at 9 and 10 mm** covers 60 degrees, and is taken for one contact throughout, which it was not before the
  prior of the response was chosen by its evidence.
- **Several contacts.** Numbers are right throughout, from 20 degrees on. A neighbour's dent carries the skin along by
  some 0.7 degrees, which is taken off; what is left of responses that do not quite add up the intervals know by a
  constant (`shift`, 0.5 degrees, chosen on other units), which at 20 to 40 degrees is more than it needs to be: they
  hold 98 to 100 %. Tips that pull at the skin between them (0.24 of their force) look much like tips that press harder;
  what neighbours leave is expected now, with the friction that the calibration showed, and three and four err by 1.7
  and 1.9 times as much as one (2.3 before). That is as well as the markers of one frame tell: on other units a fit that
  is told each shear to 0.05 of the force errs 2.0 times as much for four. There three and four come out at 2.4 and 2.8
  times (3.7 and 2.8 before), and two 60 degrees apart at 1.9 (1.5 before); here these went from 1.5 to 2.0. With no
  friction at all, unless that is stated (`friction`, see docs/marker_ring.md), or with one of several dragged, the
  forces are told less well than before. Theirs errs by 3 to 16 degrees below 50 degrees, as the paper's 49.54 says.
- **Intervals** are judged on 2,040 contacts of five units, since presses of one share the errors of its calibration:
  those of the force hold 93.8 % (97.5 % on this unit alone, 91.5 to 94.8 on the others), those of the angle 96.4 %:
  97.1 % before plain and dragged presses were told apart (docs/marker_ring.md), and the angle's errors were 0.39 deg
  for the plate and 0.47 for the third body then.
- **Moving.** Blur costs little: the error of a frame hardly depends on the speed, for both. What grows with the speed
  is what happens between two frames, for both alike, and there is the paper's limit of 40 mm/s.
- **Trouble.** Theirs needs all markers, and a colour as it was. Ours sees all markers of clean frames. Where
  the spurious blobs flicker, its labels were wrong in 7 of 4,800 frames of five units (1 of 960 on this one) before the
  area and the second moments of a blob were asked whether another has run into it, which puts the two 2 to 4 px off:
  none is since, of the same frames, some of which were looked at to find this; 1 of 2,880 on three other units,
  counted by a script that is not kept.
- **Another unit.** With 24 touches that begin from the first unit's model, both come within 1.2 times of a full
  calibration.
"""
