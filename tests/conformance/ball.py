"""A sensor that Palpate does not know, in one file: 200 taxels anywhere on a sphere, a TaxelBody.

Each taxel reads the force along its normal, by a gain that is the same for all: `palpate calibrate ball` finds it, and
its model names it in the rig. There are no rows and columns, and no seam.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.calibration.validation import cross_validate
from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import Log, Output
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.models import read_model
from palpate.files.models.model import Model
from palpate.files.schema import Key, TableForm
from palpate.files.tables.table import read_table
from palpate.files.units import measured
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import examine
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.layer import TaxelLayer
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.section import SKIN
from palpate.sensors.taxels.view import TaxelView
from palpate.setup.built import BuiltEstimator, Guess
from palpate.setup.setup import Setup
from palpate.setup.view import LayerData
from palpate.setup.wrench import noted_filter
from palpate.signals.recording import CELLS
from palpate.viewer.scene import Layer

COUNT, RADIUS, NOISE = 200, 0.05, 0.003  # taxels, m, N
COLUMNS = tuple(f"t{k}" for k in range(COUNT))


def directions() -> np.ndarray:
    """(200, 3) outward normals, spread evenly, in no order that a sheet would have."""
    z = 1.0 - (2.0 * np.arange(COUNT) + 1.0) / COUNT
    turn, flat = np.pi * (3.0 - 5**0.5) * np.arange(COUNT), np.sqrt(1.0 - z**2)
    return np.random.default_rng(0).permutation(np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z]))


@dataclass(frozen=True)
class RigBall:
    """[ball] of a rig: `tare` [s] at the start in which nothing touches; `model`, a file of the gain."""

    tare: float | None = None
    model: str | None = None


@dataclass(frozen=True)
class BallGain:
    """Readings of a newton, with their deviation."""

    gain: float
    deviation: float
    provenance: Mapping[str, str] = field(default_factory=lambda: {})


GAIN = Model(
    BallGain,
    "the gain of a ball",
    "Readings of a newton on a ball of taxels.",
    "palpate calibrate ball",
    lambda found: [
        ("gain", measured([found.gain], [found.deviation], "readings/N")),
        ("share", f"{found.deviation / found.gain:.2%} of it is not known"),
    ],
    {BallGain: TableForm({"gain": Key("readings/N", least=0.0), "deviation": Key("of it"), "provenance": Key()})},
)


@dataclass(frozen=True)
class CalibrateBall(Calibration):
    """Find the gain of a ball of taxels from presses that a scale measured.

    Args:
        log: CSV with t0 to t199, and force [N] of the scale.
        output: gain.toml to write.
    """

    log: Log
    output: Output

    def identify(self) -> CalibrationResult:
        """Fit the sum of the readings to the force of the scale."""
        values, _ = read_table(self.log).numbers([*COLUMNS, "force"])
        total, force = values[:, :-1].sum(axis=1), values[:, -1]

        def fitted(rows: np.ndarray) -> tuple[float, float]:
            square = float(force[rows] @ force[rows])
            gain = float(force[rows] @ total[rows]) / square
            return gain, float(np.var(total[rows] - gain * force[rows])) / square

        def predict(left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (part, own), (rest, others) = fitted(left), fitted(~left)
            return np.array([part - rest]), np.array([[own + others]])

        (gain, variance), left = fitted(np.ones(len(force), dtype=bool)), cross_validate(len(force), predict, blocks=20)
        model = BallGain(gain, (variance * left.widening) ** 0.5, self.record())
        return CalibrationResult(
            [*GAIN.summary(model), ("left out", str(left))], model, next=["name it: model = FILE in [ball]"]
        )


def build(setup: Setup) -> BuiltEstimator:
    """Return the estimator; what is at rest is seen at the start of the log."""
    body, head = TaxelBody.anywhere(RADIUS * directions(), directions()), setup.head
    tare = setup.estimate.tare or setup.sensors["ball"].table.tare
    health = None if head is None else examine(head, body, seconds=tare)
    smooth, rate = setup.smoothing()
    intensity, model = None, setup.sensors["ball"].table.model
    if model is not None:
        gain = read_model(setup.link.folder / model, BallGain)
        intensity = Intensity((Curve("polynomial", [gain.gain], [[gain.deviation**2]], largest=20.0),))
    estimator = TaxelEstimator(
        body, intensity, health, settings=setup.contacts, filter=smooth.filter(), rate=rate, mount=setup.link.mount
    )
    return BuiltEstimator(estimator, notes=noted_filter(smooth, rate), settings={"tare": tare})


LAYOUT = LogLayout(wrench=None, arrays=(ArrayChannel(CELLS, (COUNT,), COLUMNS, table="ball"),))


class BallView(TaxelView):
    """Show the forces of the taxels on the ball."""

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
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
    paths=("model",),
    view=f"{__name__}.BallView",
    start=lambda setup: setup.estimate.tare or setup.sensors["ball"].table.tare or 1.0,
)
