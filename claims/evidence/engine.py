"""Against a physics engine (MuJoCo): its own force and torque sensor, its own contacts, neither from code of ours.

A tool stands fixed on the engine's sensor, and a finger on springs is pressed against it at random places, dragged
aside (it sticks, then slips) and turned. Gravity is off, the cone elliptic (Coulomb's own: a pyramid's friction depends
on the direction), the contact as stiff as the time step allows, so that bodies enter each other by micrometres. The
engine puts a contact's point in the middle between the two surfaces, half of that depth below the tool's; the errors
are to that point, the depth is said. Forces at several points act as one at their pressure's centre.
"""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.bodies import mesh_of
from claims.evidence.covariance import NOISE, coverage
from claims.row import Row
from palpate.contact.plausibility import RequiredBounds
from palpate.surfaces.quadric import Cylinder
from palpate.surfaces.quadric import Ellipsoid as EllipsoidSurface
from palpate.surfaces.surface import Surface
from palpate_lab.simulation import EllipsoidBody

LEVER = 0.05  # m from the sensor's origin to the middle of the tool
STEPS, EVERY, STEADY = 200, 10, 60  # of 1 ms: of a touch, from one sample to the next, before the first
SPRING, TURNING = 2000.0, 0.05  # N/m, N m/rad: of the finger
BALL, PLATE = 0.005, (0.008, 0.005, 0.003)  # m: the finger's radius; half-sides of a flat one
TORSION = 5e-3  # m, the default bound
MJCF = Path(__file__).with_suffix(".xml").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Tool:
    """A body as the engine has it and as Palpate has it, and the half-sides [m] of where touches are aimed from."""

    geom: str
    surfaces: dict[str, Surface]
    around: tuple[float, float, float]


@dataclass(frozen=True)
class Pressed:
    """Samples by the engine: pressure's centre (n, 3) [m], wrench about the tool's middle (n, 6).

    Then how far the farthest contact lies from that centre, how deep the bodies are in each other (both (n,) [m]), and
    the share (n,) of the friction in use.
    """

    point: np.ndarray
    wrench: np.ndarray
    reach: np.ndarray
    depth: np.ndarray
    used: np.ndarray


def _capsule(radius: float, half: float) -> palpate.Mesh:
    """Turned about z; in millimetres, because small facets are lost in metres."""
    angle = np.linspace(0, np.pi / 2, 33)
    cap = 1e3 * np.c_[radius * np.sin(angle), half + radius * np.cos(angle)]
    cap[0, 0] = 0.0
    outline = np.concatenate([cap * (1, -1), cap[::-1]])
    return palpate.Mesh.from_trimesh(trimesh.creation.revolve(outline, sections=128), unit="mm")


_axes = (0.030, 0.021, 0.015)
TOOLS = {
    "ellipsoid": Tool(
        'type="ellipsoid" size="0.030 0.021 0.015"',
        {"an equation": EllipsoidSurface(_axes), "a mesh": mesh_of(EllipsoidBody(_axes), 20_000)},
        (0.06, 0.06, 0.06),
    ),
    "capsule": Tool('type="capsule" size="0.012 0.020"', {"a mesh": _capsule(0.012, 0.020)}, (0.03, 0.03, 0.05)),
    "cylinder's side": Tool(  # not its rim
        'type="cylinder" size="0.015 0.030" euler="90 0 0"',
        {"an equation": Cylinder(0.015, 0.030)},
        (0.03, 0.022, 0.03),
    ),
}
BOX = Tool(
    'type="box" size="0.030 0.030 0.020"',
    {"a mesh": palpate.Mesh.from_trimesh(trimesh.creation.box((60, 60, 40)), unit="mm")},
    (0.018, 0.018, 0.0),
)


def rows(small: bool) -> Iterator[Row]:
    if importlib.util.find_spec("mujoco") is None:
        yield Row("single contacts; flat on flat", "", "skipped: mujoco is not installed")
        return
    count = 300 if small else 5_000
    for name, tool in TOOLS.items():
        yield from _single(name, tool, count)
    yield from _single("ellipsoid, a finger that turns (torsional friction 2 mm)", TOOLS["ellipsoid"], count, 2e-3)
    yield from _flat(count)


def _single(name: str, tool: Tool, count: int, turning: float = 0.0) -> Iterator[Row]:
    rng = np.random.default_rng(41)
    seen = press(tool, f'type="sphere" size="{BALL}"', count, rng, turning)
    depth = 1e6 * seen.depth
    said = f"{count:,} samples, {np.mean(seen.used > 0.99):.0%} slip; depth median {np.median(depth):.1f}, "
    said += f"max {depth.max():.1f} um"
    for kind, surface in tool.surfaces.items():
        found = palpate.Locator(surface).run(seen.wrench, sequential=False)
        answered, error = float(np.mean(found.answered)), _errors(found, seen)
        got = f"{answered:.2%}; {_quantiles(error)}; {said}"
        met = answered >= 0.99 and np.nanpercentile(error, 95) <= 0.15
        what = f"{name} as {kind}: answered; error from the engine's own contact point"
        yield Row(what, ">= 99 %; p95 <= 0.15 mm", got, met)
        noisy = seen.wrench + NOISE * rng.standard_normal((count, 6))
        found = palpate.Locator(surface, noise=NOISE).run(noisy, sequential=False)
        inside, _ = coverage(found, seen.point)
        got = f"{np.mean(found.answered):.2%}; {inside:.2%}; {_quantiles(_errors(found, seen))}"
        what = f"{name} as {kind}, noise of 0.02 N and 1 mN m: answered; truth in the 95 % ellipse; error"
        yield Row(what, "", got)


def _flat(count: int) -> Iterator[Row]:
    """A plate on a box's face, tilted by its springs so that the pressure moves, and turned so that it slips."""
    half = " ".join(map(str, PLATE))
    seen = press(BOX, f'type="box" size="{half}"', count, np.random.default_rng(43))
    surface, friction = BOX.surfaces["a mesh"], 1.0
    wide = palpate.Locator(surface, torsion=20e-3).run(seen.wrench, sequential=False)
    answered, error = float(np.mean(wide.answered)), _errors(wide, seen)
    met = answered >= 0.99 and np.nanpercentile(error, 95) <= 0.15
    got = f"{answered:.2%}; {_quantiles(error)}; {count:,} samples"
    what = "flat on flat, torsion bound 20 mm: answered; error from the pressure's centre"
    yield Row(what, ">= 99 %; p95 <= 0.15 mm", got, met)
    found = palpate.Locator(surface, torsion=TORSION).run(seen.wrench, sequential=False)
    arm = seen.wrench[:, 3:] - np.cross(seen.point, seen.wrench[:, :3])
    beyond = np.abs(arm[:, 2] / seen.wrench[:, 2]) > TORSION
    doubted = found.status == palpate.Status.IMPLAUSIBLE
    asked = RequiredBounds.of(palpate.Contacts.single(np.arange(count) * 1e-3, found), (friction, TORSION))
    same = float(np.mean(doubted == beyond))
    got = f"{same:.2%}; {np.mean(beyond):.0%} of {count:,} turn that hard; said: {asked.exceeded or 'nothing'}"
    what = "flat on flat, torsion bound 5 mm: implausible just where the patch turns harder than that; what is said"
    yield Row(what, ">= 99 %, and a patch", got, same >= 0.99 and "patch" in asked.exceeded)
    reach = np.array([asked.reach(float(arm)) for arm in np.abs(wide.torque / wide.force[:, 2])])
    sound = float(np.mean(reach <= seen.reach + seen.depth))  # sideways forces act so far below the surface
    got = f"{sound:.2%}; largest {1e3 * reach.max():.2f} mm of {1e3 * seen.reach[np.argmax(reach)]:.2f}"
    yield Row("flat on flat: the reach said is no larger than that of the farthest contact", "all", got, sound == 1.0)


def _errors(found: palpate.ContactEstimate, seen: Pressed) -> np.ndarray:
    """(n,) [mm], of the answered."""
    return 1e3 * np.linalg.norm(found.point - seen.point, axis=1)[found.answered]


def _quantiles(error: np.ndarray) -> str:
    p50, p95, most = np.percentile(error, [50, 95, 100]) if len(error) else (np.nan,) * 3
    return f"median {p50:.4f}, p95 {p95:.4f}, max {most:.4f} mm"


def scene(tool: Tool, finger: str, turning: float = 0.0) -> tuple[Any, Any]:
    """The engine's model and data of a tool and a finger; torsional friction [m] where it is not 0."""
    import mujoco

    text = MJCF.format(
        tool=tool.geom, finger=finger, lever=LEVER, spring=SPRING, turning=TURNING, condim=4 if turning else 3
    )
    model = mujoco.MjModel.from_xml_string(text)
    model.geom_friction[:, 1] = turning
    return model, mujoco.MjData(model)


def press(tool: Tool, finger: str, count: int, rng: np.random.Generator, turning: float = 0.0) -> Pressed:
    """Touches at random places until there are `count` samples of at least 0.3 N.

    Args:
        tool: which is touched.
        finger: MJCF of what touches; a box lies flat on the tool's top.
        count: of samples.
        rng: the dice: place, depth, friction, drag and turn.
        turning: torsional friction [m].

    Raises:
        RuntimeError: the engine warned: its numbers would mean nothing.
    """
    import mujoco

    model, data = scene(tool, finger, turning)
    seen = list[tuple[Any, ...]]()
    while len(seen) < count:
        start, springs = _motion(tool, "box" in finger, rng)
        mujoco.mj_resetData(model, data)
        model.geom_friction[:, 0] = rng.uniform(0.2, 0.8)
        data.qpos[:] = start
        for step, spring in enumerate(springs):
            model.qpos_spring[:] = spring
            mujoco.mj_step(model, data)
            if step >= STEADY and step % EVERY == 0 and data.ncon:
                seen += _read(model, data)
        if np.any(data.warning.number):
            raise RuntimeError(f"the engine warns: {data.warning.number}")
    point, wrench, *rest = (np.array(part) for part in zip(*seen[:count], strict=True))
    return Pressed(point, wrench, *rest)


def _motion(tool: Tool, flat: bool, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where the finger begins (7,) and where its springs pull it (STEPS, 7): x, y, z and a quaternion w, x, y, z."""
    surface = next(iter(tool.surfaces.values()))
    half = np.array(tool.around)
    aim = rng.uniform(-half, half) + np.array([0.0, 0.0, 0.1 if flat else 0.0])
    place, normal, _ = surface.project(aim[None])
    if not flat and np.sum((aim - place[0]) * normal[0]) < 0:  # the dice fell inside
        return _motion(tool, flat, rng)
    start = place[0] + normal[0] * ((PLATE[2] if flat else BALL) + 1e-4)
    across = np.cross(normal[0], rng.standard_normal(3))
    across /= np.linalg.norm(across)
    share = (np.arange(STEPS) / STEPS)[:, None]
    pull = start + across * rng.uniform(0, 3e-3) * share
    pull -= normal[0] * rng.uniform(5e-4, 3e-3) * np.minimum(4 * share, 1.0)  # 1 to 6 N
    at = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]) if flat else Rotation.identity()
    turn = rng.uniform(-1, 1) * normal[0] + (rng.uniform(-0.1, 0.1, 3) if flat else 0.0)
    turned = Rotation.from_rotvec(share * turn) * at
    return np.concatenate([start, _wxyz(at)]), np.concatenate([pull, _wxyz(turned)], axis=1)


def _wxyz(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def _read(model: Any, data: Any) -> list[tuple[Any, ...]]:
    """One sample as `Pressed` has it, or none where it is felt faintly."""
    import mujoco

    forces = np.zeros((data.ncon, 6))
    for contact in range(data.ncon):
        mujoco.mj_contactForce(model, data, contact, forces[contact])
    pressing, aside = forces[:, 0], np.linalg.norm(forces[:, 1:3], axis=1)
    if pressing.sum() < 0.3:
        return []
    points = np.array(data.contact.pos)
    centre = pressing @ points / pressing.sum()
    # The sensor has what its parent does to the tool: with nothing that moves, the contacts' wrench with another sign.
    sensed = -np.array(data.sensordata)
    wrench = palpate.Pose(np.eye(3), [0.0, 0.0, -LEVER]).wrench_matrix() @ sensed  # T_tool_sensor
    reach = np.linalg.norm(points - centre, axis=1)[pressing > 0].max()
    used = aside.sum() / (model.geom_friction[0, 0] * pressing.sum())
    return [(centre, wrench, reach, -np.min(data.contact.dist), used)]
