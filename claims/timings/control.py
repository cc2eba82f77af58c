"""A cycle of the control loop, wrench in and joint command out, beside the 20 ms of the paper's loop."""

import gc
import time
from collections.abc import Iterator

import numpy as np

import palpate
from claims.row import Row
from palpate.contact.estimate import ROW
from palpate.control.align import AlignController
from palpate.control.arm import Arm
from palpate.control.servo import Servo, ServoModel
from palpate.control.supervisor import State
from palpate.sensors.force_torque.compensation import Compensation
from palpate_lab.simulation.shapes import Superquadric

MIDDLE, LATE = 100.0, 500.0  # us, p50 and p99 of a cycle
PAPER = "the paper's loop takes 20 ms, its estimate alone 0.57 +- 0.31"
FACE, TIP = (
    (0.0346, 0.019, 0.02),
    0.15,
)  # m: half-axes of an ellipsoid, of radii 60 and 18 mm at its end; how far that is
STIFFNESS, WANTED, NOISE = 2240.0, 7.0, [0.04] * 3 + [0.0015] * 3
PAYLOAD = palpate.Payload(np.array([0.0, 0.0, -3.4]), np.zeros(3), np.array([0.0, 0.0, 0.08]), np.zeros(3))


def elbow_arm() -> Arm:
    """Six joints that turn about z, y, y, z, y, z, with lengths and speeds of Elfin3; upright at zero."""
    heights = (0.19, 0.03, 0.266, 0.12, 0.12, 0.05, 0.04)
    axes = np.eye(3)[[2, 1, 1, 2, 1, 2]]
    places = palpate.Pose(np.tile(np.eye(3), (7, 1, 1)), [[0.0, 0.0, height] for height in heights])
    names = tuple(f"joint{k}" for k in range(1, 7))
    return Arm(names, places, axes, np.full(6, True), *np.outer([-3.0, 3.0, 1.57], np.ones(6)))


def bent() -> np.ndarray:
    return np.array([0.1, 0.3, 1.6, 0.0, np.pi - 1.9, 0.2])


class Press:
    """A robot that follows its servo exactly, and an ellipsoid at its sensor on a spring that moves up, down and about.

    Args:
        arm: see there.
        servo: see there.
        height: [m] of the ellipsoid's end above the spring at the start.

    Attributes:
        lift: [m] by which the spring is higher than it would be.
        force: [N] that presses, at the last reading, without noise.
        angle: [rad] between the probe's axis and the spring's normal then.
    """

    def __init__(self, arm: Arm, servo: Servo, height: float = 0.002) -> None:
        self.arm, self.robot, self.rng = arm, ServoModel(servo, len(arm.names)), np.random.default_rng(1)
        self.robot.start(0.0, bent())
        self.period, self._fed, self._next = servo.period, bent(), 0.0
        pose = arm.pose(bent())
        self.lift, self._moved = 0.0, np.zeros(12)
        self.force, self.angle = 0.0, 0.0
        self._under = pose.apply(np.array([0.0, 0.0, TIP])) - [0.0, 0.0, height]

    def read(self, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Wrench with noise, and the joints' newest feedback."""
        self.robot.advance(now)
        if now >= self._next:
            self._fed, self._next = self.robot.joints.copy(), now + self.period
        pose = self.arm.pose(self.robot.joints)
        lean, lift = 0.1 * np.sin(0.6 * now), self.lift + 0.002 * np.sin(1.1 * now)
        normal = np.array([np.sin(lean), 0.0, np.cos(lean)])
        down = -pose.rotation.T @ normal
        scaled = np.array(FACE) * down
        touch = np.array(FACE) * scaled / np.linalg.norm(scaled) + [0.0, 0.0, TIP - FACE[2]]
        deep = max(0.0, float((self._under + np.array([0.0, 0.0, lift]) - pose.apply(touch)) @ normal))
        self.force, self.angle = STIFFNESS * deep, float(np.arccos(np.clip(down[2], -1.0, 1.0)))
        robot = self.robot
        self.arm.motion_into(
            robot.joints, robot.speeds, robot.accelerations, np.array(PAYLOAD.center_of_mass), self._moved
        )
        inertia = PAYLOAD.mass * self._moved[6:9]
        force, weight = -STIFFNESS * deep * down, pose.rotation.T @ (PAYLOAD.weight - inertia)
        torque = np.cross(touch, force) + np.cross(PAYLOAD.center_of_mass, weight)
        return np.concatenate([force + weight, torque]) + self.rng.normal(size=6) * NOISE, self._fed


def press(arm: Arm, servo: Servo) -> AlignController:
    """The controller of such a press, on a mesh of 20,000 facets."""
    vertices, faces = Superquadric(FACE, (1.0, 1.0)).mesh(20_000)
    mesh = palpate.Mesh.from_arrays(vertices + np.array([0.0, 0.0, TIP - FACE[2]]), faces)
    sensor = Compensation(palpate.ForceTorque(NOISE), PAYLOAD)
    return AlignController(
        arm, palpate.WrenchEstimator(palpate.Locator(mesh), sensor), WANTED, servo=servo, inertia=np.zeros((3, 3))
    )


def _cycles(rate: float, servo: Servo, seconds: float, *, paced: bool) -> tuple[np.ndarray, np.ndarray, float]:
    """Times [us] of the cycles that hold, whether each gave a command, and the mean error of the force [N]."""
    arm = elbow_arm()
    controller, plant = press(arm, servo), Press(arm, servo)
    took, commands, errors, begin, sent = list[float](), list[bool](), list[float](), time.perf_counter(), bent()
    gc.disable()
    for k in range(round(seconds * rate)):
        now = k / rate
        wrench, joints = plant.read(now)
        while paced and (left := begin + now - time.perf_counter()) > 0:
            time.sleep(left)
        before = time.perf_counter_ns()
        command = controller.update(now, wrench, joints)
        after = time.perf_counter_ns()
        anew = not np.array_equal(command, sent)
        if anew:
            sent = command.copy()
            plant.robot.send(now, sent)
        if controller.state == State.HOLD:
            took.append(1e-3 * (after - before))
            commands.append(anew)
            errors.append(abs(float(np.linalg.norm(controller.contact[ROW.force])) - WANTED))
    gc.enable()
    return np.array(took), np.array(commands), float(np.mean(errors)) if errors else float("nan")


def rows(small: bool) -> Iterator[Row]:
    """At each rate twice: cycle after cycle, which is judged; and paced by the clock, sleeping in between.

    What a processor that is shared forgets while it sleeps is the machine's, and is reported.
    """
    fast = Servo(period=0.002, delay=0.002, ramp=0.002, lag=0.01)
    for rate, servo in ((200.0, Servo()), (500.0, fast)):
        each = f"{rate:g} Hz, commands at {1.0 / servo.period:g} Hz"
        for paced in (False, True):
            took, commands, error = _cycles(rate, servo, 5.0 if small else 15.0, paced=paced)
            what = f"a cycle at {each}, " + ("sleeping in between" if paced else "one after the other")
            if not len(took):
                yield Row(what, "holds", "never held", False)
                continue
            middle, late = np.percentile(took, [50, 99])
            got = f"p50 {middle:.0f} us, p99 {late:.0f} us; with a command p50 {np.median(took[commands]):.0f} us"
            got += f" ({PAPER}; force off by {error:.2f} N on average)"
            target = "" if paced else f"<= {MIDDLE:g} us p50, <= {LATE:g} us p99"
            yield Row(what, target, got, None if paced else middle <= MIDDLE and late <= LATE)
