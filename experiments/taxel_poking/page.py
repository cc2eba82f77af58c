"""README.md of this folder: theirs beside ours, what was asked, what differs and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from evidence.machine import machine
from experiments.check import Check, table

__all__ = ["FINAL", "SAID_4", "SAID_5", "SINGLES", "page"]

SINGLES = {"free": (8.1e-3, 18.5e-3), "surface": (5.2e-3, 19.3e-3)}  # m, least and largest mean of a dataset
FINAL = {"free": (4.2e-3, 10.2e-3), "surface": (3.7e-3, 9.5e-3)}  # m, final mean -+ its deviation over taxels
SAID_4 = {"free": "8.1 +- 4.2 to 18.5 +- 8.3", "surface": "5.2 +- 3.1 to 19.3 +- 13.1"}
SAID_5 = {"free": "7.2 +- 3 after all seven", "surface": "6.6 +- 2.9 after all seven"}


def page(checks: Sequence[Check], tables: Mapping[str, str], took: float, pokes: int) -> str:
    """The whole page.

    Args:
        checks: what was asked.
        tables: "singles", "running", "together", "alone", "slow", as Markdown.
        took: [s].
        pokes: of a session.
    """
    asked = table(("figure", "paper", "ours", "asked", ""), [check.cells() for check in checks])
    lines = "\n".join(f"- {line}" for line in [*machine(), f"{took:.0f} s in all"])
    return _PAGE.format(asked=asked, machine=lines, pokes=f"{pokes:,}", **tables)


_PAGE = """# Where taxels sit, from the wrenches of pokes: figures 4 and 5 of `taxel poking`

Written by `python -m experiments.taxel_poking`; what it asks for stands in [expected.toml](expected.toml).

{machine}

The paper has a real arm; its recordings are not public. This one is simulated (`palpate_lab.simulation.poke_bench`): 84
taxels on seven modules of an iCub-like forearm, the paper's seven datasets at its joint angles, {pokes} pokes by a flat
tip of 4 x 4 mm, shared among the datasets by their minutes. Truth is where the taxels were put.

**The paper's figures are a fit here, not a prediction.** The paper states neither its errors nor how the tip was held.
The errors of sensor and robot (`MIX`) are those of an earlier prototype; the cone of forces (`HAND`, 30 degrees) and
the pokes a minute (40) were chosen among about fifteen settings so that the paper's own methods give about what the
paper published, on other seeds than these, from 200 on. One session is worth little: see the ranges in brackets. What
is *not* fitted are the methods beyond the paper's, on the same pokes.

## What was asked

Millimetres, but for ratios.

{asked}

## Figure 4: each dataset alone [mm]

Mean over the taxels +- their standard deviation, averaged over the sessions; in brackets the least and largest mean of
a session. The paper draws its bars without numbers; its text gives the ranges. Taxels that a dataset never reached are
left out of it.

{singles}

![Errors of single datasets](figure_4.png)

Bars: the mean of all sessions, with the deviation over taxels; dots: sessions; grey: the paper's range.

## Figure 5: datasets 1 to n averaged [mm]

{running}

![Errors after averaging](figure_5.png)

Grey: the paper's final mean, and its deviation.

## All datasets together, all errors [mm]

*averaged, surface* is the paper's best; *pooled* puts the normal equations of all datasets into one (no claim is made
for it); *modules* are seven rigid modules on the surface, estimated with bias, frames, common frame and cross-talk
under priors as wide as the errors that were drawn, from nothing or from CAD that is 3 mm and 5 deg off. *relative* is
what is left once one rigid motion of all taxels is taken off. *expected* is the rms that the covariance says: with
priors as the errors were drawn, the Bayesian Cramer-Rao bound. "times better": than the first row.

{together}

Taxel by taxel (`taxels`), without modules, of fewer pokes and sessions because it is slow:

{slow}

## One error at a time [mm]

Noise of a poke is in all of them; the priors know which errors there are.

{alone}

## What differs, and why

- **Surface.** Ours helps more than the paper's (its 7.2 became 6.6 mm). Here the surface is exactly that on which the
  taxels lie, and points where a poke would pull are refused; how far the real cover is from its mesh is not told.
- **Absolute and relative.** What is left of modules is mostly one motion of all of them: of the frames, the common
  frame and the sensor's gain, a part cannot be told from a slide of the whole skin ("relative" is without it). With
  noise alone, or with a bias, there is no such part, and modules are several times better than averaging.
- **Sessions differ.** From nothing one slide of a session is most of its error, so that the ratio of twenty sessions
  scatters by 0.35: 1.95 of these, 2.16 +- 0.18 of eighty others (2,000 pokes each, a script that is not kept; the same
  pokes before contacts were taken as Berkson has errors: 2.04 and 2.23, with modules a quarter worse to each other).
- **Taxel by taxel** there are two unknowns a taxel where modules have three for twelve: it needs more pokes.
"""
