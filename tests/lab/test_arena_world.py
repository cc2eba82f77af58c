"""The arena's physics: stiffness of the skin, friction of blocks and tracks, kinematics, and what touches say."""

import sys
from math import cos, hypot, pi, sin
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.settings import FRAME, RobotSettings
from palpate_lab.simulation.arena.world import ArenaWorld

pytest.importorskip("mujoco")

EVEN = RobotSettings(uneven=0.0)
GRAVITY = 9.81
GRIP = EVEN.grip * EVEN.mass * GRAVITY  # 5.49 N
AHEAD = np.array([[0.05, 0.05]])
STILL = np.zeros((1, 2))


def _world(*blocks: Block, starts: list[list[float]] | None = None) -> ArenaWorld:
    """Two by two metres; a robot that looks at (0.6, 1) from 40 mm off, or these."""
    places = np.array(starts or [[0.505, 1.0, 0.0]])
    return ArenaWorld(ArenaLayout((2.0, 2.0), blocks, places, places[:, :2]), EVEN)


def _box(push: float, turn: float = 0.0, half: tuple[float, float] = (0.05, 0.05)) -> Block:
    """With a side at x = 0.6, that slides under a push of so many newtons; fixed if that is infinite."""
    friction = 0.4
    mass = None if np.isinf(push) else push / (friction * GRAVITY)
    return Block(0.6 + half[0], 1.0, turn, half, mass, friction)


def _run(world: ArenaWorld, wheels: np.ndarray, seconds: float) -> list[np.ndarray]:
    """What touched the first robot in each frame."""
    seen: list[np.ndarray] = []
    for _ in range(round(seconds / FRAME)):
        world.step(wheels)
        seen.append(world.touches(0))
    return seen


def _press(world: ArenaWorld, force: float, wheels: np.ndarray = AHEAD) -> None:
    """Drives until the first robot is pressed with this force, and stops."""
    for _ in range(200):
        world.step(wheels)
        touches = world.touches(0)
        if len(touches) and touches[0, 1] >= force:
            break
    else:
        raise AssertionError("no touch")
    _run(world, np.zeros_like(wheels), 0.5)


@pytest.mark.parametrize("force", [1.0, 3.0])
def test_the_skin_bears_its_stiffness_on_a_fixed_block_a_movable_one_and_a_wall(force: float) -> None:
    """At rest force = k depth, with the depth from the poses; the engine's own softness is none of it."""
    for world in (_world(_box(np.inf)), _world(_box(6.0)), _world(starts=[[1.905, 1.0, 0.0]])):
        _press(world, force)
        side = world.blocks[0, 0] - 0.05 if len(world.blocks) else 0.6 if world.layout.blocks else 2.0
        depth = EVEN.radius - (side - world.poses[0, 0])
        (touch,) = world.touches(0)
        assert touch[1] > 0.8 * force
        assert touch[1] == pytest.approx(EVEN.stiffness * depth, rel=0.01)
        assert touch[3] == pytest.approx(depth, abs=2e-5)


def test_two_skins_are_springs_in_series() -> None:
    world = _world(starts=[[0.5, 1.0, 0.0], [0.63, 1.0, 2.0]])
    _press(world, 3.0, np.array([[0.05, 0.05], [0.0, 0.0]]))
    overlap = 2 * EVEN.radius - np.hypot(*np.diff(world.poses[:, :2], axis=0)[0])
    (one,), (two,) = world.touches(0), world.touches(1)
    assert one[1] == two[1] == pytest.approx(0.5 * EVEN.stiffness * overlap, rel=0.01)
    assert one[3] == two[3] == pytest.approx(0.5 * overlap, abs=2e-5)
    assert one[0] == pytest.approx(0.0, abs=1e-3)
    assert two[0] == pytest.approx(pi - 2.0, abs=1e-3)
    assert one[4] == two[4] == 2.0


@pytest.mark.parametrize("push", [0.8, 2.0, 4.5])
def test_a_block_is_pushed_with_friction_times_weight(push: float) -> None:
    """Once it slides evenly, 1 %: what is left of its jolt; meanwhile it goes as fast as the robot."""
    world = _world(_box(push))
    _run(world, AHEAD, 2.0)
    start = world.blocks[0, 0]
    forces = [touches[0, 1] for touches in _run(world, AHEAD, 1.0)]
    assert np.mean(forces) == pytest.approx(push, rel=0.01)
    assert world.blocks[0, 0] - start == pytest.approx(0.05, rel=0.01)


def test_a_block_too_heavy_stays_and_the_tracks_slip() -> None:
    """They pull with friction times weight; friction that creeps lets the block go by less than 1 mm/s."""
    world = _world(_box(8.0))
    (*_, touches) = _run(world, AHEAD, 3.0)
    assert touches[0, 1] == pytest.approx(GRIP, rel=0.005)
    assert abs(world.blocks[0, 0] - 0.65) < 1e-3


def test_a_push_short_of_friction_does_not_move_a_block() -> None:
    world = _world(_box(2.0))
    _press(world, 1.5)
    start = world.blocks[0].copy()
    _run(world, STILL, 2.0)
    assert world.touches(0)[0, 1] > 1.3
    np.testing.assert_allclose(world.blocks[0], start, atol=2e-4)


def test_a_block_is_turned_by_more_than_its_base_holds() -> None:
    """Friction times weight times the mean distance of the base's points from its middle: 4 % either way decide."""
    a, b = half = 0.10, 0.05
    x, y = np.meshgrid((np.arange(200) + 0.5) / 200 * a, (np.arange(200) + 0.5) / 200 * b)
    holds = 1.0 * np.hypot(x, y).mean()
    turned: list[float] = []
    for moment in (0.96 * holds, 1.04 * holds):
        world = _world(_box(1.0, half=half))
        _run(world, STILL, 0.2)  # until it stands
        world.data.xfrc_applied[world.model.body("block0").id, 5] = moment
        _run(world, STILL, 0.5)
        turned.append(world.blocks[0, 2])
    assert 0.0 <= turned[0] < 0.01
    spun_up = 0.04 * 0.4 * GRAVITY * np.hypot(x, y).mean() * 3 / (a * a + b * b)  # rad/s^2
    assert turned[1] == pytest.approx(0.5 * spun_up * 0.5**2, rel=0.2)


def test_blocks_are_hard_to_each_other_and_to_walls() -> None:
    """Pushed against a wall, one behind the other, each gives less than 0.2 mm."""
    first, second = Block(1.85, 1.0, 0.0, (0.05, 0.05), 0.2), Block(1.95, 1.0, 0.0, (0.05, 0.05), 0.2)
    world = _world(first, second, starts=[[1.74, 1.0, 0.0]])
    _run(world, AHEAD, 2.0)
    assert world.touches(0)[0, 1] == pytest.approx(GRIP, rel=0.01)
    assert world.blocks[1, 0] - 1.95 < 2e-4
    assert world.blocks[0, 0] - 1.85 < 4e-4


@pytest.mark.parametrize("wheels", [(0.05, 0.05), (-0.05, -0.05), (0.05, -0.05), (0.03, 0.05), (0.05, 0.0)])
def test_a_free_robot_goes_as_its_tracks_do(wheels: tuple[float, float]) -> None:
    """An arc, less what is lost until it is up to speed: v^2 / (2 mu g) of way, I omega^2 / (2 M) of turn."""
    world = _world(starts=[[1.0, 1.0, 0.3]])
    _run(world, np.array([wheels]), 2.0)
    v = sum(wheels) / 2
    w = (wheels[1] - wheels[0]) / EVEN.track or 1e-9  # straight on is a circle of 50,000 km
    lost = v * v / (2 * EVEN.grip * GRAVITY)
    late = 0.5 * EVEN.mass * EVEN.radius**2 * w * w / (EVEN.track * GRIP)
    end = 0.3 + 2.0 * w
    way = v / w * (sin(end) - sin(0.3)), v / w * (cos(0.3) - cos(end))
    x, y, heading = world.poses[0]
    assert hypot(x - 1.0 - way[0], y - 1.0 - way[1]) < lost + v * late * 2 + 1e-5
    assert abs((heading - end + pi) % (2 * pi) - pi) < late + 1e-3
    assert world.velocities[0, 2] == pytest.approx(w, abs=1e-3)
    np.testing.assert_allclose(world.velocities[0, :2], [v * cos(end), v * sin(end)], atol=2e-4)


def test_a_robot_that_stops_holds_what_it_presses() -> None:
    """Its tracks do not give way below their grip."""
    world = _world(_box(np.inf))
    _press(world, 3.0)
    before = world.touches(0)[0, 1]
    _run(world, STILL, 2.0)
    assert before > 3.0
    assert world.touches(0)[0, 1] == pytest.approx(before, rel=0.01)


def test_the_grip_is_much_the_same_in_all_directions() -> None:
    """A robot that stands holds 0.98 of it and slides under 1.1 of it, whichever way it is pushed."""
    for angle in np.radians([0.0, 22.5, 45.0, 100.0]):
        moved: list[float] = []
        for share in (0.98, 1.1):
            world = _world(starts=[[1.0, 1.0, 0.2]])
            world.data.xfrc_applied[world.model.body("robot0").id, :2] = (
                share * GRIP * np.array([cos(angle), sin(angle)])
            )
            _run(world, STILL, 0.3)
            moved.append(float(np.hypot(*(world.poses[0, :2] - 1.0))))
        assert moved[0] < 2e-4
        assert moved[1] > 2e-3


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_shear_opposes_the_skin_that_turns(sense: float) -> None:
    """The whole friction of what slides, away from where the skin goes; the place moves against the turn."""
    world = _world(_box(np.inf))
    _press(world, 3.0)
    (*_, touches) = _run(world, sense * np.array([[-0.02, 0.02]]), 1.0)
    (angle, normal, shear, _, kind) = touches[0]
    assert shear == pytest.approx(-sense * EVEN.friction * normal, rel=0.01)
    assert angle == pytest.approx(-world.poses[0, 2], abs=0.01)
    assert np.sign(world.poses[0, 2]) == sense
    assert kind == 0.0


def test_a_corner_is_told_from_a_side() -> None:
    """A box that stands on its corner, and one that is met in the middle of a side."""
    half = 0.05
    kinds: list[float] = []
    for turn in (0.0, pi / 4):
        reach = half * max(cos(turn) + sin(turn), 1.0)
        world = _world(Block(0.6 + reach, 1.0, turn, (half, half)))
        _press(world, 1.0)
        kinds.append(world.touches(0)[0, 4])
    assert kinds == [0.0, 1.0]


def test_touches_are_sorted_and_in_the_robots_frame() -> None:
    """In a corner of the field, looking away from it: walls behind to the left and to the right."""
    heading = pi / 4
    world = _world(starts=[[0.052, 0.050, heading]])
    world.step(STILL)
    touches = world.touches(0)
    np.testing.assert_allclose(touches[:, 0], [-pi / 2 - heading, pi - heading], atol=0.01)
    np.testing.assert_allclose(touches[:, 3], [0.005, 0.003], atol=3e-4)
    assert not touches.flags.writeable


def test_it_says_what_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)  # where the engine writes its log
    world = _world()
    assert world.blocks.shape == (0, 3)
    assert world.touches(0).shape == (0, 5)
    for wheels in (np.zeros((2, 2)), np.array([[np.nan, 0.0]])):
        with pytest.raises(InputError, match="two finite speeds"):
            world.step(wheels)
    with pytest.raises(InputError, match="stiffness must be positive"):
        RobotSettings(stiffness=0.0)
    with pytest.raises(InputError, match="uneven must be a share"):
        RobotSettings(uneven=-0.1)
    world.data.qvel[3] = 1e12
    with pytest.raises(RuntimeError, match="gave up"):
        world.step(STILL)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match="needs MuJoCo"):
        _world()
