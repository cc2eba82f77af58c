"""README.md of this folder: theirs beside ours, what was asked, what differs and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap

from experiments.check import Check, table

__all__ = ["UNITS", "page"]


UNITS = {
    "position_rmse": (1e6, "um"),
    "position_max": (1e6, "um"),
    "force_rmse": (1e3, "mN"),
    "torque_rmse": (1e3, "N mm"),
    "position_ratio": (1.0, ""),
}


def page(checks: Sequence[Check], tables: str, remarks: Mapping[str, str]) -> str:
    """The whole page.

    Args:
        checks: what was asked.
        tables: table I on each bench, as Markdown.
        remarks: sentences on the indentation that was fitted ("law"), on ours where it knows that there is no torque
            ("told"), and on lighter touches ("lighter").
    """
    asked = table(("figure", "paper", "ours", "asked", ""), [check.cells() for check in checks])
    wrapped = {name: "\n  ".join(wrap(words, 117)) for name, words in remarks.items()}
    return _PAGE.format(asked=asked, tables=tables, **wrapped)


_PAGE = """# A fingertip on force cells: table I and figure 7 of `load cells`

Written by `python -m experiments.load_cells`; what it asks for stands in [expected.toml](expected.toml).

The paper has a real bench. This one is simulated (`palpate_lab.simulation.load_cell_bench`), from the same apparatus:
an ellipse of 14 x 5 mm, |y| <= 16 mm, on four triaxial cells; a ball of 4 mm diameter that slides over it along eight
paths at 2.5 mm/s, pressed from 1 N on; 1 kHz, all signals behind a second-order low-pass at 100 Hz; 17 mN of noise in
the reference. One run calibrates; another one, with other noise, bias and friction, verifies. Positions are compared
with where the ball's centre stands over the undeformed surface, forces with the reference, as the paper does, and with
the truth behind the same filter. `--seed N` tries other cells, and writes nothing.

## What was asked

{asked}

## Table I

Signed means of components; largest sizes. Samples from 1 N on. Without "truth", forces are compared with the reference.

{tables}

{lighter}

## Figure 7

![The eight paths, as they were and as they were found](paths.png)

Black is where the ball went; the errors of what was found are drawn 20 times as large.

![Force over one path](forces.png)

Above, the force that was found; below, its error against the truth, and in grey that of the reference.

## What differs, and why

- **Noise.** "A measurement noise of only 2 mN" is read in two ways: an axis of the array's force (1 mN a
  cell), and an axis of each cell. On a rigid surface nothing else is left, and the paper's 141 um comes from neither.
- **Soft layer.** The paper's surface is a soft print of which no thickness is given. Here it is an elastic foundation
  of 3e8 N/m^3, with friction that wanders between 0.1 and 0.6. The ball sinks in, its friction acts where the
  *deformed* surface is, and the line of action meets the undeformed one beside the ball. The force range was chosen so
  that on this bench the paper's own estimator errs by about what the paper published (with seeds 1 to 5 it errs 115 to
  128 um, and ours 27 to 29); ours is judged on it, not tuned to it.
  {law}
- **Drift.** 0.5 mV on every channel, one standard deviation, between the start of a trajectory and its end: five times
  the noise of a channel. No estimator can know it, and it dominates.
- **The paper's estimator** is (18) as printed: single sensitivities and places of the cells in one nonlinear least
  squares, from places as drawn. Newtons and metres cannot be added: with metres it leaves the positions nearly free and
  goes astray, so it is given millimetres, which favours it. It takes for granted that there is no torque, where ours
  finds one, and so has one unknown less.
  {told}
- **Paths.** The text does not say what figure 6 shows: three paths along y, three along x and two across that meet them
  are our reading. Nor does it give the cantilever's stiffness: 2 N/mm takes the force to 5 N, the end of the range that
  it states.
- **Force.** Against the reference, ours and theirs both show the reference's noise, 17 mN an axis; the paper's 41.5 mN
  is more than that. Against the truth the error is that of the cells.
"""
