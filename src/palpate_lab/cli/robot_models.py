"""Write the models and the rig of a simulated robot: what its owner knows of the sensors, with the stated errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.contact.ground_truth import TrueSamples
from palpate.files.models import write_model
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.taxels.calibrate_response import identify_response
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.response import TaxelResponse
from palpate.signals.payload import Payload
from palpate.signals.recording import CELLS, Recording
from palpate_lab.simulation.robot.files import JOINTS, topic_of
from palpate_lab.simulation.robot.motion import QUIET
from palpate_lab.simulation.robot.run import TIP_NOISE
from palpate_lab.simulation.robot.sensors import CellTip, LabRobot, PadPatch, Sensor, SheetPatch, WristSensor
from palpate_lab.simulation.robot.tree import GRAVITY, RobotLink
from palpate_lab.simulation.three_axis_skins import ThreeAxisSkin
from palpate_lab.simulation.three_axis_touches import RATE, three_axis_touches
from palpate_lab.simulation.touched.files import intensity_model

PLACED = 3e-5  # m: standard deviation along each axis of the places of taxels
_PRESSES = 120  # of the pad that is calibrated
_WEIGHT, _CENTRE, _BIAS = 0.01, 2e-4, (5e-3, 2e-4)  # N; m; N, N m: standard deviations of a payload
_MATRIX, _LENGTH = 5e-4, 0.01  # of the forward model of load cells, and the arm [m] at which torques err as forces
_TURNING = 1.5e-4  # V: of the bias of a cell as the weight of its tip turns, 6 mN over four cells
_INTENSITY = "sheets.toml"
_TARE = QUIET - 0.5
_RIG = """# A simulated robot: what its sensors are, and where. What touched it is in truth.csv alone.
[robot]
urdf = "robot.urdf"
joints = "{joints}"
base = "{base}"
gravity = "fixed"                    # the base stands upright
{encoder}"""
_SHEET = """
[sensors.{name}]
kind = "skin"
link = "{link}"
map = "{name}.toml"
intensity = "{intensity}"
rows = {rows}
columns = {columns}
bits = 8
topic = "{topic}"
tare = {tare}                           # s: the log starts so long untouched
contacts = {{ unequal = 0.02 }}        # share by which a cell's gain may be off from its curve
"""
_PAD = """
[sensors.{name}]
kind = "skin"
link = "{link}"
taxels = "{name}.toml"
response = "{name}_response.toml"
axes = ["x", "y", "z"]
cells = "values"                     # of the messages
topic = "{topic}"
tare = {tare}
"""
_TIP = """
[sensors.{name}]
kind = "load_cells"
link = "{link}"
model = "{name}.toml"
topic = "{topic}"
estimate = {{ tare = {tare}, contact = {{ on = 0.3, off = 0.15 }} }}   # N: more than the weight of the tip
"""
_WRIST = """
[sensors.{name}]
kind = "force_torque"
link = "{link}"                # the frame in which it reports
surface = {{ link = "{surface}" }}
topic = "{topic}"
noise = {{ force = {force}, torque = {torque} }}   # N, N m: one standard deviation of one reading
payload = "{name}.toml"
filter = {{ kind = "butterworth", cutoff = 15, order = 2 }}
estimate = {{ method = "soft_finger", friction = 1.0, contact = {{ on = 0.5, off = 0.3 }} }}
"""


def write_robot_models(robot: LabRobot, rng: np.random.Generator, folder: Path) -> None:
    """Write a model file for each sensor: those of pads are calibrated, all others are true but for the stated errors.

    A pad's response is that of one calibrated pad, by the gains of both, which their maker knows.
    """
    if any(isinstance(each, SheetPatch) for each in robot.sensors):
        write_model(folder / _INTENSITY, intensity_model())
    pads = [each for each in robot.sensors if isinstance(each, PadPatch)]
    response = _calibrated(robot.pillars, rng) if pads else None
    for sensor in robot.sensors:
        write_model(folder / f"{sensor.name}.toml", _model(sensor, robot.links, rng))
        if isinstance(sensor, PadPatch) and response is not None:
            own = _response(sensor, response, robot.pillars)
            write_model(folder / f"{sensor.name}_response.toml", own)


def write_robot_rig(robot: LabRobot, folder: Path, encoder: float) -> None:
    """Write robot.toml; `encoder` [degrees] is the standard deviation of a joint's error."""
    stated = f"encoder = {encoder:.6g}                        # degrees: of each joint's position\n" if encoder else ""
    parts = [_RIG.format(joints=JOINTS, base=robot.base, encoder=stated), *(_table(each) for each in robot.sensors)]
    (folder / "robot.toml").write_text("".join(parts), encoding="utf-8")


def _table(sensor: Sensor) -> str:
    common = {"name": sensor.name, "link": sensor.link, "topic": topic_of(sensor), "tare": _TARE}
    if isinstance(sensor, SheetPatch):
        size = {"rows": sensor.sheet.rows, "columns": sensor.sheet.columns}
        return _SHEET.format(**common, **size, intensity=_INTENSITY)
    if isinstance(sensor, WristSensor):
        return _WRIST.format(**common, surface=sensor.surface, force=sensor.noise[0], torque=sensor.noise[1])
    return (_PAD if isinstance(sensor, PadPatch) else _TIP).format(**common)


def _model(sensor: Sensor, links: tuple[RobotLink, ...], rng: np.random.Generator) -> object:
    if isinstance(sensor, SheetPatch):
        return _map(sensor, rng)
    if isinstance(sensor, PadPatch):
        return _places(sensor, rng)
    return _cells(sensor, rng) if isinstance(sensor, CellTip) else _payload(sensor, links, rng)


def _map(sensor: SheetPatch, rng: np.random.Generator) -> object:
    flat = sensor.sheet.layout()
    centres = sensor.pose.apply(flat.centres) + PLACED * rng.standard_normal(flat.centres.shape)
    return replace(flat, centres=centres, normals=sensor.pose.rotate(flat.normals), uv=np.zeros((*flat.areas.shape, 2)))


def _places(sensor: PadPatch, rng: np.random.Generator) -> TaxelPlaces:
    positions, count = sensor.pose.apply(sensor.skin.positions), len(sensor.skin.positions)
    return TaxelPlaces(
        positions + PLACED * rng.standard_normal(positions.shape),
        sensor.pose.rotate(sensor.skin.normals),
        np.tile(PLACED**2 * np.eye(3), (count, 1, 1)),
    )


def _calibrated(skin: ThreeAxisSkin, rng: np.random.Generator) -> TaxelResponse:
    """Return the response of a pad, from presses with known forces on a bench, in the pad's frame."""
    loads = three_axis_touches(skin.positions, rng, _PRESSES)
    readings, truth = skin.readings(loads, int(rng.integers(1 << 30)))
    body = TaxelBody.anywhere(skin.positions, skin.normals, along=(1.0, 0.0, 0.0))
    known = TrueSamples(truth.frame / RATE, truth.place, None, truth.force)
    return identify_response(body, Recording(np.arange(len(readings)) / RATE, {CELLS: readings}), known)


def _response(sensor: PadPatch, response: TaxelResponse, calibrated: ThreeAxisSkin) -> TaxelResponse:
    """Return a pad's response in its link's frame: by its own gains, and along the tangents that its body has there."""
    normals = sensor.pose.rotate(sensor.skin.normals)
    body = TaxelBody.anywhere(sensor.pose.apply(sensor.skin.positions), normals, along=(1.0, 0.0, 0.0))
    axes = np.stack([body.tangents, np.cross(normals, body.tangents), -normals], axis=1)
    turned = axes @ sensor.pose.rotation @ np.diag([1.0, 1.0, -1.0])
    gains = turned @ response.gains @ calibrated.gains @ np.linalg.inv(sensor.skin.gains)
    return replace(response, gains=gains)


def _cells(sensor: CellTip, rng: np.random.Generator) -> LoadCells:
    units = np.repeat([1.0, _LENGTH], 3)
    deviation = _MATRIX * units[:, None] / units
    error = np.eye(6) + deviation * rng.standard_normal((6, 6))
    noise = np.full(3 * sensor.cells.count, sensor.cells.voltage_noise(TIP_NOISE, array=False))
    return LoadCells(
        sensor.cells.forward() @ np.linalg.inv(error),
        noise,
        covariance=np.diag(deviation.ravel() ** 2),
        positions=sensor.cells.position,
        drift=_TURNING / float(noise[0]),
    )


def _payload(sensor: WristSensor, links: tuple[RobotLink, ...], rng: np.random.Generator) -> Payload:
    """Return the payload of a wrist: of the one link that it carries."""
    carried = next(each for each in links if each.name == sensor.surface)
    centre, weight = carried.origin().apply(np.array(carried.centre)), np.array([0.0, 0.0, -GRAVITY * carried.mass])
    deviation = np.repeat([_WEIGHT, _BIAS[0], _CENTRE, _BIAS[1]], 3)
    off: Float[np.ndarray, "4 3"] = (deviation * rng.standard_normal(12)).reshape(4, 3)
    return Payload(
        weight + off[0],
        sensor.bias[:3] + off[1],
        centre + off[2],
        sensor.bias[3:] + off[3],
        np.diag(deviation**2),
        GRAVITY,
    )
