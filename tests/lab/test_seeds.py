"""One seed is one simulation, to the last bit, and another seed another in all that it draws."""

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from palpate.signals.drift import Drift
from palpate_lab.simulation.arena.random_layouts import random_layout
from palpate_lab.simulation.arena.world import ArenaWorld
from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.drift import simulate_drift
from palpate_lab.simulation.load_cell_bench import Bench
from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab
from palpate_lab.simulation.phantom.motion import motion, unplanned
from palpate_lab.simulation.poke_bench import PokeBench
from palpate_lab.simulation.ring_camera import Look, RenderedCamera, RingCamera
from palpate_lab.simulation.ring_session import RingUnit
from palpate_lab.simulation.robot.bodies import hand
from palpate_lab.simulation.robot.run import RobotDevices, RobotRunSettings, simulate_robot
from palpate_lab.simulation.session import simulate_session
from palpate_lab.simulation.skin_touches import simulate_touches
from palpate_lab.simulation.three_axis_skins import magnetic_skin, pillar_array
from palpate_lab.simulation.three_axis_touches import three_axis_touches
from palpate_lab.simulation.touched.run import simulate_forearm
from palpate_lab.simulation.touched.settings import ForearmSettings
from tests.support.state import differences

for _module in ("cv2", "mujoco", "skfem"):
    pytest.importorskip(_module)

dice = np.random.default_rng
DISCS = 0.051 * np.exp(2j * np.pi * np.arange(24) / 24)[:, None] + 0.0015 * np.exp(2j * np.pi * np.arange(32) / 32)
PATH = (((-9.0, -2.0), (-9.0, 2.0)),)  # mm, of a ball on a fingertip
Drawn = tuple[object, ...]


def _arena(seed: int) -> Drawn:
    """Tracks are uneven, each seed in its way."""
    world = ArenaWorld(random_layout(3), seed=seed)
    for command in np.repeat(dice(1).uniform(-0.03, 0.07, (30, 4, 2)), 5, axis=0):
        world.step(command)
    return ([world.poses, world.velocities, world.blocks, *(world.touches(k) for k in range(4))],)


def _phantom(seed: int) -> Drawn:
    lab = PhantomLab(LabSettings(motion=motion("in-plane", period=2.0, begin=0.1), seed=seed, lost=0.2))
    lab.start(-0.003)
    return ([*(lab.step().wrench for _ in range(120)), lab.truth().joints],)


def _pokes(seed: int) -> Drawn:
    rng = dice(seed)
    bench = PokeBench.drawn(rng)
    pokes, touches = bench.session(rng, 20).pokes, simulate_touches(bench, rng, 3)
    return pokes.wrench, pokes.response, touches.frames, touches.point


def _forearm(seed: int) -> Drawn:
    run = simulate_forearm(dice(seed), ForearmSettings(seconds=6.0, quiet=1.0, wrench_rate=200))
    return run.wrench.wrenches(), run.truth.force, run.skin.channels, run.touches


def _hand(seed: int) -> Drawn:
    robot, settings = hand(dice(3)), RobotRunSettings(seconds=6.0, touches=4, wrench_rate=200)
    run = simulate_robot(robot, RobotDevices.drawn(robot, dice(5), settings.encoder), settings, dice(seed))
    return run.joints, run.readings, run.contacts


def _frame(seed: int) -> Drawn:
    discs = np.stack([DISCS.real, DISCS.imag, 0.0 * DISCS.real], axis=-1)
    return (RenderedCamera(RingCamera(), Look(), dice(seed)).frame([discs], 0.3, blobs=3),)


def _session(seed: int) -> Drawn:
    session = simulate_session(seed, touches=2, facets=20)
    return session.touches.wrenches(), session.free_motion.wrenches(), session.truth


def _three_axis(seed: int) -> Drawn:
    skins = magnetic_skin(4, 4, seed), pillar_array(4, 4, seed)
    return tuple(skin.readings(three_axis_touches(skin.positions, dice(seed), 2), seed) for skin in skins)


MADE: dict[str, Callable[[int], Drawn]] = {
    "contacts": lambda seed: (touch_wrenches(np.eye(3), np.eye(3), dice(seed), pitch=1e-3),),
    "drift": lambda seed: (simulate_drift(np.arange(9.0), Drift([1.0], [1.0], 2.0), dice(seed)),),
    "session": _session,
    "layout": lambda seed: (random_layout(seed).blocks, random_layout(seed).starts, random_layout(seed).goals),
    "arena": _arena,
    "fingertip": lambda seed: (replace(Bench(), seed=seed).cells().sensitivity,),
    "bench": lambda seed: attrgetter("voltages", "friction")(Bench(paths=PATH).run(seed, thin=50)),
    "phantom": _phantom,
    "unplanned motion": lambda seed: (unplanned(seed, step_at=5.0),),
    "pokes": _pokes,
    "forearm": _forearm,
    "hand": _hand,
    "ring": lambda seed: (RingUnit.drawn(seed),),
    "frame": _frame,
    "three axes": _three_axis,
}


@pytest.mark.parametrize("name", MADE)
def test_a_seed_is_one_simulation(name: str) -> None:
    one, again, other = (MADE[name](seed) for seed in (3, 3, 4))
    assert not list(differences(again, one))
    assert all(list(differences(theirs, ours)) for theirs, ours in zip(other, one, strict=True))
