"""Palpate: where, how hard and in which direction a robot is being touched.

The front door. Everything that a program needs day to day is here; the rooms behind it are documented in
docs/architecture.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from palpate.calibration.load_cells import identify_load_cells
from palpate.calibration.mounting import Mounting, identify_mounting
from palpate.calibration.payload import identify_payload
from palpate.calibration.skin_map import Sheet, map_skin
from palpate.contact import Candidates, ContactEstimate, Contacts, Locator, Status, WrenchEstimator, locate
from palpate.contact.ring_estimator import RingEstimator
from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.errors import GeometryError, InputError, NotIdentifiable, PalpateError
from palpate.sensors import Butterworth, Compensation, ForceTorque, Kalman, Payload, Recording
from palpate.sensors.load_cell_array import LoadCellArray
from palpate.sensors.load_cells import LoadCells
from palpate.sensors.marker_ring import MarkerRing
from palpate.sensors.taxels import TaxelBody
from palpate.spatial.pose import Pose
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Mesh, Surface, plane

if TYPE_CHECKING:
    from palpate.control.align import AlignController
    from palpate.control.drive import DifferentialDrive
    from palpate.control.paper_navigator import PaperNavigator
    from palpate.control.touch_navigator import TouchNavigator
    from palpate.io.live.live import open_live
    from palpate.io.pipeline import estimate, open_log
    from palpate.io.rig import load_rig

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

_LATER = {
    "AlignController": "palpate.control.align",
    "DifferentialDrive": "palpate.control.drive",
    "PaperNavigator": "palpate.control.paper_navigator",
    "TouchNavigator": "palpate.control.touch_navigator",
    "estimate": "palpate.io.pipeline",
    "open_live": "palpate.io.live.live",
    "open_log": "palpate.io.pipeline",
    "load_rig": "palpate.io.rig",
}


def __getattr__(name: str) -> object:
    """What is slow to import, when it is first asked for: tables of files, compiled loops of control."""
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module 'palpate' has no attribute {name!r}")
