"""Run a probe on the simulated phantom: the lab, the controller of one method, and the recorded moments."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.contact import Locator, WrenchEstimator
from palpate.control.align import AlignController
from palpate.control.arm import Arm
from palpate.control.probe_face import ProbeFace
from palpate.control.servo import Servo
from palpate.control.stability import Admittance
from palpate.control.supervisor import Limits
from palpate.files.arm import load_arm
from palpate.sensors.force_torque.calibrate import identify_payload
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals.filters import Kalman
from palpate.signals.payload import Payload
from palpate.surfaces.mesh import Mesh
from palpate_lab.papers.probe_law import Plain
from palpate_lab.simulation.phantom.elfin3 import urdf
from palpate_lab.simulation.phantom.lab import PhantomLab, PhantomTruth, Reading
from palpate_lab.simulation.phantom.probes import Probe

FORCE = 7.0  # N, of the paper
METHODS = ("ours", "paper")
PAPER_PUSH = (10.0, 282.0)  # kg, N s/m of (7): not in the paper; fitted to its T = 10 s (claims/papers/moving_phantom)
PAPER_TURN = 2.6  # rad/s of (8): likewise, to the mean in-plane angle
STIFFEST = 2500.0  # N/m of the phantom
SAMPLES = 200  # averaged in each free pose
ACCURATE = (0.04, 0.04, 0.04, 1.5e-3, 1.5e-3, 1.5e-3)  # N, N m: what the sensor's maker states


@dataclass(frozen=True, eq=False)
class PhantomMoment:
    """A period of the sensor: the reading, the command, and the truth."""

    reading: Reading
    command: Float[np.ndarray, " n"]
    truth: PhantomTruth


def phantom_arm(probe: Probe) -> Arm:
    """Return the `Arm` from base to ft_sensor with a probe, as its URDF describes it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(urdf(probe), encoding="utf-8")
        return load_arm(file, "base", "ft_sensor")


def phantom_payload(lab: PhantomLab) -> Payload:
    """Identify the probe's `Payload` from wrenches in free poses, as a user would."""
    wrenches, rotations = lab.free_wrenches(samples=SAMPLES)
    return identify_payload(wrenches, rotations, noise=np.array(ACCURATE) / SAMPLES**0.5)


def controller_for(lab: PhantomLab, method: str = "ours", limits: Limits | None = None) -> AlignController:
    """Return the product's `AlignController` for a lab; it is calibrated there and knows nothing of the truth.

    Args:
        lab: lab that was just started.
        method: one of `METHODS`: ours, or the paper's with its filters.
        limits: limits of the controller's supervisor; None for the usual ones.
    """
    mesh = Mesh.from_arrays(lab.probe.vertices, lab.probe.faces)
    sensor, face = Compensation(ForceTorque(ACCURATE), phantom_payload(lab)), ProbeFace.of(mesh)
    servo, rate = Servo(lag=lab.settings.lag), float(lab.settings.sensor_rate)
    law, filter = None, None
    if method == "paper":
        filter = Kalman()
        pushing, lag = Admittance(*PAPER_PUSH), float(filter.delay(0.0, rate))
        law = Plain(face, FORCE, pushing, PAPER_TURN, stiffest=STIFFEST, servo=servo, rate=rate, smoothing=lag)
    estimator = WrenchEstimator(Locator(mesh), sensor, filter=filter, rate=rate)
    arm = phantom_arm(lab.probe)
    return AlignController(arm, estimator, FORCE, face=face, servo=servo, limits=limits, law=law)


def moments(lab: PhantomLab, controller: AlignController, seconds: float) -> Iterator[PhantomMoment]:
    """Run the loop until a time [s], and yield a `PhantomMoment` for each period of the sensor.

    Raises:
        RuntimeError: the engine warned, and its results cannot be trusted.
    """
    reading = lab.reading
    while reading.time < seconds:
        command = controller.update(reading.time, reading.wrench, reading.joints)
        lab.command(command)
        yield PhantomMoment(reading, command.copy(), lab.truth())
        reading = lab.step()
