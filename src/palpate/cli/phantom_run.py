"""A probe held on the simulated phantom: the lab, the controller of one method, and what happened."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.calibration.payload import identify_payload
from palpate.contact import Locator, WrenchEstimator
from palpate.control.align import AlignController
from palpate.control.arm import Arm
from palpate.control.law import MotionLaw
from palpate.control.probe_face import ProbeFace
from palpate.control.servo import Servo
from palpate.control.supervisor import Limits
from palpate.io.arm import load_arm
from palpate.sensors.compensation import Compensation
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.simulation.phantom.elfin3 import urdf
from palpate.simulation.phantom.lab import LabSettings, PhantomLab, Reading, Truth
from palpate.simulation.phantom.probes import Probe
from palpate.surfaces.mesh import Mesh

__all__ = ["Moment", "controller_for", "moments", "phantom_arm", "phantom_estimator"]

FORCE = 7.0  # N, of the paper
ACCURATE = (0.04, 0.04, 0.04, 1.5e-3, 1.5e-3, 1.5e-3)  # N, N m: what the sensor's maker states


@dataclass(frozen=True, eq=False)
class Moment:
    """One period of the sensor: what was read, what was commanded, and what was so."""

    reading: Reading
    command: Float[np.ndarray, " n"]
    truth: Truth


def phantom_arm(probe: Probe) -> Arm:
    """The arm as its URDF describes it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(urdf(probe), encoding="utf-8")
        return load_arm(file, "base", "ft_sensor")


def phantom_payload(lab: PhantomLab) -> Payload:
    """Of the probe, identified in free poses as one would."""
    wrenches, rotations = lab.free_wrenches()
    return identify_payload(wrenches, rotations, noise=np.array(ACCURATE) / 200**0.5)


def phantom_estimator(lab: PhantomLab, payload: Payload, **options: object) -> WrenchEstimator:
    """Contacts on the probe's mesh.

    Args:
        lab: whose probe.
        payload: of it.
        options: of the estimator.
    """
    mesh = Mesh.from_arrays(lab.probe.vertices, lab.probe.faces)
    return WrenchEstimator(Locator(mesh), Compensation(ForceTorque(ACCURATE), payload), **options)  # pyright: ignore


def controller_for(lab: PhantomLab, law: Callable[[ProbeFace], MotionLaw] | None = None, limits: Limits | None = None) -> AlignController:
    """The product's controller for a lab that is set up."""
    estimator = phantom_estimator(lab, phantom_payload(lab))
    face = ProbeFace.of(estimator.locator.surface)
    return AlignController(
        phantom_arm(lab.probe), estimator, FORCE, face=face, servo=Servo(lag=lab.settings.lag),
        limits=limits, law=None if law is None else law(face),
    )


def moments(lab: PhantomLab, controller: AlignController, seconds: float) -> Iterator[Moment]:
    """The loop, one period of the sensor after the other."""
    reading = lab.reading
    while reading.time < seconds:
        command = controller.update(reading.time, reading.wrench, reading.joints)
        lab.command(command)
        yield Moment(reading, command.copy(), lab.truth())
        reading = lab.step()
