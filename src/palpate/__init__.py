"""Palpate: where, how hard and in which direction a robot is being touched.

The front door. Everything that a program needs day to day is here; the rooms behind it are documented in
docs/architecture.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.calibration.load_cells import identify_load_cells
    from palpate.calibration.mounting import Mounting, identify_mounting
    from palpate.calibration.payload import identify_payload
    from palpate.calibration.skin_map import Sheet, map_skin
    from palpate.contact import Candidates, ContactEstimate, Contacts, Locator, Status, WrenchEstimator, locate
    from palpate.contact.ring_estimator import RingEstimator
    from palpate.contact.taxel_estimator import TaxelEstimator
    from palpate.control.align import AlignController
    from palpate.control.drive import DifferentialDrive
    from palpate.control.paper_navigator import PaperNavigator
    from palpate.control.touch_navigator import TouchNavigator
    from palpate.errors import GeometryError, InputError, NotIdentifiable, PalpateError
    from palpate.io.live.live import open_live
    from palpate.io.pipeline import estimate, open_log
    from palpate.io.rig import load_rig
    from palpate.sensors import Butterworth, Compensation, ForceTorque, Kalman, Payload, Recording
    from palpate.sensors.load_cell_array import LoadCellArray
    from palpate.sensors.load_cells import LoadCells
    from palpate.sensors.marker_ring import MarkerRing
    from palpate.sensors.taxels import TaxelBody
    from palpate.spatial.pose import Pose
    from palpate.spatial.wrench import Wrench
    from palpate.surfaces import Mesh, Surface, plane

__version__ = "0.3.0"

__all__ = [
    "AlignController",
    "Butterworth",
    "Candidates",
    "Compensation",
    "ContactEstimate",
    "Contacts",
    "DifferentialDrive",
    "ForceTorque",
    "GeometryError",
    "InputError",
    "Kalman",
    "LoadCellArray",
    "LoadCells",
    "Locator",
    "MarkerRing",
    "Mesh",
    "Mounting",
    "NotIdentifiable",
    "PalpateError",
    "PaperNavigator",
    "Payload",
    "Pose",
    "Recording",
    "RingEstimator",
    "Sheet",
    "Status",
    "Surface",
    "TaxelBody",
    "TaxelEstimator",
    "TouchNavigator",
    "Wrench",
    "WrenchEstimator",
    "estimate",
    "identify_load_cells",
    "identify_mounting",
    "identify_payload",
    "load_rig",
    "locate",
    "map_skin",
    "open_live",
    "open_log",
    "plane",
]

_HOME = {
    "identify_load_cells": "palpate.calibration.load_cells",
    "Mounting": "palpate.calibration.mounting",
    "identify_mounting": "palpate.calibration.mounting",
    "identify_payload": "palpate.calibration.payload",
    "Sheet": "palpate.calibration.skin_map",
    "map_skin": "palpate.calibration.skin_map",
    "Candidates": "palpate.contact",
    "ContactEstimate": "palpate.contact",
    "Contacts": "palpate.contact",
    "Locator": "palpate.contact",
    "Status": "palpate.contact",
    "WrenchEstimator": "palpate.contact",
    "locate": "palpate.contact",
    "RingEstimator": "palpate.contact.ring_estimator",
    "TaxelEstimator": "palpate.contact.taxel_estimator",
    "AlignController": "palpate.control.align",
    "DifferentialDrive": "palpate.control.drive",
    "PaperNavigator": "palpate.control.paper_navigator",
    "TouchNavigator": "palpate.control.touch_navigator",
    "GeometryError": "palpate.errors",
    "InputError": "palpate.errors",
    "NotIdentifiable": "palpate.errors",
    "PalpateError": "palpate.errors",
    "open_live": "palpate.io.live.live",
    "estimate": "palpate.io.pipeline",
    "open_log": "palpate.io.pipeline",
    "load_rig": "palpate.io.rig",
    "Butterworth": "palpate.sensors",
    "Compensation": "palpate.sensors",
    "ForceTorque": "palpate.sensors",
    "Kalman": "palpate.sensors",
    "Payload": "palpate.sensors",
    "Recording": "palpate.sensors",
    "LoadCellArray": "palpate.sensors.load_cell_array",
    "LoadCells": "palpate.sensors.load_cells",
    "MarkerRing": "palpate.sensors.marker_ring",
    "TaxelBody": "palpate.sensors.taxels",
    "Pose": "palpate.spatial.pose",
    "Wrench": "palpate.spatial.wrench",
    "Mesh": "palpate.surfaces",
    "Surface": "palpate.surfaces",
    "plane": "palpate.surfaces",
}
_ROOMS = {"calibration", "contact", "errors", "sensors", "spatial", "surfaces"}


def __getattr__(name: str) -> object:
    """Import what is asked for, once: a program that needs little of Palpate starts quickly."""
    if name in _HOME:
        value: object = getattr(import_module(_HOME[name]), name)
    elif name in _ROOMS:
        value = import_module(f"palpate.{name}")
    else:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME, *_ROOMS})
