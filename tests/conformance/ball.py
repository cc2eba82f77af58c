"""A sensor that Palpate does not know, in one file: 200 taxels anywhere on a sphere, a TaxelBody.

Each taxel feels the force along its normal, in newtons. There are no rows and columns, and no seam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.cli.views.taxels import TaxelView
from palpate.cli.views.view import Kept
from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.rig.kind import Guess, Prepared
from palpate.io.rig.setup import Setup
from palpate.io.rig.skin import SKIN
from palpate.io.rig.wrench import noted_filter
from palpate.sensors.recording import CELLS
from palpate.sensors.taxel_health import examine
from palpate.sensors.taxels import TaxelBody
from palpate.viewer.scene import Layer
from palpate.viewer.taxels import TaxelLayer

COUNT, RADIUS, NOISE = 200, 0.05, 0.003  # taxels, m, N
COLUMNS = tuple(f"t{k}" for k in range(COUNT))


def directions() -> np.ndarray:
    """(200, 3) outward normals, spread evenly, in no order that a sheet would have."""
    z = 1.0 - (2.0 * np.arange(COUNT) + 1.0) / COUNT
    turn, flat = np.pi * (3.0 - 5**0.5) * np.arange(COUNT), np.sqrt(1.0 - z**2)
    return np.random.default_rng(0).permutation(np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z]))


@dataclass(frozen=True)
class RigBall:
    """[ball] of a rig: `tare` [s] at the start in which nothing touches."""

    tare: float | None = None


def build(setup: Setup) -> Prepared:
    """Return the estimator; what is at rest is seen at the start of the log."""
    body, head = TaxelBody.anywhere(RADIUS * directions(), directions()), setup.head
    tare = setup.estimate.tare or setup.sensors["ball"].table.tare
    health = None if head is None else examine(head, body, seconds=tare)
    smooth, rate = setup.smoothing()
    estimator = TaxelEstimator(
        body, None, health, settings=setup.contacts, filter=smooth.filter(), rate=rate, mount=setup.link.mount
    )
    return Prepared(estimator, said=noted_filter(smooth, rate), facts={"tare": tare})


LAYOUT = Layout(wrench=None, arrays=(ArrayChannel(CELLS, (COUNT,), COLUMNS, table="ball"),))


class BallView(TaxelView):
    """Show the forces of the taxels on the ball."""

    def layers(self, setup: Setup, kept: Kept, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return the taxels with their forces."""
        body = TaxelBody.anywhere(RADIUS * directions(), directions())
        return (TaxelLayer(body, kept.joined(), live is not None),)


BALL = replace(
    SKIN,
    name="ball",
    called="taxels on a ball",
    table=RigBall,
    layout=lambda setup: LAYOUT,
    build=build,
    guess=lambda log, there, mesh: (
        Guess("t0 to t199", LAYOUT, "[ball]\n") if set(COLUMNS) <= set(there.names) else None
    ),
    paths=(),
    view=f"{__name__}.BallView",
    start=lambda setup: setup.estimate.tare or setup.sensors["ball"].table.tare or 1.0,
)
