"""The forearm in MuJoCo: a link on a force/torque sensor, and indenters that hands push against it.

Everything is simulated in the sensor's frame, in which gravity turns: hands go with the arm. The inertia of the link
from the arm's own motion is added by `palpate_lab.simulation.touched.sensors`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial._arrays import Value, frozen
from palpate_lab.simulation.engine import engine, words
from palpate_lab.simulation.touched.plan import COMING, PlannedTouch, course
from palpate_lab.simulation.touched.settings import GRAVITY, STEP_RATE, ForearmSettings

_MASS, _DAMPING = 0.1, 16.0  # kg, N s/m of an indenter
_AWAY = 0.5  # m: where indenters wait
_CONTACT = 'solref="-20000 -400" solimp="0.95 0.95 0.001 0.5 2"'  # 1/s^2, 1/s per mass: 25 um/N, 1 % of shear a second


@dataclass(frozen=True, eq=False)
class Physics(Value):
    """The engine's results; m contacts in all, in the order of their samples of the skin.

    Attributes:
        time: (n,) [s], every 1 ms.
        wrench: (n, 6) [N, N m] of contacts and weight on the link about the sensor's origin, in its frame.
        frame: (m,) number of the skin's sample that a contact belongs to, from 0 at time 0.
        touch: (m,) number of its touch.
        point, normal: (m, 3) point [m] and normal out of the link, in the link's frame.
        force: (m, 3) [N] on the link, in the link's frame.
        speed: (m,) [m/s] of the indenter along the surface.
    """

    time: Float[np.ndarray, " n"]
    wrench: Float[np.ndarray, "n 6"]
    frame: Int[np.ndarray, " m"]
    touch: Int[np.ndarray, " m"]
    point: Float[np.ndarray, "m 3"]
    normal: Float[np.ndarray, "m 3"]
    force: Float[np.ndarray, "m 3"]
    speed: Float[np.ndarray, " m"]


def mjcf(settings: ForearmSettings) -> str:
    """Return the model as MJCF text: only the link and indenters collide, and indenters have no weight."""
    x, y, z, w = settings.mount.quaternion().tolist()
    at, link = words(settings.mount.translation.tolist()), words((w, x, y, z))
    slots = range(settings.touches)
    across = 0.5 * settings.mass * settings.sheet.radius**2
    along = settings.mass * (settings.sheet.radius**2 / 4 + settings.half_length**2 / 3)
    indenters = "".join(
        f'<body name="indenter{k}" gravcomp="1">'
        + "".join(f'<joint name="{a}{k}" type="slide" axis="{v}" damping="{_DAMPING}"/>' for a, v in _AXES.items())
        + f'<geom name="indenter{k}" size="0.01" mass="{_MASS}" contype="0" conaffinity="1"/></body>'
        for k in slots
    )
    hands = "".join(f'<position joint="{a}{k}" kp="{settings.stiffness!r}"/>' for k in slots for a in _AXES)
    return f"""
<mujoco model="touched forearm">
  <option timestep="{1 / STEP_RATE!r}" integrator="implicitfast" cone="elliptic" impratio="100" solver="Newton"
    tolerance="1e-12" gravity="0 0 {-GRAVITY!r}"/>
  <default><geom type="sphere" friction="{settings.friction!r} 0 0" condim="3" {_CONTACT}/></default>
  <worldbody>
    <body name="link" pos="{at}" quat="{link}">
      <inertial pos="{words(settings.centre)}" mass="{settings.mass!r}"
        diaginertia="{words((along, along, across))}"/>
      <geom name="link" type="cylinder" size="{settings.sheet.radius!r} {settings.half_length!r}" contype="1"
        conaffinity="0"/>
      <site name="sensor" pos="{words(settings.mount.inverse().translation.tolist())}"
        quat="{words((w, -x, -y, -z))}"/>
    </body>
    {indenters}
  </worldbody>
  <actuator>{hands}</actuator>
  <sensor><force site="sensor"/><torque site="sensor"/></sensor>
</mujoco>"""


_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def simulate_physics(
    settings: ForearmSettings,
    touches: Sequence[PlannedTouch],
    rotations: Float[np.ndarray, "n 3 3"],
    watch: Callable[[int, float], None] | None = None,
) -> Physics:
    """Run the engine, and return the `Physics`.

    Args:
        settings: settings of link and indenters.
        touches: planned touches.
        rotations: (n, 3, 3) of the sensor in the base, one each step.
        watch: function called with the number of samples done, and the share that is done.

    Raises:
        InputError: MuJoCo is not installed.
        RuntimeError: the engine warned, and its results cannot be trusted.
    """
    mujoco = engine("touched forearm")
    model = mujoco.MjModel.from_xml_string(mjcf(settings))
    steps, between = len(rotations), STEP_RATE // settings.skin_rate
    frames = -(-steps // between)
    time, wrench = np.arange(steps) / STEP_RATE, np.empty((steps, 6))
    wanted, events = _hands(settings, touches, time)
    gravity = -GRAVITY * rotations[:, 2]  # R^T g
    data = mujoco.MjData(model)
    data.qpos[:] = wanted[0]
    seen = _Contacts(mujoco, model, data, settings)
    for i in range(steps):
        for touch in events.get(i, ()):
            seen.begin(touch, wanted[i])
        data.ctrl[:] = wanted[i]
        model.opt.gravity[:] = gravity[i]
        mujoco.mj_step(model, data)
        wrench[i] = data.sensordata
        if i % between == 0:
            seen.read(i // between)
            if watch is not None and i % (50 * between) == 0:
                watch(i // between + 1, (i // between + 1) / frames)
    if data.warning.number.any():
        raise RuntimeError("the physics engine gave up: a state that is not finite, or too fast")
    return Physics(time, frozen(-wrench), *seen.arrays())  # the engine shows what the link does to the sensor's mount


def _hands(
    settings: ForearmSettings, touches: Sequence[PlannedTouch], time: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n k"], dict[int, list[PlannedTouch]]]:
    """Return the positions where hands want indenters, three coordinates each; the steps at which one is brought."""
    wanted: Float[np.ndarray, "n k"] = np.full((len(time), 3 * settings.touches), _AWAY)
    events: dict[int, list[PlannedTouch]] = {}
    for slot in range(settings.touches):
        own = sorted((each for each in touches if each.slot == slot), key=lambda each: each.start)
        begin = [max(int(np.ceil((touch.start - COMING) * STEP_RATE)), 0) for touch in own]
        for touch, first, last in zip(own, begin, [*begin, len(time)][1:], strict=True):
            place = settings.mount.apply(course(touch, settings, time[first:last]))
            wanted[first:last, 3 * slot : 3 * slot + 3] = place
            if first < len(time):
                events.setdefault(first, []).append(touch)
    return wanted, events


class _Contacts:
    """A reader of the engine's contacts, sample by sample."""

    def __init__(self, mujoco: Any, model: Any, data: Any, settings: ForearmSettings) -> None:
        self._mujoco, self._model, self._data = mujoco, model, data
        self._back = settings.mount.inverse()
        self._link = model.geom("link").id
        self._slot = {model.geom(f"indenter{k}").id: k for k in range(settings.touches)}
        self._geom = {k: geom for geom, k in self._slot.items()}
        self._touch = dict.fromkeys(self._geom, -1)
        self._wrench = np.zeros(6)
        self._rows: list[tuple[int, int, np.ndarray, np.ndarray, np.ndarray, float]] = []

    def begin(self, touch: PlannedTouch, wanted: np.ndarray) -> None:
        """Put an indenter of a touch's size over its place."""
        here = slice(3 * touch.slot, 3 * touch.slot + 3)
        self._data.qpos[here], self._data.qvel[here] = wanted[here], 0.0
        geom = self._geom[touch.slot]
        self._model.geom_size[geom, 0] = self._model.geom_rbound[geom] = touch.radius
        self._touch[touch.slot] = touch.number

    def read(self, frame: int) -> None:
        """Read the present contacts as those of a sample of the skin."""
        for j in range(self._data.ncon):
            contact = self._data.contact[j]
            self._mujoco.mj_contactForce(self._model, self._data, j, self._wrench)
            first, axes = contact.geom1 == self._link, contact.frame.reshape(3, 3)
            sign = 1.0 if first else -1.0  # the frame's x, and the force, go from the first body to the second
            slot = self._slot[contact.geom2 if first else contact.geom1]
            if self._wrench[0] <= 0.0:
                continue
            normal, velocity = sign * axes[0], self._data.qvel[3 * slot : 3 * slot + 3]
            along = velocity - normal * (normal @ velocity)
            force = -sign * (self._wrench[:3] @ axes)
            row = frame, self._touch[slot], contact.pos.copy(), normal, force, float(np.sqrt(along @ along))
            self._rows.append(row)

    def arrays(self) -> tuple[np.ndarray, ...]:
        """Return all contacts in the link's frame, in the order of `Physics`."""
        rows = sorted(self._rows, key=lambda row: row[:2])
        frame, touch = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
        point, normal, force = (np.array([row[k] for row in rows]).reshape(-1, 3) for k in (2, 3, 4))
        back = self._back
        speed = np.array([row[5] for row in rows])
        return frame, touch, *map(frozen, (back.apply(point), back.rotate(normal), back.rotate(force), speed))
