"""Arenas: what is drawn can be crossed, what cannot be crossed is refused with the reason."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy import ndimage

from palpate.errors import InputError
from palpate_lab.simulation.arena.fixed_layouts import paper_layout, trap_layout
from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.planner import require_solvable
from palpate_lab.simulation.arena.random_layouts import random_layout

RADIUS = 0.065  # of a robot, and 10 mm
SEEDS = range(5)


def _inside(block: Block, points: np.ndarray) -> np.ndarray:
    """Left of each side, from one corner to the next."""
    corners = block.corners()
    sides = np.roll(corners, -1, axis=0) - corners
    off = points[..., None, :] - corners
    return np.asarray((sides[:, 0] * off[..., 1] - sides[:, 1] * off[..., 0] >= 0.0).all(axis=-1))


def _areas(layout: ArenaLayout, cell: float, radius: float) -> np.ndarray:
    """Numbered areas in which a disc goes; pixels that are grown, and no distances."""
    shape = [round(side / cell) for side in layout.size]
    points = np.stack(np.meshgrid(*((np.arange(n) + 0.5) * cell for n in shape), indexing="ij"), axis=-1)
    solid = np.zeros(shape, dtype=bool)
    for block in layout.blocks:
        low, high = ((edge / cell).astype(int) for edge in (block.corners().min(axis=0), block.corners().max(axis=0)))
        about = tuple(slice(max(i, 0), max(k, 0) + 1) for i, k in zip(low, high, strict=True))
        solid[about] |= _inside(block, points[about])
    solid = np.pad(solid, 1, constant_values=True)
    return ndimage.label(ndimage.distance_transform_edt(~solid)[1:-1, 1:-1] * cell > radius)[0]


def _open(*blocks: Block, starts: object = ((0.3, 0.5, 0.0),), goals: object = ((1.7, 0.5),)) -> ArenaLayout:
    return ArenaLayout((2.0, 1.0), blocks, np.array(starts), np.array(goals), "test")


def _across(*gap: float) -> tuple[Block, Block]:
    """A wall across that field at x = 1, but for a gap."""
    low, high = gap
    return Block(1.0, low / 2, 0.0, (0.02, low / 2)), Block(1.0, (1.0 + high) / 2, 0.0, (0.02, (1.0 - high) / 2))


@pytest.mark.parametrize("density", ["sparse", "paper", "dense"])
def test_a_robot_has_a_way_through_each_arena_that_is_drawn(density: str) -> None:
    for seed in SEEDS:
        layout = random_layout(seed, density=density)
        areas = _areas(layout, 0.01, 0.055)
        for start, goal in zip(layout.starts[:, :2], layout.goals, strict=True):
            one, two = (areas[tuple((place / 0.01).astype(int))] for place in (start, goal))
            assert one == two > 0


def test_an_arena_is_as_full_as_it_says() -> None:
    for density, share in {"sparse": 0.5, "paper": 1.0, "dense": 1.6}.items():
        layout = random_layout(1, density=density)
        assert (layout.name, layout.size) == (f"{density} 1", (3.0, 2.0))
        assert len(layout.movable) == round(6 * share)
        assert len(layout.blocks) - len(layout.movable) == round(10 * share) + round(2 * share)


def test_blocks_starts_and_goals_are_where_they_belong() -> None:
    pushes: list[float] = []
    for seed in SEEDS:
        layout = random_layout(seed)
        assert (layout.starts[:, 0] <= 0.4).all()
        assert (np.abs(layout.starts[:, 2]) <= pi).all()
        assert (layout.goals[:, 0] >= 2.6).all()
        assert min(np.hypot(*(a - b)) for k, a in enumerate(layout.goals) for b in layout.goals[:k]) >= 0.25
        for k, block in enumerate(layout.blocks):
            assert all(not _inside(other, block.corners()).any() for other in layout.blocks[:k])
            assert not _inside(block, np.concatenate([layout.starts[:, :2], layout.goals])).any()
        for block in layout.movable:
            assert (block.corners() > 0.0).all()
            assert (block.corners() < layout.size).all()
        pushes += [block.resistance for block in layout.movable]
    light = [push for push in pushes if 0.6 <= push <= 2.0]
    assert len(light) + sum(4.0 <= push <= 8.0 for push in pushes) == len(pushes)
    assert len(pushes) // 2 < len(light) < len(pushes)  # most can be pushed, some cannot


def test_more_robots_have_as_much_room_each() -> None:
    layout = random_layout(0, robots=16)
    assert layout.robots == 16
    assert layout.size == pytest.approx((6.0, 4.0))
    assert len(layout.movable) == 24
    assert random_layout(0, robots=1).size == (3.0, 2.0)


def test_fixed_arenas_can_be_crossed() -> None:
    for layout in (paper_layout(), trap_layout("u"), trap_layout("corridor")):
        require_solvable(layout, RADIUS)
    assert paper_layout().robots == 4
    assert len(paper_layout().movable) >= 4
    with pytest.raises(InputError, match='the trap "v" is unknown'):
        trap_layout("v")


def test_the_plug_of_the_papers_arena_shortens_the_way() -> None:
    """It closes its passage, and without the other one somebody has to push it."""
    layout = paper_layout()
    shut = Block(2.0, 1.7375, 0.0, (0.01, 0.14))
    closed = replace(layout, blocks=(*layout.blocks, shut))
    with pytest.raises(InputError, match="robot 1 has no way") as caught:
        require_solvable(closed, RADIUS)
    assert "Movable blocks count as solid" in caught.value.hint
    require_solvable(closed, RADIUS, pushing=True)


@pytest.mark.parametrize("turn", [0.0, 0.4, pi / 4])
def test_a_passage_is_open_to_discs_that_fit(turn: float) -> None:
    """Turned about the middle of the field; 30 mm is what the planner's cells may cost."""
    wide = 0.20
    cos, sin = np.cos(turn), np.sin(turn)
    places = [(side * (0.5 * wide + 1.0) * -sin, side * (0.5 * wide + 1.0) * cos) for side in (-1.0, 1.0)]
    sides = tuple(Block(1.0 + x, 0.5 + y, turn, (0.05, 1.0)) for x, y in places)
    layout = _open(*sides)
    require_solvable(layout, 0.5 * wide - 0.015)
    with pytest.raises(InputError, match="no way"):
        require_solvable(layout, 0.5 * wide + 0.001)


def test_refusals_name_the_robot_and_what_is_wrong() -> None:
    two = ((0.3, 0.3, 0.0), (0.3, 0.7, 0.0)), ((1.7, 0.3), (1.7, 0.7))
    box = Block(0.3, 0.5, 0.3, (0.05, 0.1), 0.2)
    cases = {
        "the start of robot 1 at .* is in a wall": _open(starts=((0.06, 0.5, 0.0),)),
        "the goal of robot 1 at .* is in a wall": _open(goals=((1.5, 1.1),)),
        "the start of robot 1 at .* is in block 1 at": _open(box),
        "the goal of robot 2 at .* is in block 1 at": _open(replace(box, x=1.7, y=0.6), starts=two[0], goals=two[1]),
        "the starts of robots 1 and 2 overlap.* 80 mm": _open(starts=((0.3, 0.3, 0), (0.38, 0.3, 0)), goals=two[1]),
        "the goals of robots 1 and 2 overlap.* 100 mm": _open(starts=two[0], goals=((1.7, 0.3), (1.7, 0.4))),
        "robot 1 has no way from": _open(*_across(0.4, 0.5)),
    }
    for message, layout in cases.items():
        with pytest.raises(InputError, match=message) as caught:
            require_solvable(layout, RADIUS)
        assert caught.value.hint
        assert caught.value.where == 'arena "test"'
    require_solvable(_open(*_across(0.4, 0.57)), RADIUS)


def test_what_is_no_arena_is_refused() -> None:
    cases = {
        "half must be two positive": lambda: Block(0.0, 0.0, 0.0, (0.0, 0.1)),
        "mass must be positive": lambda: Block(0.0, 0.0, 0.0, (0.1, 0.1), 0.0),
        "friction must be positive": lambda: Block(0.0, 0.0, 0.0, (0.1, 0.1), 1.0, -0.1),
        "x, y and turn": lambda: Block(np.nan, 0.0, 0.0, (0.1, 0.1)),
        "starts and goals must be finite": lambda: _open(starts=((np.nan, 0.0, 0.0),)),
        "size must be": lambda: ArenaLayout((0.0, 1.0), (), np.zeros((1, 3)), np.zeros((1, 2))),
        'density "full"': lambda: random_layout(0, density="full"),
        "robots must be 1 or more": lambda: random_layout(0, robots=0),
    }
    for message, build in cases.items():
        with pytest.raises(InputError, match=message):
            build()


def test_distance_to_a_block_is_that_to_its_nearest_point() -> None:
    """Against its edges, sampled 1 mm apart; inside it is negative."""
    block = Block(0.2, -0.1, 0.7, (0.15, 0.05))
    corners = block.corners()
    along = np.linspace(0.0, 1.0, 301)[:, None]
    edge = np.concatenate([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    points = np.random.default_rng(2).uniform(-0.3, 0.5, (200, 2))
    expected = np.linalg.norm(points[:, None] - edge, axis=2).min(axis=1) * np.where(_inside(block, points), -1, 1)
    np.testing.assert_allclose(block.distance(points), expected, atol=1e-4)
