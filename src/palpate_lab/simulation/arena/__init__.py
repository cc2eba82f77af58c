"""Simulate robots with a soft skin on a field with walls and boxes, in a physics engine."""

from __future__ import annotations

from palpate_lab.simulation.arena.fixed_layouts import TRAPS, paper_layout, trap_layout
from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.planner import require_solvable
from palpate_lab.simulation.arena.random_layouts import DENSITIES, random_layout
from palpate_lab.simulation.arena.settings import FRAME, RobotSettings
from palpate_lab.simulation.arena.world import ArenaWorld

__all__ = [
    "DENSITIES",
    "FRAME",
    "TRAPS",
    "ArenaLayout",
    "ArenaWorld",
    "Block",
    "RobotSettings",
    "paper_layout",
    "random_layout",
    "require_solvable",
    "trap_layout",
]
