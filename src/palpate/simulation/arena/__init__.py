"""Robots with a soft skin on a field with walls and boxes, in a physics engine."""

from __future__ import annotations

from palpate.simulation.arena.layout import Block, Layout
from palpate.simulation.arena.layouts import DENSITIES, random_layout
from palpate.simulation.arena.planner import require_solvable
from palpate.simulation.arena.settings import FRAME, RobotSettings
from palpate.simulation.arena.world import ArenaWorld

__all__ = ["DENSITIES", "FRAME", "ArenaWorld", "Block", "Layout", "RobotSettings", "random_layout", "require_solvable"]
