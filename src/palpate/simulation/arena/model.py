"""The arena as MuJoCo takes it: what collides with what, and how stiff a contact is."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot, log
from typing import Any

from palpate.simulation.arena.layout import GRAVITY, Block, Layout
from palpate.simulation.arena.settings import FRAME, RobotSettings

__all__ = ["SUBSTEPS", "mjcf", "soften"]

SUBSTEPS = 16  # of the physics, a frame
_HEIGHT = 0.12  # m of boxes
_GIVE = 0.15  # MuJoCo's d of the skin: a contact has inertia d / (1 - d) of the bodies', which a skin has not
_SKIN = 'contype="1" conaffinity="1"'  # robots; what they touch says conaffinity 1
_FOOT = '''type="sphere" size="0.01" mass="0" contype="4" conaffinity="0" condim="4" priority="1"
    solref="0.02 1" solimp="0.8 0.8 0.001 0.5 2"'''


def mjcf(layout: Layout, robot: RobotSettings) -> str:
    """The model. Robots are planar and carry their skin as a sphere: one contact with a flat side, a corner, another.

    Each body has its joints at the origin and without turn, so that qpos are poses in the arena's frame: a body's own
    turn would turn its slides too.
    """
    fixed = (block for block in layout.blocks if block.mass is None)
    movable = enumerate(layout.movable)
    return f"""
<mujoco model="arena">
  <compiler angle="radian"/>
  <option timestep="{FRAME / SUBSTEPS!r}" integrator="implicitfast" cone="elliptic" impratio="100" solver="Newton"
    tolerance="1e-9" iterations="30" gravity="0 0 {-GRAVITY!r}"><flag sleep="enable" midphase="disable"/></option>
  <default>
    <geom type="box" friction="{robot.friction!r} 0 0" condim="3" solimp="{_words((_GIVE, _GIVE, 1e-3, 0.5, 2.0))}"/>
    <default class="hard"><geom solref="0.006 1" solimp="0.95 0.95 0.001 0.5 2" friction="0.3 0 0"/></default>
    <default class="foot"><geom {_FOOT}/></default>
  </default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="0" conaffinity="4"/>
    {_border(layout.size)}{"".join(_wall(block) for block in fixed)}
    {"".join(_robot(k, robot) for k in range(layout.robots))}
    {"".join(_movable(k, block) for k, block in movable)}
  </worldbody>
  <actuator>{"".join(_tracks(k, robot) for k in range(layout.robots))}</actuator>
</mujoco>"""


def soften(model: Any, layout: Layout, robot: RobotSettings) -> None:
    """Gives the skin its stiffness in N/m.

    With solref = (-s, -b) and a constant d MuJoCo's contact bears s r / ((1 - d) w) where it is r deep, with w the sum
    of both bodies' inverse weights. A robot's own s suits a wall, and another robot, which doubles w and so halves the
    stiffness as two springs in series do; a movable block has a larger s, and of two the larger one holds.
    """
    own = float(model.body_invweight0[model.body("robot0").id, 0])

    def give(geom: str, weight: float) -> None:
        stiffness = robot.stiffness * (1.0 - _GIVE) * weight
        model.geom_solref[model.geom(geom).id] = -stiffness, -stiffness * robot.loss

    for k in range(layout.robots):
        give(f"skin{k}", own)
    for k in range(len(layout.movable)):
        give(f"block{k}", own + float(model.body_invweight0[model.body(f"block{k}").id, 0]))


def _wall(block: Block) -> str:
    a, b = block.half
    place = f'pos="{_words((block.x, block.y, _HEIGHT / 2))}" euler="0 0 {block.turn!r}"'
    return f'<geom {place} size="{_words((a, b, _HEIGHT / 2))}" contype="0" conaffinity="3"/>'


def _border(size: tuple[float, float]) -> str:
    """The four walls around the field, as half spaces: every box lies near those, and boxes take longer to try."""
    width, height = size
    sides = ((0.0, 0.0, "1 0 0"), (width, 0.0, "-1 0 0"), (0.0, 0.0, "0 1 0"), (0.0, height, "0 -1 0"))
    return "".join(
        f'<geom type="plane" size="0 0 1" pos="{_words((x, y, 0.0))}" zaxis="{into}" contype="0" conaffinity="3"/>'
        for x, y, into in sides
    )


def _robot(k: int, robot: RobotSettings) -> str:
    half = 0.5 * robot.track
    return f"""
    <body name="robot{k}" pos="0 0 {robot.radius!r}">
      {_joints(f"robot{k}", "xy")}
      <inertial pos="0 0 0" mass="{robot.mass!r}" diaginertia="{_words([0.5 * robot.mass * robot.radius**2] * 3)}"/>
      <geom name="skin{k}" type="sphere" size="{robot.radius!r}" {_SKIN}/>
      <site name="left{k}" pos="0 {half!r} 0"/><site name="right{k}" pos="0 {-half!r} 0"/><site name="middle{k}"/>
    </body>"""


def _movable(k: int, block: Block) -> str:
    """A box that robots touch, and other blocks harder; its weight stands on a foot in the middle.

    The foot gives: what slides on MuJoCo's cone of friction is lifted a little, and would hop on a hard one. As it is,
    a box that robots push takes friction weight to 1 %, and one pushed with 9/10 of that creeps by 0.07 mm/s.
    """
    assert block.mass is not None
    a, b = block.half
    size = f'size="{_words((a, b, _HEIGHT / 2))}"'
    twist = block.friction * _mean_distance(a, b)
    return f"""
    <body name="block{k}" pos="0 0 {_HEIGHT / 2}">
      {_joints(f"block{k}", "xyz")}
      <geom name="block{k}" {size} mass="{block.mass!r}" contype="0" conaffinity="1"/>
      <geom {size} mass="0" contype="2" conaffinity="2" class="hard"/>
      <geom class="foot" pos="0 0 {0.01 - _HEIGHT / 2}" friction="{block.friction!r} {twist!r} 0"/>
    </body>"""


def _joints(name: str, slides: str) -> str:
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    rows = [f'<joint type="slide" axis="{axes[a]}"/>' for a in slides]
    return "".join(rows) + f'<joint name="{name}" type="hinge" axis="0 0 1"/>'


def _tracks(k: int, robot: RobotSettings) -> str:
    """A track pulls itself to its speed with what grip it has; sideways it holds with as much."""
    grip = robot.grip * robot.mass * GRAVITY
    servo = f'gainprm="{robot.servo!r}" biastype="affine" biasprm="0 0 {-robot.servo!r}"'

    def pull(site: str, gear: str, most: float) -> str:
        return f'<general site="{site}{k}" gear="{gear} 0 0 0" {servo} forcerange="{-most!r} {most!r}"/>'

    return pull("left", "1 0 0", grip / 2) + pull("right", "1 0 0", grip / 2) + pull("middle", "0 1 0", grip)


def _mean_distance(a: float, b: float) -> float:
    """Of the points of a rectangle with half sides a and b from its middle [m].

    A box that rests evenly on the floor turns where the moment is friction weight times this.
    """
    d = hypot(a, b)
    return (d + a * a / (2 * b) * log((b + d) / a) + b * b / (2 * a) * log((a + d) / b)) / 3


def _words(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
