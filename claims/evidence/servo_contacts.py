"""The moving phantom's lab with two other contacts: Hertz's, in closed form, and where the physics engine has it."""

from typing import Any

import numpy as np

from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab
from palpate_lab.simulation.phantom.probes import PROBES, TIP

FACE = PROBES["convex"]
HERTZ, SPRING = (21.7e3, 1.5), (2240.0, 1.0)  # N/m^n and n: 2,240 N/m at 7 N both
HYSTERESIS = 2.0  # s/m, Hunt and Crossley's
SEEN = 1e-3  # rad: less, as in the approach, looks like an offset of the joints
HALF_AXIS = 0.030  # m, along z, of the ellipsoid with the face's radii at its end


class CountingLab(PhantomLab):
    """The lab, which counts the commands that differ from the one before by `SEEN` and never reach the robot."""

    gone = 0

    def _goal(self, tick: int) -> np.ndarray:
        taken, newest = self._taken, self._newest.copy()
        goal = super()._goal(tick)
        cycle = (tick - 1) % self._between[1] == 0
        self.gone += cycle and self._taken is taken and float(np.abs(newest - taken).max()) > SEEN
        return goal


class HertzLab(PhantomLab):
    """The lab with F = k d^n (1 + h d') at the one point where the face is deepest, without friction."""

    law = HERTZ

    def _touch(self, data: Any) -> None:
        tissue, self._press = self._press, self._spring
        super()._touch(data)
        self._press = tissue

    def _deepest(self, turned: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return the point of the face's torus, in the sensor's frame, whose outward normal is against `normal`."""
        x, y, z = -turned.T @ normal
        ring = (FACE.in_plane - FACE.out_of_plane) / np.hypot(x, z)
        middle = np.array([ring * x, 0.0, ring * z + TIP - FACE.in_plane])
        return middle + FACE.out_of_plane * np.array([x, y, z])

    def _spring(
        self, cells: np.ndarray, tissue: np.ndarray, probe: np.ndarray, phantom: np.ndarray, bristles: np.ndarray,
        out: np.ndarray,
    ) -> None:  # fmt: skip
        """Write what `_tissue.press` writes, from poses and velocities alone."""
        normal, out[:] = phantom[:3, 2], 0.0
        point = self._deepest(probe[:3], normal)
        arm = probe[:3] @ point
        place = probe[3] + arm
        depth = float(normal @ (phantom[3] - place))
        if depth > 0.0:
            moving = probe[4] + np.cross(probe[5], arm) - phantom[4] - np.cross(phantom[5], place - phantom[3])
            stiffness, power = self.law
            press = max(0.0, stiffness * depth**power * (1.0 - HYSTERESIS * float(normal @ moving)))
            out[:3], out[6], out[7:10], out[10] = press * normal, press, point, depth
            out[3:6] = np.cross(arm, out[:3])


class EngineLab(HertzLab):
    """The same on a linear spring where MuJoCo's collision of an ellipsoid with the phantom's box has the contact."""

    law, _pair, _ends = SPRING, (), np.zeros(6)

    def __init__(self, settings: LabSettings) -> None:
        super().__init__(settings)
        mujoco, model = self._mujoco, self.model
        box, last = model.body("phantom").geomadr[0], model.body(self._body).geomadr[0]
        half = HALF_AXIS * np.sqrt([FACE.in_plane / HALF_AXIS, FACE.out_of_plane / HALF_AXIS, 1.0])
        model.geom_type[last], model.geom_size[last] = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), half
        model.geom_pos[last], model.geom_quat[last] = [0.0, 0.0, TIP - HALF_AXIS], [1.0, 0.0, 0.0, 0.0]
        model.geom_rbound[last], model.geom_aabb[last] = half.max(), [0.0, 0.0, 0.0, *half]
        self._pair, self._ends = (last, box), np.zeros(6)
        self.start()

    def _deepest(self, turned: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return the probe's end of the engine's shortest way from the probe to the box, or out of it."""
        if self._pair:
            self._mujoco.mj_geomDistance(self.model, self.data, *self._pair, 0.05, self._ends)
        return turned.T @ (self._ends[:3] - self._probe[3])


LABS: dict[str, type[PhantomLab]] = {"elastic": CountingLab, "Hertz": HertzLab, "the engine's": EngineLab}
