"""Run robots in an arena on a physics engine: track commands go in, poses and true contacts come out."""

from __future__ import annotations

from math import atan2, cos, isfinite, pi, remainder, sin, tau

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.model import SUBSTEPS, mjcf, soften
from palpate_lab.simulation.arena.settings import FRAME, RobotSettings
from palpate_lab.simulation.engine import engine

_CORNER = 0.002  # m from a box's edge within which it is the corner that touches
_NONE = frozen(np.empty((0, 5)))


class ArenaWorld:
    """Robots and movable blocks on MuJoCo; the same layout, settings, seed and commands give the same bits.

    Args:
        layout: the arena.
        robot: settings of each robot; None for the usual ones.
        seed: seed of the tracks' unevenness.

    Raises:
        InputError: MuJoCo is not installed.
    """

    def __init__(self, layout: ArenaLayout, robot: RobotSettings | None = None, seed: int = 0) -> None:
        self.layout, self.robot = layout, robot or RobotSettings()
        self._mujoco = engine("arena")
        self.model = self._mujoco.MjModel.from_xml_string(mjcf(layout, self.robot))
        soften(self.model, layout, self.robot)
        self.data = self._mujoco.MjData(self.model)
        n, m = layout.robots, len(layout.movable)
        self._bodies = [self.model.body(f"robot{k}").id for k in range(n)]
        skins = {self.model.geom(f"skin{k}").id: k for k in range(n)}
        self._robot_of = [skins.get(k, -1) for k in range(self.model.ngeom)]
        self._plane = (self.model.geom_type == int(self._mujoco.mjtGeom.mjGEOM_PLANE)).tolist()
        rng = np.random.default_rng([seed, 181])
        self._gain = 1.0 + self.robot.uneven * rng.standard_normal((n, 2))
        self._own = self.data.qpos[: 6 * n].reshape(n, 2, 3)  # the carrier in the arena, the robot on the carrier
        self._speed = self.data.qvel[: 6 * n].reshape(n, 2, 3)
        self._blocks = self.data.qpos[6 * n :].reshape(m, 4)
        self._own[:, 0] = layout.starts
        self._blocks[:] = np.reshape([(block.x, block.y, block.turn, 0.0) for block in layout.movable], (m, 4))
        self._frames = 0
        self._mujoco.mj_forward(self.model, self.data)
        self._found: list[Float[np.ndarray, "k 5"]] | None = None

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._frames * FRAME

    @property
    def poses(self) -> Float[np.ndarray, "n 3"]:
        """Pose of each robot, (n, 3): x, y [m] and heading [rad], from -pi to pi."""
        return np.array([_pose(*own) for own in self._own.tolist()])

    @property
    def velocities(self) -> Float[np.ndarray, "n 3"]:
        """Velocity of each robot in the arena's frame, (n, 3) [m/s], [rad/s]."""
        return np.array([_velocity(*each) for each in zip(self._own.tolist(), self._speed.tolist(), strict=True)])

    @property
    def blocks(self) -> Float[np.ndarray, "m 3"]:
        """Poses (m, 3) of the blocks in `layout.movable`, in that order: x, y [m] and turn [rad], from -pi to pi."""
        blocks = self._blocks[:, :3].copy()
        blocks[:, 2] -= tau * np.round(blocks[:, 2] / tau)
        return blocks

    def step(self, wheels: Float[np.ndarray, "n 2"]) -> None:
        """Advance the simulation by one period of the camera, 1/30 s.

        Args:
            wheels: (n, 2) speed of each robot's left and right track [m/s], constant for the period.

        Raises:
            InputError: not two finite speeds a robot.
            RuntimeError: the engine warned, and its results cannot be trusted.
        """
        if wheels.shape != self._gain.shape or not all(map(isfinite, wheels.ravel().tolist())):
            raise InputError(f"wheels must be two finite speeds for each of {len(self._gain)} robots, not {wheels}")
        self._drive(self._gain * wheels)
        self._mujoco.mj_step(self.model, self.data, SUBSTEPS)
        self._frames, self._found = self._frames + 1, None
        if abs(self.data.time - self.time) > 0.5 * FRAME or any(self.data.warning.number.tolist()):
            raise RuntimeError("the physics engine gave up: a state that is not finite, or too fast")

    def _drive(self, wheels: Float[np.ndarray, "n 2"]) -> None:
        """Put each carrier under its robot and set it in motion; the robot keeps its position and its velocity."""
        places, speeds = list[tuple[tuple[float, ...], ...]](), list[tuple[tuple[float, ...], ...]]()
        gone = zip(self._own.tolist(), self._speed.tolist(), wheels.tolist(), strict=True)
        for own, speed, (left, right) in gone:  # plain numbers: arrays of three cost more than what is computed
            vx, vy, spin = _velocity(own, speed)
            x, y, heading = _pose(*own)
            forward, turn = 0.5 * (left + right), (right - left) / self.robot.track
            middle = heading + 0.5 * FRAME * turn  # of the frame: the arc's chord
            along, across = forward * cos(middle), forward * sin(middle)
            places.append(((x, y, heading), (0.0, 0.0, 0.0)))
            slips = _turned(vx - along, vy - across, -heading)
            speeds.append(((along, across, turn), (*slips, spin - turn)))
        self._own[:], self._speed[:] = places, speeds

    def touches(self, robot: int) -> Float[np.ndarray, "k 5"]:
        """Return the true contacts on a robot's skin, by rising angle.

        Args:
            robot: its number, from 0.

        Returns:
            (k, 5) angle of the point on the skin in the robot's frame [rad], from -pi to pi; force that presses inward
            there [N]; force along the skin towards a rising angle, on the robot [N]; depth of the skin's dent [m], of
            two skins half for each; the touching thing: 0 a flat side, 1 the corner of a box, 2 another robot's skin.
        """
        if self._found is None:
            self._found = self._all_touches()
        return self._found[robot]

    def _all_touches(self) -> list[Float[np.ndarray, "k 5"]]:
        """Return the contacts of each robot, from the last substep, relative to the poses of the same substep."""
        data, contact, robots = self.data, self.data.contact, self._robot_of
        force, frames, depths = data.efc_force, contact.frame, contact.dist
        rows: list[list[tuple[float, ...]]] = [[] for _ in range(self.layout.robots)]
        turn = data.xmat[self._bodies]
        headings = np.arctan2(turn[:, 3], turn[:, 0]).tolist()
        geoms: list[list[int]] = contact.geom.tolist()
        addresses: list[int] = contact.efc_address.tolist()
        for i, ((one, two), address) in enumerate(zip(geoms, addresses, strict=True)):  # plain numbers: there are few
            first, second = robots[one], robots[two]
            if max(first, second) < 0 or address < 0:
                continue
            normal, *along = force[address : address + 3].tolist()
            if normal <= 0.0:
                continue
            x, y, _, *sides = frames[i].tolist()  # the normal, and the force, go from the first to the second
            shear = sum(f * (a * y - b * x) for f, a, b in zip(along, sides[::3], sides[1::3], strict=True))
            depth = -float(depths[i])
            for robot, other, geom, sign in ((first, second, two, 1.0), (second, first, one, -1.0)):
                if robot >= 0:
                    angle = remainder(atan2(sign * y, sign * x) - headings[robot], tau)
                    kind = 2.0 if other >= 0 else self._kind(geom, robot)
                    rows[robot].append((angle, normal, shear, depth if other < 0 else 0.5 * depth, kind))
        return [_frozen(sorted(row)) if row else _NONE for row in rows]

    def _kind(self, geom: int, robot: int) -> float:
        """Return 1 where a box is nearest to the robot's middle with a corner, else 0."""
        if self._plane[geom]:
            return 0.0
        data, size = self.data, self.model.geom_size[geom].tolist()
        turn = data.geom_xmat[geom].tolist()
        here, there = data.xpos[self._bodies[robot]].tolist(), data.geom_xpos[geom].tolist()
        away = [a - b for a, b in zip(here, there, strict=True)]
        own = [sum(a * b for a, b in zip(away, turn[axis::3], strict=True)) for axis in (0, 1)]
        return float(all(abs(off) > half - _CORNER for off, half in zip(own, size, strict=False)))


def _frozen(rows: list[tuple[float, ...]]) -> Float[np.ndarray, "k 5"]:
    made = np.array(rows)
    made.flags.writeable = False
    return made


def _pose(carrier: list[float], on: list[float]) -> tuple[float, float, float]:
    """Return the pose of a robot in the arena from its carrier's and its own `on` that, heading from -pi to pi."""
    x, y = _turned(on[0], on[1], carrier[2])
    heading = carrier[2] + on[2]
    return carrier[0] + x, carrier[1] + y, heading - tau * round(heading / tau)


def _velocity(own: list[list[float]], speed: list[list[float]]) -> tuple[float, float, float]:
    """Return the velocity of a robot in the arena, from poses and speeds of its carrier and of the robot on it."""
    (_, _, turn), (px, py, _) = own
    (cx, cy, spin), (vx, vy, more) = speed
    x, y = _turned(vx, vy, turn)
    u, v = _turned(px, py, turn + 0.5 * pi)  # swept as the carrier turns
    return cx + x + spin * u, cy + y + spin * v, spin + more


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    c, s = cos(angle), sin(angle)
    return c * x - s * y, s * x + c * y
