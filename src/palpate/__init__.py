"""Palpate: where, how hard and in which direction a robot is being touched.

    import palpate  # lengths in m, forces in N, torques in N m, times in s; quaternions are x, y, z, w

    # a wrench, force first; `contact` is true where one was found
    contact = palpate.locate([0, 0, -5, 0.02, 0, 0], "probe.stl", unit="mm", noise=(0.02, 0.001))
    contact.status, contact.point, contact.normal, contact.force, contact.covariance

    # a log, by a rig that `palpate rig new` writes; a tared one by a mesh alone; a DataFrame will do for the file
    contacts = palpate.estimate("log.csv", "rig.toml")
    contacts = palpate.estimate("log.csv", mesh="probe.stl", unit="mm")
    contacts[3], contacts.point[contacts.answered], contacts.status == palpate.Status.CONTACT, contacts.notes
    contacts[(contacts.time >= 1.0) & (contacts.time < 2.0)]

    # touches
    for touch in contacts.touches():
        touch.start, touch.duration, touch.point, touch.peak_force

    # a file, a table, a drawing
    contacts.save("contacts.mcap")
    contacts = palpate.Contacts.load("contacts.mcap")
    contacts.to_polars()
    contacts.plot(palpate.Mesh.load("probe.stl", unit="mm")).save("contacts.html")

    # a loop of your own
    estimator = palpate.load_rig("rig.toml").estimator(rate=200.0)
    contacts = estimator.update(time, wrench, rotation)

    # a fingertip with an equation; a skin of taxels
    contact = palpate.locate([0, 0, -5, 0.02, 0, 0], palpate.surfaces.Sphere(0.01))
    skin = palpate.TaxelEstimator(palpate.TaxelBody.anywhere(positions, normals))
    skin.tare(palpate.Recording(times, {"cells": readings}))
    contacts = skin.run(palpate.Recording(times, {"cells": readings}))

    # the payload, from wrenches in poses in which nothing is touched; or one that is known
    palpate.identify_payload(wrenches, quaternions).save("payload.toml")
    sensor = palpate.Compensation(palpate.ForceTorque(noise=(0.02, 0.001)), palpate.Payload(mass=0.4))
    estimator = palpate.WrenchEstimator(mesh, sensor, mount=palpate.Pose.from_quaternion([0, 0, 0, 1], [0, 0, 0.085]))

    # the robot's base
    contacts = palpate.estimate("log.csv", "rig.toml", frame="base")
    contact.in_frame(palpate.Pose.from_matrix(T_base_surface))

What is refused raises `palpate.PalpateError`, with a sentence that says what to write.
"""

from difflib import get_close_matches as _near
from importlib import import_module as _import
from typing import TYPE_CHECKING as _CHECKING

if _CHECKING:
    from palpate.calibration.mounting import Mounting, identify_mounting
    from palpate.contact import Candidates, ContactEstimate, Contacts, Locator, Status, WrenchEstimator
    from palpate.contact.locate import locate
    from palpate.control.align import AlignController
    from palpate.control.drive import DifferentialDrive
    from palpate.control.touch_navigator import TouchNavigator
    from palpate.errors import GeometryError, InputError, NotIdentifiable, PalpateError
    from palpate.live.live import open_live
    from palpate.sensors.force_torque import Compensation, ForceTorque
    from palpate.sensors.force_torque.calibrate import identify_payload
    from palpate.sensors.force_torque.calibrate_imu import identify_payload_with_imu
    from palpate.sensors.load_cells import LoadCellArray, LoadCells
    from palpate.sensors.load_cells.calibrate import identify_load_cells
    from palpate.sensors.marker_ring import MarkerRing, RingEstimator
    from palpate.sensors.taxels import TaxelBody, TaxelEstimator
    from palpate.sensors.taxels.skin_map import Sheet, map_skin
    from palpate.setup import load_rig
    from palpate.setup.estimate import estimate
    from palpate.setup.pipeline import open_log
    from palpate.signals import Butterworth, Kalman, Payload, Recording
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
    "identify_payload_with_imu",
    "load_rig",
    "locate",
    "map_skin",
    "open_live",
    "open_log",
    "plane",
]

_NAMES = {
    "palpate.calibration.mounting": "Mounting identify_mounting",
    "palpate.contact": "Candidates ContactEstimate Contacts Locator Status WrenchEstimator",
    "palpate.contact.locate": "locate",
    "palpate.control.align": "AlignController",
    "palpate.control.drive": "DifferentialDrive",
    "palpate.control.touch_navigator": "TouchNavigator",
    "palpate.errors": "GeometryError InputError NotIdentifiable PalpateError",
    "palpate.live.live": "open_live",
    "palpate.sensors.force_torque": "Compensation ForceTorque",
    "palpate.sensors.force_torque.calibrate": "identify_payload",
    "palpate.sensors.force_torque.calibrate_imu": "identify_payload_with_imu",
    "palpate.sensors.load_cells": "LoadCellArray LoadCells",
    "palpate.sensors.load_cells.calibrate": "identify_load_cells",
    "palpate.sensors.marker_ring": "MarkerRing RingEstimator",
    "palpate.sensors.taxels": "TaxelBody TaxelEstimator",
    "palpate.sensors.taxels.skin_map": "Sheet map_skin",
    "palpate.setup": "load_rig",
    "palpate.setup.estimate": "estimate",
    "palpate.setup.pipeline": "open_log",
    "palpate.signals": "Butterworth Kalman Payload Recording",
    "palpate.spatial.pose": "Pose",
    "palpate.spatial.wrench": "Wrench",
    "palpate.surfaces": "Mesh Surface plane",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
_ROOMS = ("calibration", "contact", "errors", "sensors", "signals", "spatial", "surfaces")
_ELSEWHERE = {  # what else one looks for at the front door
    "Rig": 'palpate.load_rig("rig.toml")',
    "live": 'palpate.open_live("rig.toml")',
    "load": 'palpate.load_rig("rig.toml"), or palpate.Contacts.load("contacts.mcap")',
    "load_log": 'palpate.estimate("log.csv", "rig.toml")',
    "load_mesh": 'palpate.Mesh.load("probe.stl", unit="mm")',
    "plot": "contacts.plot(mesh)",
    "show": "contacts.plot(mesh)",
    "read": 'palpate.estimate("log.csv", "rig.toml")',
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first requested: a program that needs little of Palpate starts quickly."""
    if name in _HOME:
        value: object = getattr(_import(_HOME[name]), name)
    elif name in _ROOMS:
        value = _import(f"palpate.{name}")
    else:
        hint = "" if name.startswith("_") else _hint(name)
        raise AttributeError(f"module 'palpate' has no attribute {name!r}{hint}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)


def _hint(name: str) -> str:
    """Return a hint with the line to write for a name defined elsewhere, or nearly spelt so; "" if there is none."""
    rooms = (room for room in _ROOMS if hasattr(_import(f"palpate.{room}"), name))
    near = [*(f"{room}.{name}" for room in rooms), *_near(name, __all__, 1)]
    line = _ELSEWHERE.get(name) or "".join(f"palpate.{each}" for each in near[:1])
    return f". Write {line}" if line else ""
