"""Move a robot's joints smoothly, and compute poses of its links and wrenches at its sensors in the physics engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.engine import engine
from palpate_lab.simulation.robot.tree import RobotLink, mjcf, moving

QUIET = 3.0  # s at the start without motion or touch
_SINES, _ROUNDS = 3, 4
_MARGIN = 1.005  # for what is between two samples of a motion that is drawn
_LEAST = 0.5  # of the largest speed: that of the slowest joint
_SOFT = 1.0  # s in which the motion begins
_WATCH = 5000  # steps between two calls of `watch`


@dataclass(frozen=True)
class JointMotion:
    """Smooth motions of k joints: middle + s(t) sum A (sin(w t + p) - sin p), with t from `QUIET` and s from 0 to 1.

    Where they pause, t stands still for a second every two seconds.

    Attributes:
        middle: (k,) [rad].
        size, rate, phase: (k, 3) A [rad], w [rad/s] and p [rad].
        pauses: True: they pause.
    """

    middle: Float[np.ndarray, " k"]
    size: Float[np.ndarray, "k 3"]
    rate: Float[np.ndarray, "k 3"]
    phase: Float[np.ndarray, "k 3"]
    pauses: bool = False

    @classmethod
    def drawn(cls, links: Sequence[RobotLink], rng: np.random.Generator, seconds: float, speed: float) -> JointMotion:
        """Draw a motion of the links' joints within their ranges, whose fastest joint reaches a speed [rad/s]."""
        count, span = len(links), np.array([link.span for link in links])
        rate, fastest = rng.uniform(0.5, 1.5, (count, _SINES)), speed * rng.uniform(_LEAST, 1.0, count)
        size, phase = rng.uniform(0.5, 1.0, (count, _SINES)), rng.uniform(0.0, 2 * np.pi, (count, _SINES))
        middle, time = np.array([link.middle for link in links]), np.arange(QUIET, QUIET + max(seconds, 60.0), 0.02)
        for _ in range(_ROUNDS):  # the whole range, at the wanted speed
            position, velocity, _ = cls(middle, size, rate, phase).at(time)
            size *= (span / np.abs(position - middle).max(axis=0))[:, None]
            rate *= (fastest / np.abs(velocity).max(axis=0))[:, None]
        position, velocity, _ = cls(middle, size, rate, phase).at(time)
        over = np.maximum(np.abs(position - middle).max(axis=0) / span, np.abs(velocity).max(axis=0) / fastest)
        return cls(middle, size / np.maximum(_MARGIN * over, 1.0)[:, None], rate, phase)

    def at(self, time: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions [rad], velocities [rad/s] and accelerations [rad/s^2], (n, k) each, at times (n,) [s]."""
        since, pace, change = _paced(np.maximum(time - QUIET, 0.0)[:, None], self.pauses)
        fade = np.exp(-0.5 * (since / _SOFT) ** 2)
        begun, begins, bends = 1.0 - fade, since / _SOFT**2 * fade, (1.0 - (since / _SOFT) ** 2) / _SOFT**2 * fade
        turn = since[..., None] * self.rate + self.phase
        way = np.sum(self.size * (np.sin(turn) - np.sin(self.phase)), axis=2)
        fast = np.sum(self.size * self.rate * np.cos(turn), axis=2)
        bent = -np.sum(self.size * self.rate**2 * np.sin(turn), axis=2)
        slope, bend = begins * way + begun * fast, bends * way + 2 * begins * fast + begun * bent
        moves = (time > QUIET)[:, None]
        velocity, acceleration = slope * pace, bend * pace**2 + slope * change
        return self.middle + begun * way, np.where(moves, velocity, 0.0), np.where(moves, acceleration, 0.0)


def _paced(time: Float[np.ndarray, "n 1"], pauses: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the time (n, 1) [s] that motions have, its rate, at most 1, and the change of that [1/s]."""
    if not pauses:
        return time, np.ones_like(time), np.zeros_like(time)
    cycle, within = np.divmod(time, 2.0)
    turn = 2 * np.pi * np.minimum(within, 1.0)
    begun = cycle + np.minimum(within, 1.0) - np.sin(turn) / (2 * np.pi)
    return 0.5 * begun, 0.5 * (1.0 - np.cos(turn)), np.pi * np.sin(turn)


class RobotMechanics:
    """A robot in the physics engine, by its own rigid-body mechanics.

    Args:
        name: name of the robot.
        links: its links.
        sites: links whose frames have a force and a torque sensor above them.

    Raises:
        InputError: MuJoCo is not installed.
    """

    def __init__(self, name: str, links: Sequence[RobotLink], sites: Sequence[str]) -> None:
        self._mujoco = engine(name)
        self._model = self._mujoco.MjModel.from_xml_string(mjcf(name, links, sites))
        self._data = self._mujoco.MjData(self._model)
        self.links, self.sites, self._moving = tuple(links), tuple(sites), moving(links)
        own = {link.name: k for k, link in enumerate(self._moving)}
        follows = np.zeros((self._model.nv, len(self._moving)))
        for link in links:
            if link.axis is not None:
                leader, factor = link.mimic or (link.name, 1.0)
                follows[self._model.joint(link.joint).dofadr[0], own[leader]] = factor
        self._follows = follows
        self._body = [self._model.body(link.name).id for link in links]

    def poses(
        self, positions: Float[np.ndarray, "n k"]
    ) -> tuple[Float[np.ndarray, "n l 3 3"], Float[np.ndarray, "n l 3"]]:
        """Return rotations and origins [m] of all links in the base at joint positions (n, k) [rad]."""
        data, size = self._data, (len(positions), len(self._body))
        turned, placed = np.empty((*size, 9)), np.empty((*size, 3))
        for i, where in enumerate(positions @ self._follows.T):
            data.qpos[:] = where
            self._mujoco.mj_kinematics(self._model, data)
            turned[i], placed[i] = data.xmat[self._body], data.xpos[self._body]
        return turned.reshape(*size, 3, 3), placed

    def wrenches(
        self, motion: tuple[np.ndarray, np.ndarray, np.ndarray], watch: Callable[[int, float], None] | None = None
    ) -> Float[np.ndarray, "n s 6"]:
        """Return what weight and inertia of the links beyond each site do to it, (n, s, 6) [N, N m], in its frame.

        The motion is that of `JointMotion.at`; `watch` is called with the number and the share of samples done.
        """
        data, count = self._data, len(motion[0])
        loads = np.empty((count, 6 * len(self.sites)))
        where, fast, bent = (each @ self._follows.T for each in motion)
        for i in range(count):
            data.qpos[:], data.qvel[:], data.qacc[:] = where[i], fast[i], bent[i]
            self._mujoco.mj_inverse(self._model, data)
            loads[i] = data.sensordata
            if watch is not None and i % _WATCH == 0:
                watch(i + 1, (i + 1) / count)
        return -loads.reshape(count, len(self.sites), 6)  # the engine has what the links do to the mount
