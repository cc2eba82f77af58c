"""Read the tables of a skin, a force/torque sensor and their fusion in a rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.logs.layout import LogLayout
from palpate.sensors.force_torque.section import FORCE_TORQUE, compensation
from palpate.sensors.taxels.guess import guess_with_wrench
from palpate.sensors.taxels.section import SKIN, skin_tare
from palpate.setup.body import GivenBody
from palpate.setup.built import BuiltEstimator, Guess
from palpate.setup.setup import SensorKind, Setup
from palpate.signals.recording import AVERAGED, CELLS, FORCE, TORQUE, Recording

if TYPE_CHECKING:
    from palpate.sensors.fused.locator import FusionSettings

_TEXT = """\
[fusion]                             # of the skin and the sensor; friction is that of [estimate]
tangential = 0.25                    # deviation of tangential forces that is expected, as a share of the normal force
gain = 0.1                           # share by which the skin's forces may be off
alarm = 0.01                         # share of touches that may be thought to have an unseen contact, and have none
# covered = true                     # nothing touches the link but its skin

"""


@dataclass(frozen=True)
class RigFusion:
    """Rig table of the fusion: `palpate.sensors.fused.locator.FusionSettings` but friction, which is [estimate]'s.

    `covered`: the body is touched only on the skin.

    Raises:
        InputError: a key is out of its range.
    """

    tangential: float = 0.25
    gain: float = 0.10
    floor: float = 0.0
    alarm: float = 0.01
    covered: bool = False

    def __post_init__(self) -> None:
        self.settings(max(1.0, self.tangential))

    def settings(self, friction: float) -> FusionSettings:
        """Return `FusionSettings` with this bound of friction, and `tangential` at most as large.

        Raises:
            InputError: friction or a key of the table is out of its range.
        """
        from palpate.sensors.fused.locator import FusionSettings

        return FusionSettings(friction, min(self.tangential, friction), self.gain, self.floor, self.alarm)


def _layout(setup: Setup) -> LogLayout:
    """Return the layout of a log with the skin's frames, each with the mean of the wrenches about its time."""
    skin, wrench = SKIN.layout(setup), FORCE_TORQUE.layout(setup)
    kelvin, drift = skin.temperature or wrench.temperature, wrench.temperature or skin.temperature
    if kelvin != drift:
        what = f"[skin] and [drift] name two temperatures, {kelvin!r} and {drift!r}."
        raise InputError(what, where="rig", hint="Name one, in one of them or in both.")
    return replace(wrench, arrays=skin.arrays, rate=skin.rate, temperature=kelvin)


def _build(setup: Setup) -> BuiltEstimator:
    from palpate.sensors.fused.estimator import FusedEstimator  # here: to guess at a log needs none of them
    from palpate.sensors.fused.locator import FusedLocator
    from palpate.sensors.taxels.estimator import TaxelEstimator

    felt, head, link = SKIN.build(setup), setup.head, setup.link
    link.surface().prepared()  # once for all logs of a rig
    if not isinstance(felt.estimator, TaxelEstimator):
        raise InputError("must be a skin of taxels to be fused.", where="skin")
    sensor = compensation(setup, _single(head))
    known: RigFusion = setup.sensors["fusion"].table
    settings = known.settings(setup.estimate.friction)
    estimator = FusedEstimator(
        felt.estimator,
        sensor,
        FusedLocator(link.surface(), settings),
        link.mount,
        link.mount_covariance,
        setup.followed(6),
        known.covered,
        live=head is None,
    )
    made = BuiltEstimator(estimator, felt.notes, felt.warnings, {**felt.settings, **vars(settings), **link.settings})
    tare = skin_tare(setup)
    if head is not None and tare is not None:
        made.tared(sensor.tare(head.first(tare)))
    elif tare is None:
        made.notes.append(
            "wrenches are taken as they are, so they must be tared: if they are not, write tare = SECONDS in [estimate]"
        )
    return made


def _single(head: Recording | None) -> Recording | None:
    """Return the recording with the spread of single readings, for the noise of one."""
    if head is None:
        return None
    wrenches, count = head.wrenches(), np.maximum(head.channels[AVERAGED], 1.0)
    middle = np.nanmedian(wrenches, axis=0) if np.isfinite(wrenches).any() else np.zeros(6)
    spread = middle + (wrenches - middle) * np.sqrt(count)
    return replace(head, channels={**head.channels, FORCE: spread[:, :3], TORQUE: spread[:, 3:]})


def _guess(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    """Return the guess for a log with wrenches and frames of a skin; None where either is missing."""
    felt = guess_with_wrench(log, contents)
    found = None if felt is None else FORCE_TORQUE.guess(log, contents, body)
    if felt is None or found is None:
        return None
    why, remarks = f"{found.why}, and {felt.why}", (*found.remarks, *felt.remarks)
    text = f"{found.text}\n{felt.text}\n{_TEXT}"
    return replace(found, why=why, text=text, remarks=remarks, layout=replace(found.layout, arrays=felt.layout.arrays))


FUSION = SensorKind(
    name="fusion",
    called="a skin and a six-axis force/torque sensor on one link",
    table=RigFusion,
    channels=(CELLS, FORCE, TORQUE, AVERAGED),
    layout=_layout,
    build=_build,
    guess=_guess,
    parts=("skin", "force_torque"),
    refused={
        "method": "contacts are located by the skin",
        "torsion": "contacts are taken as forces without a torque of their own",
        "contact": "thresholds are those of each cell: on and off in [contacts], in deviations of its noise",
    },
    view="palpate.sensors.fused.view.FusedView",
    start=SKIN.start,
)
