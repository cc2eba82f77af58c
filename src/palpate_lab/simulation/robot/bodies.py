"""Two robots: a hand with five fingertips, and a humanoid's torso with two arms and twelve patches of skin."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from palpate.spatial.pose import Pose, skew
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from palpate_lab.simulation.robot.sensors import (
    BareFace,
    CellTip,
    LabRobot,
    PadPatch,
    SheetPatch,
    TouchRegion,
    WristSensor,
    facing,
)
from palpate_lab.simulation.robot.tree import RobotLink, SolidShape, Three
from palpate_lab.simulation.shapes import EllipsoidBody
from palpate_lab.simulation.skin_bench import Rolled
from palpate_lab.simulation.three_axis_skins import COUNTS_PER_NEWTON, ThreeAxisSkin, pillar_array

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_PITCH, _ROUND = 8e-3, 28  # m between cells of a sheet, and cells round an arm
ARM = _ROUND * _PITCH / (2 * pi)  # m: radius of an arm, which a sheet closes round
TORSO = 0.12  # m
_ROWS, _COLUMNS = 6, 4  # of a pad
_SPREAD, _TILT = 0.05, 0.035  # of a pad's gains, and of their axes [rad]
TIP = (0.011, 0.016, 0.009)  # m: half-lengths of a fingertip on load cells
_BOX = (0.010, 0.014, 0.007)  # m: of a fingertip with a pad
_BIAS = (3.0, 0.05)  # N, N m: standard deviation of a wrist's bias
_FINGERS: tuple[tuple[str, Three, Three, int], ...] = (  # place [m], turn [rad] and number of joints
    ("thumb", (0.044, 0.02, 0.004), (0.3, 0.9, -0.8), 3),
    ("index", (0.030, 0.092, 0.0), (0.0, 0.0, -0.06), 3),
    ("middle", (0.010, 0.092, 0.0), (0.0, 0.0, -0.02), 3),
    ("ring", (-0.010, 0.092, 0.0), (0.0, 0.0, 0.02), 3),
    ("little", (-0.030, 0.092, 0.0), (0.0, 0.0, 0.06), 2),
)
_LENGTHS, _THICK = (0.042, 0.027, 0.022), 0.007  # m: of bones, and their radius


def hand(rng: np.random.Generator) -> LabRobot:
    """Draw a hand: thumb, index and middle finger end in tips on load cells, ring and little finger in pads."""
    pillars = pillar_array(_ROWS, _COLUMNS, int(rng.integers(1 << 30)))
    palm = SolidShape("box", (0.042, 0.045, 0.014), (0.0, 0.045, 0.0))
    links, sensors = [RobotLink("palm", shapes=(palm,), mass=0.4)], list[CellTip | PadPatch]()
    for name, at, turn, joints in _FINGERS:
        box = name in ("ring", "little")
        links += _finger(name, at, turn, joints, spreads=not box, follows=name == "ring", box=box)
        if box:
            sensors.append(PadPatch(name, f"{name}_tip", facing((0.0, 0.0, _BOX[2]), _Z, _X), _unit(pillars, rng)))
        else:
            sensors.append(CellTip(name, f"{name}_tip", EllipsoidBody(TIP), random_cells(LAYOUTS[4], rng)))
    regions = tuple(TouchRegion((each,)) for each in sensors)
    return LabRobot("hand", "palm", tuple(links), tuple(sensors), regions, pillars, grasps=True)


def humanoid(rng: np.random.Generator) -> LabRobot:
    """Draw a torso with two arms of seven joints: six sheets, six pads, and a force/torque sensor at each wrist."""
    pillars = pillar_array(_ROWS, _COLUMNS, int(rng.integers(1 << 30)))
    chest = [SolidShape("box", (0.0125, 0.022, 0.026), (0.1125, y, 0.38)) for y in (0.05, -0.05)]
    torso = RobotLink("torso", shapes=(SolidShape("cylinder", (TORSO, 0.24), (0.0, 0.0, 0.25)), *chest), mass=12.0)
    pads = [
        PadPatch(f"{side}_chest", "torso", facing((0.125, y, 0.38), _X, _Y), _unit(pillars, rng))
        for side, y in (("left", 0.05), ("right", -0.05))
    ]
    sheet = Rolled(rows=10, columns=14, pitch=_PITCH, radius=TORSO)
    half = (sheet.columns - 1) / 2 * sheet.pitch / sheet.radius
    turned = {"belly": -half, "back": pi - half}
    axes = {name: Pose.from_rotation_vector([0.0, 0.0, turn], [0.0, 0.0, 0.18]) for name, turn in turned.items()}
    sheets = [SheetPatch(name, "torso", axis, sheet) for name, axis in axes.items()]
    neck = SolidShape("cylinder", (0.035, 0.04), (0.0, 0.0, -0.09))
    head = RobotLink("head", "torso", (0.0, 0.0, 0.61), looks=(*_ball(0.085), neck))
    links, sensors = [torso, head], [*sheets, *pads]
    regions = [TouchRegion((each,)) for each in sensors]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm, felt, touched = _arm(side, sign, pillars, rng)
        links, sensors, regions = links + arm, sensors + felt, regions + touched
    return LabRobot("humanoid", "torso", tuple(links), tuple(sensors), tuple(regions), pillars)


def _finger(
    name: str, at: Three, rpy: Three, joints: int, *, spreads: bool = True, follows: bool = False, box: bool = False
) -> list[RobotLink]:
    """Return a finger along y that bends about x towards z, with its tip: an ellipsoid or a box.

    Its links but the tip have z along the finger, so that bones are cylinders along z. The first joint spreads the
    finger, or bends it; the last may follow the one before.
    """
    links, parent, origin, turn = list[RobotLink](), "palm", at, _raised(rpy)
    for k, length in enumerate(_LENGTHS[:joints]):
        spread, last = spreads and k == 0, f"{name}_{k - 1}" if follows and k == joints - 1 else ""
        axis, middle, span = (_Y, 0.0, 0.3) if spread else (_X, 0.55, 0.5)
        bone = SolidShape("cylinder", (_THICK, length / 2 - _THICK), (0.0, 0.0, length / 2))
        mimic = (last, 0.8) if last else None
        knuckle = SolidShape("sphere", (_THICK,))
        links.append(
            RobotLink(f"{name}_{k}", parent, origin, turn, axis, middle, span, mimic, (bone,), 0.03, (knuckle,))
        )
        parent, origin, turn = f"{name}_{k}", (0.0, 0.0, length), (0.0, 0.0, 0.0)
    shape, mass = (SolidShape("box", _BOX), 0.012) if box else (SolidShape("ellipsoid", TIP), 0.003)
    end = (0.0, 0.0, _LENGTHS[joints - 1] + shape.size[1] - 0.006)
    flat = (pi / 2, 0.0, 0.0)  # y along the finger again, and z out of its pad
    return [*links, RobotLink(f"{name}_tip", parent, end, flat, shapes=(shape,), mass=mass)]


def _raised(rpy: Three) -> Three:
    """Return angles about fixed axes that also turn z into y."""
    from scipy.spatial.transform import Rotation

    x, y, z = (Rotation.from_euler("xyz", rpy) * Rotation.from_euler("x", -pi / 2)).as_euler("xyz").tolist()
    return x, y, z


def _arm(
    side: str, sign: float, pillars: ThreeAxisSkin, rng: np.random.Generator
) -> tuple[list[RobotLink], list[SheetPatch | PadPatch | WristSensor], list[TouchRegion]]:
    """Return an arm: its links, its sensors, and where it is touched."""
    p, axis = side[0], Pose.from_rotation_vector([0.0, 0.0, 0.3 * sign], [0.0, 0.0, -0.14])
    sheets = [
        SheetPatch(f"{side}_{name}", f"{p}_{name}", axis, Rolled(rows, _ROUND, _PITCH, ARM))
        for name, rows in (("upper_arm", 12), ("forearm", 14))
    ]
    pads, faces = list[PadPatch](), list[BareFace]()
    for name, y in (("palm", -0.016 * sign), ("hand_back", 0.016 * sign)):
        out = (0.0, float(np.sign(y)), 0.0)
        pads.append(PadPatch(f"{side}_{name}", f"{p}_hand", facing((0.01, y, -0.11), out, _Z), _unit(pillars, rng)))
        faces.append(BareFace(f"{p}_hand", facing((0.0, y, -0.05), out, _Z), (0.025, 0.035)))
    bias = np.repeat(_BIAS, 3) * rng.standard_normal(6)
    wrist = WristSensor(f"{side}_wrist", f"{p}_wrist_ft", f"{p}_hand", bias)
    regions = [*(TouchRegion((each,)) for each in sheets), TouchRegion((*pads, *faces), wrist.name)]
    return _arm_links(p, sign), [*sheets, *pads, wrist], regions


def _arm_links(p: str, sign: float) -> list[RobotLink]:
    """Return the links of an arm that hangs along -z, their names beginning with a letter; sign: 1 left, -1 right."""
    upper, lower = (SolidShape("cylinder", (ARM, half), (0.0, 0.0, -0.14)) for half in (0.085, 0.09))
    palm, down = SolidShape("box", (0.045, 0.016, 0.075), (0.0, 0.0, -0.09)), (0.0, 0.0, -0.27)
    return [
        RobotLink(
            f"{p}_shoulder", "torso", (0.0, 0.17 * sign, 0.43), (0.2 * sign, 0.0, 0.0), _Y, mass=0.5, looks=_ball(0.055)
        ),
        RobotLink(f"{p}_shoulder_side", f"{p}_shoulder", axis=_X, middle=0.7 * sign, span=0.5, mass=0.5),
        RobotLink(f"{p}_upper_arm", f"{p}_shoulder_side", axis=_Z, shapes=(upper,), mass=1.6),
        RobotLink(f"{p}_elbow", f"{p}_upper_arm", down, axis=_Y, middle=-0.9, span=0.8, mass=0.3, looks=_ball(0.047)),
        RobotLink(f"{p}_forearm", f"{p}_elbow", axis=_Z, shapes=(lower,), mass=1.1),
        RobotLink(f"{p}_wrist", f"{p}_forearm", down, axis=_Y, span=0.7, mass=0.2, looks=_ball(0.042)),
        RobotLink(f"{p}_wrist_side", f"{p}_wrist", axis=_X, span=0.6, mass=0.2),
        # the hand's z points back to the arm, as that of all links; the sensor's points to the hand
        RobotLink(f"{p}_wrist_ft", f"{p}_wrist_side", (0.0, 0.0, -0.03), (pi, 0.0, 0.6 * sign)),
        RobotLink(f"{p}_hand", f"{p}_wrist_ft", (0.0, 0.0, 0.01), (pi, 0.0, 0.6 * sign), shapes=(palm,), mass=0.35),
    ]


def _ball(radius: float) -> tuple[SolidShape]:
    return (SolidShape("sphere", (radius,)),)


def _unit(pillars: ThreeAxisSkin, rng: np.random.Generator) -> ThreeAxisSkin:
    """Return another pad of the same mechanics, whose sensors' gains and axes differ."""
    count = len(pillars.gains)
    turned = np.eye(3) + skew(_TILT * rng.standard_normal((count, 3)))
    gains = COUNTS_PER_NEWTON * rng.uniform(1 - _SPREAD, 1 + _SPREAD, (count, 3, 1)) * turned
    return replace(pillars, gains=gains)
