"""A force held on a moving phantom with a payload that is 5 % off in weight and centre, against the right payload."""

from collections.abc import Iterator

import numpy as np

from claims.papers.moving_phantom.conditions import DIRECTIONS, sine
from claims.papers.moving_phantom.study import traces
from claims.row import Row

PERIODS, SEED, RATIO = (5, 2), 100, 1.3  # s of the motion; of mean angles


def rows(small: bool) -> Iterator[Row]:
    """Mean angle by direction and period, of the same seeds with either payload."""
    seeds = range(SEED, SEED + (1 if small else 20))
    for way in DIRECTIONS[:1] if small else DIRECTIONS:
        for period in PERIODS[:1] if small else PERIODS:
            conditions = [sine(f"{each}", way, period, seed=each) for each in seeds]
            wrong = [sine(f"{each} off", way, period, seed=each, variant="payload") for each in seeds]
            found = traces([*conditions, *wrong])
            right, off = (
                np.array([np.abs(t.error[t.steady]).mean() for each in some for t in found[each.name].traces])
                for some in (conditions, wrong)
            )
            ratio = off.mean() / right.mean()
            what = (
                f"payload 5 % off, {way}, T = {period} s, {len(seeds)} runs: mean angle [deg], and over the right one's"
            )
            got = f"{off.mean():.2f}, {ratio:.2f} (worst run {(off / right).max():.2f})"
            yield Row(what, f"<= {RATIO}", got, bool(ratio <= RATIO))
