"""The moving phantom's lab on a physics engine: an arm with a probe on a force/torque sensor, and soft tissue.

MuJoCo integrates the arm at 1 kHz and measures at its flange; the tissue is an elastic foundation (`_tissue.py`) whose
force is applied to the probe. The readings that a robot would get come out of `step`, the truth out of `truth`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import radians
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.pose import Pose
from palpate_lab.simulation.engine import engine
from palpate_lab.simulation.phantom.elfin3 import LINKS, READY, SENSOR, SPEED, mjcf
from palpate_lab.simulation.phantom.motion import SurfaceMotion
from palpate_lab.simulation.phantom.probes import Probe, probe

Six = tuple[float, float, float, float, float, float]

_STEP = 0.001  # [s] of the physics
_LIMITS = np.array([link.limit for link in LINKS])
_EFFORTS = np.array([link.effort for link in LINKS])


@dataclass(frozen=True)
class LabSettings:
    """The settings of the lab.

    Attributes:
        probe: convex, linear or t-shaped.
        motion: motion of the phantom.
        place: middle of its surface at rest, in the base [m].
        heading: angle of the probe's long side and of the phantom's x, about the base's z from its x [rad].
        stiffness: k of the tissue [N/m^3]; a cell bears p = k (d + tau d') where it is d below the surface.
        loss: tau [s].
        friction: Coulomb's coefficient of each cell.
        shear: tangential stiffness of a cell as a share of k: 2 (1 - nu)/(2 - nu) of a half space with nu = 0.5.
        force_noise, torque_noise, acceleration_noise: standard deviations [N], [N m], [m/s^2].
        bias: bias of the force/torque sensor at the start [N, N m].
        drift: rate of that bias [N/s, N m/s].
        ranges: readings at which the sensor saturates [N, N m].
        sensor_rate, robot_rate: rates [Hz].
        delay_cycles: cycles between the robot's taking a command and setting out for it.
        lag: lag of its servo [s], critically damped with a natural frequency of 2 / lag.
        acceleration: largest acceleration of the servo's reference, about what the torques allow [rad/s^2]; the maker's
            planner keeps to 12.56, a limit that commands have to observe.
        bandwidth: bandwidth of the computed torque by which the joints follow the servo's reference [rad/s].
        extra_delay: additional delay of every command, unknown to the controller [s].
        lost: share of the robot's cycles in which no command arrives.
        silence: start and length of a time without force/torque samples [s].
        accelerometer: its position in the sensor's frame [m].
        seed: seed of noise and losses.
    """

    probe: str = "convex"
    motion: SurfaceMotion = field(default_factory=SurfaceMotion)
    place: tuple[float, float, float] = (0.40, 0.0, 0.15)
    heading: float = np.pi
    stiffness: float = 2e6
    loss: float = 0.005
    friction: float = 0.3
    shear: float = 2.0 / 3.0
    force_noise: float = 0.04
    torque_noise: float = 1.5e-3
    acceleration_noise: float = 0.02
    bias: Six = (1.3, -0.8, 2.1, 0.03, -0.05, 0.02)
    drift: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    ranges: Six = (65.0, 65.0, 200.0, 5.0, 5.0, 5.0)
    sensor_rate: int = 200
    robot_rate: int = 50
    delay_cycles: int = 1
    lag: float = 0.030
    acceleration: float = 100.0
    bandwidth: float = 160.0
    extra_delay: float = 0.0
    lost: float = 0.0
    silence: tuple[float, float] = (0.0, 0.0)
    accelerometer: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that the numbers are possible.

        Raises:
            InputError: a rate does not divide 1000 Hz, or a number is out of its range.
        """
        for rate in (self.sensor_rate, self.robot_rate):
            if rate < 1 or 1000 % rate:
                raise InputError(f"a rate must divide the 1000 Hz of the physics, not {rate} Hz.")
        for name in ("stiffness", "lag", "acceleration", "bandwidth"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}.")
        for name in ("loss", "friction", "shear", "force_noise", "torque_noise", "delay_cycles", "extra_delay"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name} must not be negative, but is {getattr(self, name)}.")
        if not 0.0 <= self.lost < 1.0:
            raise InputError(f"lost must be a share from 0 to 1, not {self.lost}.")


@dataclass(frozen=True, eq=False)
class Reading:
    """The robot's readings in a period of the force/torque sensor.

    Attributes:
        time: present time [s].
        wrench: (6,) force [N] and torque [N m] on the sensor's payload, about its origin, in its frame: contact, weight
            and inertia of the probe, bias and noise.
        joints: (6,) the newest feedback [rad].
        joints_time: time at which that was measured [s].
        acceleration: (3,) reading of an accelerometer in the sensor's frame, 9.81 upwards at rest [m/s^2].
        fresh: False in a silence, when the wrench is the last one before it.
    """

    time: float
    wrench: Float[np.ndarray, "6"]
    joints: Float[np.ndarray, "6"]
    joints_time: float
    acceleration: Float[np.ndarray, "3"]
    fresh: bool


@dataclass(frozen=True, eq=False)
class PhantomTruth:
    """The truth at the time of the last reading.

    Attributes:
        time: time [s].
        phantom: T_base_phantom.
        sensor: T_base_sensor.
        normal: (3,) surface normal, out of the tissue, in the base.
        in_plane, out_of_plane: angles of the probe's axis to the normal [rad]: atan2(n_x, -n_z) and atan2(n_y, -n_z) of
            the normal n in the sensor's frame.
        press: force of the tissue along its normal [N].
        force: (3,) complete force of the tissue, friction too, in the base [N].
        moment: (3,) its moment about the sensor's origin, in base axes [N m].
        centre: (3,) centre of pressure on the probe, in the sensor's frame [m]; NaN without contact.
        depth: depth of the deepest point of the probe [m].
        tip: (3,) position of the tip in the base [m].
        joints: (6,) joint angles [rad].
    """

    time: float
    phantom: Pose
    sensor: Pose
    normal: Float[np.ndarray, "3"]
    in_plane: float
    out_of_plane: float
    press: float
    force: Float[np.ndarray, "3"]
    moment: Float[np.ndarray, "3"]
    centre: Float[np.ndarray, "3"]
    depth: float
    tip: Float[np.ndarray, "3"]
    joints: Float[np.ndarray, "6"]

    @property
    def angle(self) -> float:
        """Angle between the probe's axis and the normal [rad]."""
        return float(np.arccos(np.clip(-self.sensor.rotation[:, 2] @ self.normal, -1.0, 1.0)))


class PhantomLab:
    """The arm, the probe and the phantom in one simulation.

    Args:
        settings: settings of the lab; None for the usual ones.

    Raises:
        InputError: MuJoCo is not installed, or the phantom is out of the arm's reach.
    """

    def __init__(self, settings: LabSettings | None = None) -> None:
        from palpate_lab.simulation.phantom._servo import follow  # compiled, or loaded, when a lab is built
        from palpate_lab.simulation.phantom._tissue import press

        self.settings = settings = settings or LabSettings()
        self.probe: Probe = probe(settings.probe)
        self._mujoco = engine("moving phantom")
        text = mjcf(self.probe, timestep=_STEP, accelerometer=settings.accelerometer, phantom=(0.10, 0.07, 0.03))
        self.model = self._mujoco.MjModel.from_xml_string(text)
        self._press, self._follow = press, follow
        self._site, self._body = self.model.site(SENSOR).id, self.model.body(SENSOR).id
        cells = (self.probe.points, self.probe.normals, self.probe.areas[:, None])
        self._cells = np.concatenate(cells, axis=1)
        k = settings.stiffness
        self._tissue = np.array([k, settings.loss, settings.friction, settings.shear * k, settings.loss])
        w = settings.bandwidth
        self._servo_law = np.array([2.0 / settings.lag, w * w, 2.0 * w, _STEP, SPEED, settings.acceleration])
        cos, sin = np.cos(settings.heading), np.sin(settings.heading)
        self._rest = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        self._noise = np.repeat([settings.force_noise, settings.torque_noise, settings.acceleration_noise], 3)
        self._bias, self._drift, self._ranges = map(np.array, (settings.bias, settings.drift, settings.ranges))
        self._between = 1000 // settings.sensor_rate, 1000 // settings.robot_rate
        self.start()

    def start(self, gap: float = 0.010) -> Float[np.ndarray, "6"]:
        """Reset the clock, and put the probe at rest over the middle of the phantom, perpendicular to it.

        Args:
            gap: distance of the tip above the surface [m]; below zero it is in the tissue.

        Returns:
            The joints (6,) [rad].

        Raises:
            InputError: the position is out of the arm's reach.
        """
        data = self.data = self._mujoco.MjData(self.model)
        down = self._rest @ np.diag([1.0, -1.0, -1.0])
        tip = np.array(self.settings.place) + np.array([0.0, 0.0, gap])
        joints = self._reached(data, down, tip - down @ self.probe.tip)
        data.qpos[:] = joints
        self._rng = np.random.default_rng(self.settings.seed)
        self._servo = np.stack([joints, np.zeros_like(joints)])
        self._newest, self._taken = joints.copy(), joints.copy()
        self._waiting = deque([joints] * self.settings.delay_cycles)
        self._from = self._to = joints
        self._late = deque([joints] * round(self.settings.extra_delay / _STEP))
        self._bristles = np.zeros((len(self._cells), 3))
        self._contact, self._shift = np.zeros(11), np.zeros(3)
        self._probe, self._phantom = np.zeros((6, 3)), np.zeros((6, 3))
        self._twist, self._accelerations, self._effort = np.zeros(6), np.zeros(6), np.zeros(6)
        self._joints, self._tick = joints.copy(), 0
        self._advance()
        self._reading = self._read(frozen(np.zeros(6)))
        return joints.copy()

    @property
    def reading(self) -> Reading:
        """The newest `Reading`."""
        return self._reading

    def command(self, joints: Float[np.ndarray, "6"]) -> None:
        """Set a new goal for the joints [rad], within their limits, which the robot takes in its next cycle.

        Raises:
            InputError: not six finite numbers.
        """
        if joints.shape != (len(LINKS),) or not np.isfinite(joints).all():
            raise InputError(f"a command must be {len(LINKS)} finite angles, not {joints}.")
        np.clip(joints, -_LIMITS, _LIMITS, out=self._newest)

    def step(self) -> Reading:
        """Advance the simulation by one period of the force/torque sensor, and return its `Reading`.

        Raises:
            RuntimeError: the engine warned, and its results cannot be trusted.
        """
        for _ in range(self._between[0]):
            self._advance()
        data = self.data
        if abs(data.time - self._tick * _STEP) > 0.5 * _STEP or data.warning.number.any():
            raise RuntimeError("the physics engine gave up: a state that is not finite, or too fast")
        self._reading = self._read(self._reading.wrench)
        return self._reading

    def truth(self) -> PhantomTruth:
        """Return the `PhantomTruth` at the time of the last reading."""
        phantom, sensor, found = self._phantom, self._probe, self._contact
        normal = frozen(phantom[:3, 2])
        x, y, z = sensor[:3].T @ normal
        return PhantomTruth(
            time=self._reading.time,
            phantom=Pose(phantom[:3], phantom[3]),
            sensor=Pose(sensor[:3], sensor[3]),
            normal=normal,
            in_plane=float(np.arctan2(x, -z)),
            out_of_plane=float(np.arctan2(y, -z)),
            press=float(found[6]),
            force=frozen(found[:3]),
            moment=frozen(found[3:6]),
            centre=frozen(found[7:10] if found[6] > 0.0 else np.full(3, np.nan)),
            depth=float(found[10]),
            tip=frozen(sensor[3] + sensor[:3] @ self.probe.tip),
            joints=frozen(self._joints),
        )

    def links(self) -> tuple[Float[np.ndarray, "k 2 3"], list[float]]:
        """Return the ends (k, 2, 3) [m] of the arm's links, as they are drawn, and a list of their radii [m].

        The ends are in the base.
        """
        capsule, cylinder = (
            int(kind) for kind in (self._mujoco.mjtGeom.mjGEOM_CAPSULE, self._mujoco.mjtGeom.mjGEOM_CYLINDER)
        )
        kind = self.model.geom_type
        drawn = np.flatnonzero((kind == capsule) | (kind == cylinder))
        radius = self.model.geom_size[drawn, 0]
        length = self.model.geom_size[drawn, 1] + radius * (kind[drawn] == capsule)  # half of it, with its round ends
        half = self.data.geom_xmat[drawn].reshape(-1, 3, 3)[:, :, 2] * length[:, None]
        middle = self.data.geom_xpos[drawn]
        return np.stack([middle - half, middle + half], axis=1), radius.tolist()

    def free_wrenches(
        self, count: int = 12, samples: int = 200
    ) -> tuple[Float[np.ndarray, "k 6"], Float[np.ndarray, "k 3 3"]]:
        """Return readings of the sensor while the probe is at rest and free, to identify its payload.

        Args:
            count: number of poses, the wrist turned by up to 1.2 rad each way.
            samples: number of samples of the sensor that are averaged in each.

        Returns:
            Wrenches (k, 6) [N, N m] in the sensor's frame, and T_base_sensor's rotations (k, 3, 3).
        """
        mujoco, data = self._mujoco, self._mujoco.MjData(self.model)
        rng = np.random.default_rng([self.settings.seed, 1])
        wrenches, rotations = np.empty((count, 6)), np.empty((count, 3, 3))
        for i in range(count):
            data.qpos[:] = READY
            data.qpos[3:] += rng.uniform(-1.2, 1.2, 3)
            mujoco.mj_forward(self.model, data)
            data.qfrc_applied[:] = data.qfrc_bias
            mujoco.mj_forward(self.model, data)
            noise = rng.standard_normal(6) * self._noise[:6] / np.sqrt(samples)
            wrenches[i] = -data.sensordata[:6] + self._bias + noise
            rotations[i] = data.site_xmat[self._site].reshape(3, 3)
        return wrenches, rotations

    def singular_values(self) -> Float[np.ndarray, "6"]:
        """Return the singular values (6,) of the sensor's Jacobian, linear rows [m/rad] over angular, largest first."""
        return np.linalg.svd(self._jacobian(self.data), compute_uv=False)

    def _jacobian(self, data: Any) -> np.ndarray:
        jacobian = np.zeros((6, self.model.nv))
        self._mujoco.mj_jacSite(self.model, data, jacobian[:3], jacobian[3:], self._site)
        return jacobian

    def _reached(self, data: Any, rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the joints for a pose of the sensor, by Newton's method from `READY` turned to the place."""
        data.qpos[:] = READY
        data.qpos[0] += np.arctan2(place[1], place[0])
        turn = np.pi - self.settings.heading + data.qpos[0]
        data.qpos[5] += np.arctan2(np.sin(turn), np.cos(turn))
        for _ in range(100):
            self._mujoco.mj_kinematics(self.model, data)
            self._mujoco.mj_comPos(self.model, data)
            seen: np.ndarray = data.site_xmat[self._site].reshape(3, 3)
            away: np.ndarray = 0.5 * np.cross(seen, rotation, axis=0).sum(axis=1)
            error = np.concatenate([place - data.site_xpos[self._site], away])
            size = float(np.abs(error).max())
            if size < 1e-11 and np.all(np.abs(data.qpos) < _LIMITS) and np.trace(seen.T @ rotation) > 2.9:
                return np.array(data.qpos)
            jacobian = self._jacobian(data)
            damped: np.ndarray = jacobian @ jacobian.T + 1e-3 * size * np.eye(6)
            solved: np.ndarray = np.linalg.solve(damped, error)
            data.qpos += np.clip(jacobian.T @ solved, -radians(10), radians(10))
        what = f"the arm cannot reach a pose over the phantom at {self.settings.place} m."
        raise InputError(what, where="place", hint="Move it nearer to the arm, such as to (0.40, 0, 0.15).")

    def _advance(self) -> None:
        """Advance the physics by one step; measurements in it belong to its beginning."""
        mujoco, model, data, tick = self._mujoco, self.model, self.data, self._tick
        self._place_phantom(tick * _STEP)
        mujoco.mj_step1(model, data)
        self._joints[:] = data.qpos
        if tick % self._between[1] == 0:
            self._measured, self._measured_time = frozen(data.qpos), tick * _STEP
        self._touch(data)
        self._follow(self._servo, self._goal(tick), data.qpos, data.qvel, self._servo_law, self._accelerations)
        mujoco.mj_mulM(model, data, self._effort, self._accelerations)
        self._effort += data.qfrc_bias
        data.qfrc_applied[:] = np.clip(self._effort, -_EFFORTS, _EFFORTS, out=self._effort)
        mujoco.mj_step2(model, data)
        self._tick = tick + 1

    def _place_phantom(self, time: float) -> None:
        offset = self.settings.motion.offset(time)
        phantom = self._phantom
        phantom[:3] = self._rest @ offset[:3]
        phantom[3:] = offset[3:] @ self._rest.T
        phantom[3] += self.settings.place
        self.data.mocap_pos[0] = phantom[3]
        self._mujoco.mju_mat2Quat(self.data.mocap_quat[0], phantom[:3].ravel())

    def _touch(self, data: Any) -> None:
        """Apply the tissue's force on the probe at the body's centre of mass, as the engine wants it."""
        self._mujoco.mj_objectVelocity(self.model, data, self._mujoco.mjtObj.mjOBJ_SITE, self._site, self._twist, 0)
        probe, found = self._probe, self._contact
        probe[:3] = data.site_xmat[self._site].reshape(3, 3)
        probe[3], probe[4], probe[5] = data.site_xpos[self._site], self._twist[3:], self._twist[:3]
        self._press(self._cells, self._tissue, probe, self._phantom, self._bristles, found)
        applied = data.xfrc_applied[self._body]
        applied[:] = found[:6]
        if found[6] > 0.0:
            self._mujoco.mju_cross(self._shift, data.xipos[self._body] - probe[3], found[:3])
            applied[3:] -= self._shift

    def _goal(self, tick: int) -> np.ndarray:
        """Return the joints that the robot's interpolator has reached; its cycle begins just after each period."""
        period = self._between[1]
        passed = (tick - 1) % period + 1
        if passed == 1:
            if self.settings.lost == 0.0 or self._rng.random() >= self.settings.lost:
                self._taken = self._newest.copy()
            self._waiting.append(self._taken)
            self._from, self._to = self._to, self._waiting.popleft()
        goal = self._from + (passed / period) * (self._to - self._from)
        if not self._late:
            return goal
        self._late.append(goal)
        return self._late.popleft()

    def _read(self, before: np.ndarray) -> Reading:
        tick, time = self._tick - 1, (self._tick - 1) * _STEP
        noise = self._noise * self._rng.standard_normal(9)
        begin, length = self.settings.silence
        fresh = not round(begin / _STEP) <= tick < round((begin + length) / _STEP)
        wrench = before
        if fresh:
            # the engine's sensors show what the probe does to the arm
            shown = -self.data.sensordata[:6] + noise[:6] + self._bias + self._drift * time
            wrench = frozen(np.clip(shown, -self._ranges, self._ranges))
        acceleration = frozen(self.data.sensordata[6:9] + noise[6:])
        return Reading(time, wrench, self._measured, self._measured_time, acceleration, fresh)
