"""Simulate readings forwards from known contacts, the truth that estimates are judged by."""

from __future__ import annotations

from palpate_lab.simulation.contacts import contact_wrenches, directed_forces, touch_wrenches
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session
from palpate_lab.simulation.shapes import Body, BumpySphere, EllipsoidBody, Superquadric, icosphere
from palpate_lab.simulation.skin_session import load_cell_presses, simulate_protocol

__all__ = [
    "BENCHES",
    "Body",
    "BumpySphere",
    "EllipsoidBody",
    "Session",
    "Superquadric",
    "contact_wrenches",
    "directed_forces",
    "icosphere",
    "load_cell_presses",
    "simulate_protocol",
    "simulate_session",
    "touch_wrenches",
    "write_session",
]
