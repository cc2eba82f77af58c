"""Show a six-axis force/torque sensor in the report: payload, mounting, and advice that improves its answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.files.models import MODELS
from palpate.files.units import measured
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.section import ForceTorqueSection
from palpate.setup.setup import Setup
from palpate.setup.wrench_view import WrenchView
from palpate.signals.payload import Payload
from palpate.spatial.pose import Pose, skew
from palpate.viewer.report import Section
from palpate.viewer.run_report import Run

BLURRED = 1e-3  # m: radius of the median ellipse above which a filter is worth its lag


class ForceTorqueView(WrenchView):
    """The report's view of a six-axis force/torque sensor."""

    def compensated(self, estimator: WrenchEstimator) -> str:
        """Return "with a payload model" or "without a payload model"."""
        return f"{'without' if _payload(estimator) is None else 'with'} a payload model"

    def uncertain(self, setup: Setup, estimator: WrenchEstimator) -> tuple[str, ...]:
        """Return the names of the uncertainties in the ellipses, other than the noise, as a tuple."""
        held = super().uncertain(setup, estimator)
        return held if _payload(estimator) is None else ("the payload's", *held)

    def sections(self, run: Run, setup: Setup, estimator: WrenchEstimator) -> Run:
        """Return the `Run` with a section on payload and mounting before its others, and with advice."""
        payload, filtered = _payload(estimator), estimator.filter is not None
        advice = wrench_advice(setup, payload=payload is not None, filtered=filtered, radius=run.kept.median_radius)
        section = force_torque(setup, payload, estimator.mount)
        return replace(run, sections=(section, *run.sections), advice=advice)


def _payload(estimator: WrenchEstimator) -> Payload | None:
    return estimator.sensor.payload if isinstance(estimator.sensor, Compensation) else None


def wrench_advice(setup: Setup, *, payload: bool, filtered: bool, radius: float) -> tuple[str, ...]:
    """Return advice on how to improve a force/torque sensor's answers, a string each in a tuple; () if there is none.

    Args:
        setup: setup that includes the options of the command line.
        payload: whether a payload is compensated.
        filtered: whether a filter is used.
        radius: [m] median of the 95 % ellipses; NaN where there is none.

    Raises:
        InputError: the rig has no [force_torque].
    """
    table = setup.of(ForceTorqueSection).table
    advice = {
        "Identify the payload (palpate calibrate payload): the wrenches still contain its weight and the sensor's "
        "zero.": not payload and setup.estimate.tare is None,
        "Calibrate the mounting (palpate calibrate mounting): the pose of the surface was taken as exact, and the "
        "ellipses do not include its error.": setup.link.mount_covariance is None,
        "State the noise of the sensor in the rig: it was taken from the log.": table.noise is None,
        "State the range of the sensor in the rig: without it a saturated channel is not noticed.": table.range is None,
        f"Half of the 95 % ellipses are larger than {1e3 * radius:.2g} mm, and no filter is in force: "
        "palpate inspect LOG --rig RIG --spectrum FILE proposes one.": not filtered and radius > BLURRED,
    }
    return tuple(sentence for sentence, needed in advice.items() if needed)


def force_torque(setup: Setup, payload: Payload | None, mount: Pose) -> Section:
    """Return the `Section` of the report on payload, mounting, wrench and orientation.

    Raises:
        InputError: the rig has no [force_torque].
    """
    none = [("payload", "none: wrenches are taken as they are")]
    facts = none if payload is None else list(MODELS["payload"].summary(payload))
    facts += _mounting(mount, setup.link.mount_covariance)
    wrench, orientation = setup.of(ForceTorqueSection).table, setup.orientation
    facts.append(("wrench", f"in the {wrench.frame}'s frame, logged axes {', '.join(wrench.axes)}"))
    if orientation.topic is not None or orientation.base is not None or orientation.offset:
        gap = f"gaps of up to {orientation.max_gap:g} s are interpolated"
        facts.append(("orientation", f"clock offset {1e3 * orientation.offset:g} ms; {gap}"))
    return Section("Payload and mounting", settings=tuple(facts))


def _mounting(pose: Pose, covariance: Float[np.ndarray, "6 6"] | None) -> list[tuple[str, str]]:
    place, turn = 1e3 * pose.translation, np.degrees(pose.rotation_vector())
    if covariance is None:
        stated = (("mounting", place, "mm"), ("turned by", turn, "deg"))
        return [
            (name, f"({', '.join(f'{v:z.2f}' for v in three)}) {unit}, not calibrated") for name, three, unit in stated
        ]
    moves = np.concatenate([-skew(pose.translation), np.eye(3)], axis=1)  # what a small motion does to the origin
    deviation = 1e3 * np.sqrt(np.diag(moves @ covariance @ moves.T).clip(min=0))
    turned = np.degrees(np.sqrt(np.diag(covariance)[:3].clip(min=0)))
    return [("mounting", measured(place, deviation, "mm")), ("turned by", measured(turn, turned, "deg"))]
