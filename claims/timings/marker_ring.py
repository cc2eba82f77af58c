"""From a decoded frame of a marker ring to contacts, beside the plain chain of OpenCV over the whole frame."""

from collections.abc import Iterator
from time import process_time

import numpy as np

from claims.clock import in_turns
from claims.papers.marker_ring.bench import calibrated
from claims.papers.marker_ring.theirs import spots
from claims.row import Row
from palpate.signals.recording import IMAGE, Recording
from palpate_lab.simulation.ring_session import Protocol, RingUnit, Touching, calibration_run, touching_run

ASKED, PAPER, ROUNDS = 1000.0, "18 to 23", 6  # frames a second, and the paper's on its board


def rows(small: bool) -> Iterator[Row]:
    """Both on the same frames in turns; of the rounds the median, in seconds of the processor."""
    unit = RingUnit.drawn(1, coarse=True)
    presses = calibration_run(unit, Protocol(12, (0.003, 0.006, 0.009), 0.01, 1, 1))
    estimator = calibrated(presses, unit.look).estimator
    session = touching_run(unit, Touching(touches=1 if small else 4, seed=1))
    log = Recording(session.time.copy(), {IMAGE: np.stack(list(session.frames()))})
    calls = {"ours": lambda: estimator.run(log), "opencv": lambda: [spots(frame) for frame in log.channels[IMAGE]]}
    took = in_turns(calls, 1 if small else ROUNDS, process_time)
    ours, chain = (len(log) / float(np.median(each)) for each in took.values())
    what = "from a decoded frame of 640 x 480 to contacts, frames a second on one core"
    got = f"{ours:,.0f} (OpenCV's chain to centroids alone {chain:,.0f}; the paper on its board {PAPER} Hz)"
    yield Row(what, f">= {ASKED:,.0f}", got, None if small else ours >= ASKED)
