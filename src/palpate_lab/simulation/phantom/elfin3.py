"""The six-axis arm of the probe paper, Han's Robot Elfin3: one table, from which its URDF and its MJCF are written.

The figures are those of `elfin3.urdf.xacro` and `joint_limits.yaml` of Han's Robot's elfin_description and
elfin3_moveit_config (BSD-3-Clause, Copyright Han's Robot Co., Ltd.), angles rounded as they are there. The table of
limits overrides the description's, as its first line says: 1.57 rad/s and 12.56 rad/s^2 for every joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.engine import words

if TYPE_CHECKING:
    from palpate_lab.simulation.phantom.probes import Probe

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class ArmLink:
    """A link, and the revolute joint about its own z that carries it.

    Attributes:
        name: name of the link.
        mass: mass [kg].
        centre: centre of mass [m], in the link's frame.
        inertia: xx, xy, xz, yy, yz, zz about the centre [kg m^2].
        origin, turn: the joint's origin [m] and roll, pitch, yaw [rad] in the previous link.
        limit: the joint turns from -limit to limit [rad].
        effort: largest torque [N m].
    """

    name: str
    mass: float
    centre: Triple
    inertia: tuple[float, float, float, float, float, float]
    origin: Triple
    turn: Triple
    limit: float
    effort: float


BASE_TURN = -1.5708 + pi / 2  # about z: the description turns its base back and forth, and rounds one of the two
BASE_MASS, BASE_CENTRE = 0.957790548974336, (-3.29424604565274e-17, -1.34268095035506e-13, 0.0281618442441758)
BASE_INERTIA = (0.00150277910425554, -5.07476794726385e-15, 6.74486887384113e-19, 0.00150277910426632,
                -6.77700047631768e-15, 0.00236857924691092)  # fmt: skip

LINKS = (
    ArmLink("elfin_link1", 1.76831994028414, (-9.91151833157951e-06, -0.00381802038981039, -0.0288793541460785),
         (0.00611258909183611, -9.83139510435094e-07, -4.14810998305304e-07, 0.00490858433987136,
          0.000238616259770754, 0.00347391582535924), (0.0, 0.0, 0.1925), (0.0, 0.0, 0.0), 3.14, 104.0),
    ArmLink("elfin_link2", 1.41431338277405, (-1.09591115591905e-05, 0.119133426891285, 0.104133324863746),
         (0.015779563515351, 2.57229005873321e-06, -1.33122516224454e-07, 0.00107744893104323,
          0.000788193806414118, 0.016037242338571), (0.0, 0.0, 0.0), (1.5708, 0.0, 0.0), 2.35, 104.0),
    ArmLink("elfin_link3", 1.24814802120785, (0.0250568861242891, 6.90447572674757e-06, -0.00212484357202786),
         (0.00198810458497945, -2.27641402661824e-07, -8.7904200299055e-05, 0.00344858240749365,
          -4.73997143171874e-07, 0.00270707588537784), (0.0, 0.266, 0.0), (3.1416, 0.0, 1.5708), 2.61, 69.0),
    ArmLink("elfin_link4", 1.11383740307423, (1.72360446946572e-06, -0.0572841318243815, 0.203781479974732),
         (0.00840848075882267, 1.16819985276106e-10, 3.20661375501498e-08, 0.0068932070989986,
          0.00249453758997878, 0.00249504881189781), (0.0, 0.0, 0.0), (1.5708, 0.0, 1.5708), 3.14, 69.0),
    ArmLink("elfin_link5", 0.932428626153683, (3.18971281487254e-07, -0.0247904768102997, -0.00288553868007254),
         (0.00225363150047226, 1.57057111903631e-08, 6.68352833152811e-08, 0.00123622421076959,
          7.71608214306329e-05, 0.00173913787162088), (0.0, 0.0, 0.324), (-1.5708, 0.0, 0.0), 2.56, 34.0),
    ArmLink("elfin_link6", 0.288820351990399, (1.4323826069585e-07, -0.00502093248893552, 0.129189718099031),
         (0.00021791903145322, 9.9472362909318e-10, 3.50877282174168e-11, 0.000175921298751184,
          1.17498406450176e-06, 0.000299410517394812), (0.0, 0.0, 0.0), (1.5708, 0.0, 0.0), 3.14, 34.0),
)  # fmt: skip

FLANGE = (0.0, 0.0, 0.155)  # in link 6; z out of the flange
SPEED, ACCELERATION = 1.57, 12.56  # of every joint [rad/s, rad/s^2]
SENSOR = "ft_sensor"
JOINTS = tuple(link.name.replace("link", "joint") for link in LINKS)
READY = (0.0, -0.3, 1.2, 0.0, 1.6, 0.0)  # [rad] the probe points down in front of the base, its x towards the base


def _matrix(turn: Triple) -> Float[np.ndarray, "3 3"]:
    """Return the rotation of roll about x, then pitch about y, then yaw about z, all fixed axes, as in URDF."""
    (a, b, c), (i, j, k) = [cos(angle) for angle in turn], [sin(angle) for angle in turn]
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, a, -i], [0.0, i, a]])
    about_y = np.array([[b, 0.0, j], [0.0, 1.0, 0.0], [-j, 0.0, b]])
    about_z = np.array([[c, -k, 0.0], [k, c, 0.0], [0.0, 0.0, 1.0]])
    return about_z @ about_y @ about_x


def _axes(turn: Triple) -> str:
    """Return the first two columns of the turn, as MJCF's xyaxes takes them."""
    return words(tuple(_matrix(turn)[:, :2].T.ravel().tolist()))


def _urdf_inertial(mass: float, centre: Triple, inertia: tuple[float, ...]) -> str:
    terms = zip(("xx", "xy", "xz", "yy", "yz", "zz"), inertia, strict=True)
    moments = " ".join(f'i{name}="{value!r}"' for name, value in terms)
    return f'<inertial><origin xyz="{words(centre)}"/><mass value="{mass!r}"/><inertia {moments}/></inertial>'


def _urdf_joint(name: str, kind: str, parent: str, child: str, place: tuple[Triple, Triple], inside: str = "") -> str:
    origin = f'<origin xyz="{words(place[0])}" rpy="{words(place[1])}"/>'
    return (
        f'  <joint name="{name}" type="{kind}">{origin}<parent link="{parent}"/><child link="{child}"/>{inside}</joint>'
    )


def _urdf_lines(probe: Probe, mesh: str) -> Iterator[str]:
    still = (0.0, 0.0, 0.0)
    yield '<robot name="elfin3">'
    yield '  <link name="base"/>'
    yield _urdf_joint("base_joint", "fixed", "base", "elfin_base", (still, (0.0, 0.0, BASE_TURN)))
    yield f'  <link name="elfin_base">{_urdf_inertial(BASE_MASS, BASE_CENTRE, BASE_INERTIA)}</link>'
    before = "elfin_base"
    for name, link in zip(JOINTS, LINKS, strict=True):
        yield f'  <link name="{link.name}">{_urdf_inertial(link.mass, link.centre, link.inertia)}</link>'
        limit = (
            f'<axis xyz="0 0 1"/><limit lower="{-link.limit!r}" upper="{link.limit!r}" effort="{link.effort!r}" '
            f'velocity="{SPEED!r}"/>'
        )
        yield _urdf_joint(name, "revolute", before, link.name, (link.origin, link.turn), limit)
        before = link.name
    yield _urdf_joint(f"{SENSOR}_joint", "fixed", before, SENSOR, (FLANGE, still))
    yield f'  <link name="{SENSOR}"/>'
    yield _urdf_joint("probe_joint", "fixed", SENSOR, "probe", (still, still))
    xx, yy, zz = probe.inertia
    body = _urdf_inertial(probe.mass, probe.centre, (xx, 0.0, 0.0, yy, 0.0, zz))
    yield f'  <link name="probe">{body}<visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>'
    yield "</robot>"


def urdf(probe: Probe, mesh: str = "probe.stl") -> str:
    """Return the URDF text of arm, sensor and probe.

    Its links are base (the root, z up), elfin_base, elfin_link1 ... 6, ft_sensor (z out of the flange) and probe (the
    same axes and origin).

    Args:
        probe: probe on the sensor.
        mesh: file name of its shape, in metres.
    """
    return "\n".join(_urdf_lines(probe, mesh)) + "\n"


def _capsule(begin: Triple, end: Triple, radius: float) -> str:
    return f'<geom type="capsule" fromto="{words(begin)} {words(end)}" size="{radius}" material="arm"/>'


_DRAWN = (  # of links 1 to 6, in their frames: from joint to joint
    ((0.0, 0.0, -0.10), (0.0, 0.0, 0.0), 0.048),
    ((0.0, 0.0, 0.0), (0.0, 0.266, 0.0), 0.040),
    ((0.0, 0.0, -0.02), (0.0, 0.0, 0.02), 0.042),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.324), 0.036),
    ((0.0, 0.0, -0.02), (0.0, 0.0, 0.02), 0.036),
    ((0.0, 0.0, 0.03), (0.0, 0.0, 0.13), 0.030),
)


def _mjcf_inertial(mass: float, centre: Triple, inertia: tuple[float, ...]) -> str:
    xx, xy, xz, yy, yz, zz = inertia
    return f'<inertial pos="{words(centre)}" mass="{mass!r}" fullinertia="{words((xx, yy, zz, xy, xz, yz))}"/>'


def mjcf(probe: Probe, *, timestep: float, accelerometer: Triple, phantom: Triple) -> str:
    """Return MJCF text of arm, sensor and probe: torques as applied forces, sensors at the flange, no collision.

    Args:
        probe: probe on the sensor.
        timestep: time step [s].
        accelerometer: its position in the sensor's frame [m].
        phantom: half sizes of the drawn phantom [m], its surface at the body's origin.
    """
    points, faces = words(tuple(probe.vertices.ravel().tolist())), " ".join(str(i) for i in probe.faces.ravel())
    xx, yy, zz = probe.inertia
    body = _mjcf_inertial(probe.mass, probe.centre, (xx, 0.0, 0.0, yy, 0.0, zz))
    links = "".join(
        f'<body name="{link.name}" pos="{words(link.origin)}" xyaxes="{_axes(link.turn)}">'
        f"{_mjcf_inertial(link.mass, link.centre, link.inertia)}"
        f'<joint name="{name}" axis="0 0 1"/>{_capsule(*drawn)}'
        for name, link, drawn in zip(JOINTS, LINKS, _DRAWN, strict=True)
    )
    x, y, z = phantom
    return f"""
<mujoco model="moving phantom">
  <compiler angle="radian" autolimits="false"/>
  <option timestep="{timestep!r}" integrator="Euler" gravity="0 0 -9.81"><flag contact="disable"/></option>
  <visual><global offwidth="1280" offheight="960"/><headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5"/></visual>
  <default><geom contype="0" conaffinity="0"/></default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.95 0.96 0.98" rgb2="0.70 0.75 0.82" width="64"
      height="384"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.82 0.84 0.86" rgb2="0.76 0.78 0.80" width="256"
      height="256"/>
    <material name="floor" texture="floor" texrepeat="8 8"/>
    <material name="arm" rgba="0.85 0.86 0.88 1"/>
    <material name="probe" rgba="0.16 0.38 0.62 1"/>
    <material name="phantom" rgba="0.91 0.70 0.60 0.75"/>
    <mesh name="probe" vertex="{points}" face="{faces}"/>
  </asset>
  <worldbody>
    <light pos="0.5 -0.8 1.6" dir="-0.1 0.5 -1" castshadow="true"/>
    <geom type="plane" size="1 1 0.1" material="floor"/>
    <body name="phantom" mocap="true">
      <geom type="box" size="{words(phantom)}" pos="0 0 {-z!r}" material="phantom"/>
      <geom type="box" size="{words((1.1 * x, 1.1 * y, 0.004))}" pos="0 0 {-2 * z - 0.004!r}" rgba="0.3 0.3 0.34 1"/>
    </body>
    <body name="elfin_base" xyaxes="{_axes((0.0, 0.0, BASE_TURN))}">
      <geom type="cylinder" fromto="0 0 0 0 0 0.12" size="0.06" material="arm"/>
      {links}
      <body name="{SENSOR}" pos="{words(FLANGE)}">
        {body}
        <site name="{SENSOR}" size="0.004"/>
        <site name="accelerometer" pos="{words(accelerometer)}" size="0.004"/>
        <geom type="cylinder" fromto="0 0 0 0 0 0.018" size="0.035" rgba="0.25 0.25 0.28 1"/>
        <geom type="mesh" mesh="probe" material="probe"/>
      </body>
      {"</body>" * len(LINKS)}
    </body>
  </worldbody>
  <sensor>
    <force site="{SENSOR}"/><torque site="{SENSOR}"/><accelerometer site="accelerometer"/>
  </sensor>
</mujoco>"""
