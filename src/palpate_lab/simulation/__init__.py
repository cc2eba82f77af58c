"""Readings made forwards from known contacts: the truth that estimates are judged by."""

from __future__ import annotations

from palpate_lab.simulation.contacts import contact_wrenches, directed_forces, touch_wrenches
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session
from palpate_lab.simulation.shapes import Body, BumpySphere, Ellipsoid, Superquadric, icosphere

__all__ = [
    "Body",
    "BumpySphere",
    "Ellipsoid",
    "Session",
    "Superquadric",
    "contact_wrenches",
    "directed_forces",
    "icosphere",
    "simulate_session",
    "touch_wrenches",
    "write_session",
]
