"""Palpate: where, how hard and in which direction a robot is being touched.

The front door. Everything that a program needs day to day is here; the rooms behind it are documented in
docs/architecture.md.
"""

from palpate.calibration.load_cells import identify_load_cells
from palpate.calibration.mounting import Mounting, identify_mounting
from palpate.calibration.payload import identify_payload
from palpate.calibration.skin_map import map_skin
from palpate.contact import Candidates, ContactEstimate, Locator, Status, WrenchEstimator, locate
from palpate.contact.several import Skin
from palpate.errors import GeometryError, InputError, NotIdentifiable, PalpateError
from palpate.sensors import Butterworth, ForceTorque, Kalman, Payload, Recording
from palpate.sensors.load_cell_array import LoadCellArray
from palpate.sensors.load_cells import LoadCells
from palpate.spatial.pose import Pose
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Mesh, Surface, plane

__version__ = "0.3.0"

__all__ = [
    "Butterworth",
    "Candidates",
    "ContactEstimate",
    "ForceTorque",
    "GeometryError",
    "InputError",
    "Kalman",
    "LoadCellArray",
    "LoadCells",
    "Locator",
    "Mesh",
    "Mounting",
    "NotIdentifiable",
    "PalpateError",
    "Payload",
    "Pose",
    "Recording",
    "Skin",
    "Status",
    "Surface",
    "Wrench",
    "WrenchEstimator",
    "identify_load_cells",
    "identify_mounting",
    "identify_payload",
    "locate",
    "map_skin",
    "plane",
]
