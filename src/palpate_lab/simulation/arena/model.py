"""Build the arena as a MuJoCo model: which geoms collide, and how stiff a contact is."""

from __future__ import annotations

from math import hypot, log, sqrt
from typing import Any

from palpate_lab.simulation.arena.layout import GRAVITY, ArenaLayout, Block
from palpate_lab.simulation.arena.settings import FRAME, RobotSettings
from palpate_lab.simulation.engine import words

SUBSTEPS = 16  # of the physics, a frame
_HEIGHT = 4.0  # of boxes, in radii of a robot
_GIVE = 0.15  # MuJoCo's d of the skin: a contact has inertia d / (1 - d) of the bodies', which a skin has not
_SKIN = 'contype="1" conaffinity="1"'  # robots; what they touch says conaffinity 1
_STICK = 'solreffriction="0.005 1" solimpfriction="0.999 0.999 0.001 0.5 2"'  # friction that creeps by next to nothing
_EIGHT = 1.0 + sqrt(2.0)  # grip along a direction over the grip of each of the four
_FOOT = '''type="sphere" size="0.01" mass="0" contype="4" conaffinity="0" condim="4" priority="1"
    solref="0.02 1" solimp="0.7 0.7 0.001 0.5 2"'''


def mjcf(layout: ArenaLayout, robot: RobotSettings) -> str:
    """Return the model as MJCF text; robots are planar, their skin is a sphere with one point of contact per obstacle.

    Each body has its joints at the origin and without turn, so that qpos are poses in the arena's frame: a turn of the
    body itself would turn its slides too.
    """
    fixed, high = (block for block in layout.blocks if block.mass is None), _HEIGHT * robot.radius
    return f"""
<mujoco model="arena">
  <compiler angle="radian"/>
  <option timestep="{FRAME / SUBSTEPS!r}" cone="elliptic" impratio="100" solver="Newton"
    tolerance="1e-9" iterations="30" gravity="0 0 {-GRAVITY!r}"><flag sleep="enable" midphase="disable"/></option>
  <default>
    <joint {_STICK}/>
    <geom type="box" friction="{robot.friction!r} 0 0" condim="3" solimp="{words((_GIVE, _GIVE, 1e-3, 0.5, 2.0))}"/>
    <default class="hard">
      <geom priority="1" solref="0.006 1" solimp="0.95 0.95 0.001 0.5 2" friction="0.3 0 0"/>
    </default>
    <default class="foot"><geom {_FOOT}/></default>
  </default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="0" conaffinity="4"/>
    {_border(layout.size)}{"".join(_wall(block, high) for block in fixed)}
    {"".join(_robot(k, robot) for k in range(layout.robots))}
    {"".join(_movable(k, block, high) for k, block in enumerate(layout.movable))}
  </worldbody>
  <tendon>{"".join(_diagonal(k, robot) for k in range(layout.robots))}</tendon>
</mujoco>"""


def soften(model: Any, layout: ArenaLayout, robot: RobotSettings) -> None:
    """Set the stiffness of the skin in a model, in N/m: change `geom_solref` of robots and movable blocks.

    With solref = (-s, -b) and a constant d MuJoCo's contact bears s r / ((1 - d) w) where it is r deep, with w the sum
    of both bodies' inverse weights. A robot's s suits a wall, and another robot, which doubles w and so halves the
    stiffness as two springs in series do; a movable block has a larger s, and of two the larger one counts.
    """
    own = float(model.body_invweight0[model.body("robot0").id, 0])

    def give(geom: str, weight: float) -> None:
        stiffness = robot.stiffness * (1.0 - _GIVE) * weight
        model.geom_solref[model.geom(geom).id] = -stiffness, -stiffness * robot.loss

    for k in range(layout.robots):
        give(f"skin{k}", own)
    for k in range(len(layout.movable)):
        give(f"block{k}", own + float(model.body_invweight0[model.body(f"block{k}").id, 0]))


def _wall(block: Block, high: float) -> str:
    a, b = block.half
    place = f'pos="{words((block.x, block.y, high / 2))}" euler="0 0 {block.turn!r}"'
    return f'<geom {place} size="{words((a, b, high / 2))}" contype="0" conaffinity="3"/>'


def _border(size: tuple[float, float]) -> str:
    """Return the four walls around the field as half spaces: every box lies near those, and boxes are slower."""
    width, height = size
    sides = ((0.0, 0.0, "1 0 0"), (width, 0.0, "-1 0 0"), (0.0, 0.0, "0 1 0"), (0.0, height, "0 -1 0"))
    return "".join(
        f'<geom type="plane" size="0 0 1" pos="{words((x, y, 0.0))}" zaxis="{into}" contype="0" conaffinity="3"/>'
        for x, y, into in sides
    )


def _robot(k: int, robot: RobotSettings) -> str:
    """Return a robot: its skin on a carrier that follows the tracks' commands exactly, so heavy that nothing stops it.

    Coulomb's friction between the two is the tracks' grip.
    """
    grip = robot.grip * robot.mass * GRAVITY
    turning = words([0.5 * robot.mass * robot.radius**2] * 3)
    return f"""
    <body pos="0 0 {robot.radius!r}" sleep="never">
      {_joints("xy")}
      <inertial pos="0 0 0" mass="1e4" diaginertia="1e3 1e3 1e3"/>
      <body name="robot{k}">
        {_joints("xy", grip / _EIGHT, 0.5 * robot.track * grip, f"grip{k}")}
        <inertial pos="0 0 0" mass="{robot.mass!r}" diaginertia="{turning}"/>
        <geom name="skin{k}" type="sphere" size="{robot.radius!r}" {_SKIN}/>
      </body>
    </body>"""


def _movable(k: int, block: Block, high: float) -> str:
    """Return a movable block: a shell that robots and, harder, other blocks touch, and a foot with all of the mass.

    Only the foot moves up and down, and it gives: a body that slides on MuJoCo's cone of friction is lifted a little,
    and would hop on a hard one. The shell stays at its height, so that friction of a skin bears none of the weight.
    """
    assert block.mass is not None
    a, b = block.half
    size = f'size="{words((a, b, high / 2))}"'
    turning = block.mass * (a * a + b * b) / 3
    return f"""
    <body name="block{k}" pos="0 0 {high / 2}">
      {_joints("xy")}
      <inertial pos="0 0 0" mass="1e-5" diaginertia="1e-8 1e-8 1e-8"/>
      <geom name="block{k}" {size} contype="0" conaffinity="1"/>
      <geom {size} contype="2" conaffinity="2" class="hard"/>
      <body pos="0 0 {-high / 2}">
        <joint type="slide" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="{block.mass!r}" diaginertia="{words([turning] * 3)}"/>
        <geom class="foot" pos="0 0 0.01" friction="{block.friction!r} {block.friction * _mean_distance(a, b)!r} 0"/>
      </body>
    </body>"""


def _diagonal(k: int, robot: RobotSettings) -> str:
    """Return friction at 45 degrees, in addition to that along and across.

    The four make an octagon about Coulomb's circle, at most 8 % too far out. Two alone would be a square, up to 41 %
    too strong between them.
    """
    force = robot.grip * robot.mass * GRAVITY / _EIGHT
    return "".join(
        f"""
    <fixed frictionloss="{force!r}" {_STICK}>
      <joint joint="grip{k}x" coef="{sqrt(0.5)!r}"/><joint joint="grip{k}y" coef="{side * sqrt(0.5)!r}"/>
    </fixed>"""
        for side in (-1.0, 1.0)
    )


def _joints(slides: str, force: float = 0.0, moment: float = 0.0, name: str = "") -> str:
    """Return slides, then a hinge about z, with friction."""
    axes, named = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}, name and 'name="' + name + '{}"'
    rows = [f'<joint {named.format(a)} type="slide" axis="{axes[a]}" frictionloss="{force!r}"/>' for a in slides]
    return "".join(rows) + f'<joint type="hinge" axis="0 0 1" frictionloss="{moment!r}"/>'


def _mean_distance(a: float, b: float) -> float:
    """Return the mean distance [m] of the points of a rectangle with half sides a and b from its middle.

    A box that rests evenly on the floor turns where the moment is friction weight times this.
    """
    d = hypot(a, b)
    return (d + a * a / (2 * b) * log((b + d) / a) + b * b / (2 * a) * log((a + d) / b)) / 3
