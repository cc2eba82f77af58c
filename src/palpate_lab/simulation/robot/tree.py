"""Describe a robot as a tree of links, and write it as URDF and as MJCF: one description, two languages."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from palpate.spatial.pose import Pose
from palpate_lab.simulation.engine import words

Three = tuple[float, float, float]
GRAVITY = 9.80665  # m/s^2, down the base's z
_SPEED, _EFFORT = 2.0, 50.0  # rad/s, N m: limits of every joint
_SMALL = 0.02  # m: radius of gyration of a link without a shape
_MESHES = "meshes"
_Element = ElementTree.Element


@dataclass(frozen=True)
class SolidShape:
    """A closed shape in the frame of a link.

    Attributes:
        kind: "box" (three half-lengths), "cylinder" (radius and half-length along z), "ellipsoid" (half-lengths) or
            "sphere" (radius).
        size: lengths [m] of the kind.
        at: centre [m].
    """

    kind: str
    size: tuple[float, ...]
    at: Three = (0.0, 0.0, 0.0)

    def gyration(self) -> Three:
        """Return the squared radii of gyration [m^2] about the three axes through the centre of the solid shape."""
        if self.kind == "cylinder":
            across = self.size[0] ** 2 / 4 + self.size[1] ** 2 / 3
            return across, across, self.size[0] ** 2 / 2
        a, b, c = (length**2 / (3.0 if self.kind == "box" else 5.0) for length in self.size)
        return b + c, a + c, a + b


@dataclass(frozen=True)
class RobotLink:
    """A link, and the joint by which its parent carries it.

    Attributes:
        name, parent: of the link, and of its parent, "" for the base.
        xyz, rpy: origin [m], and rotation [rad] about the fixed axes x, y, z, in the frame of the parent.
        axis: of the revolute joint, in the link's frame; None: the joint is fixed.
        middle, span: of the joint's range [rad]: middle - span to middle + span.
        mimic: name of the link whose joint this one follows, and the factor; None: it moves on its own.
        shapes: closed shapes, which do not move against each other.
        mass: [kg], in the centre of the first shape; 0: a frame only.
        looks: shapes that are only seen, in the URDF.
    """

    name: str
    parent: str = ""
    xyz: Three = (0.0, 0.0, 0.0)
    rpy: Three = (0.0, 0.0, 0.0)
    axis: Three | None = None
    middle: float = 0.0
    span: float = 1.2
    mimic: tuple[str, float] | None = None
    shapes: tuple[SolidShape, ...] = ()
    mass: float = 0.0
    looks: tuple[SolidShape, ...] = ()

    @property
    def joint(self) -> str:
        """Name of the joint above the link."""
        return f"{self.name}_joint"

    @property
    def centre(self) -> Three:
        """Centre of mass [m]."""
        return self.shapes[0].at if self.shapes else (0.0, 0.0, 0.0)

    def inertia(self) -> Three:
        """Return the moments of inertia [kg m^2] about the axes through the centre of mass."""
        x, y, z = self.shapes[0].gyration() if self.shapes else (_SMALL**2,) * 3
        return self.mass * x, self.mass * y, self.mass * z

    def origin(self) -> Pose:
        """Return T_parent_link at position zero of the joint."""
        from scipy.spatial.transform import Rotation

        return Pose(Rotation.from_euler("xyz", self.rpy).as_matrix(), np.array(self.xyz))


def moving(links: Iterable[RobotLink]) -> list[RobotLink]:
    """Return the links whose joints move on their own, in order."""
    return [link for link in links if link.axis is not None and link.mimic is None]


def meshed(links: Iterable[RobotLink]) -> dict[str, SolidShape]:
    """Return the shapes that a URDF has no primitive for, by the paths of their meshes."""
    found = ((link.name, shape) for link in links for shape in link.shapes if shape.kind == "ellipsoid")
    return {f"{_MESHES}/{name}.stl": shape for name, shape in found}


def urdf(name: str, links: Iterable[RobotLink]) -> str:
    """Return the robot as a URDF, whose meshes are those of `meshed`."""
    root = _Element("robot", name=name)
    for link in links:
        _urdf_link(root, link)
        if link.parent:
            _urdf_joint(root, link)
    return _text(root)


def mjcf(name: str, links: Iterable[RobotLink], sites: Iterable[str]) -> str:
    """Return the robot as MJCF with a force and a torque sensor in the frames of the links named by `sites`."""
    root = _Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(root, "option", gravity=words((0.0, 0.0, -GRAVITY)))
    bodies = {"": ElementTree.SubElement(root, "worldbody")}
    equal, sensors = ElementTree.SubElement(root, "equality"), ElementTree.SubElement(root, "sensor")
    for link in links:
        bodies[link.name] = _body(bodies[link.parent], link)
        if link.mimic is not None:
            coefficients = words((0.0, link.mimic[1], 0.0, 0.0, 0.0))
            ElementTree.SubElement(
                equal, "joint", joint1=link.joint, joint2=f"{link.mimic[0]}_joint", polycoef=coefficients
            )
    for site in sites:
        ElementTree.SubElement(bodies[site], "site", name=site)
        for kind in ("force", "torque"):
            ElementTree.SubElement(sensors, kind, site=site)
    return _text(root)


def _urdf_link(root: _Element, link: RobotLink) -> None:
    element = ElementTree.SubElement(root, "link", name=link.name)
    if link.mass:
        inertial = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=words(link.centre), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=repr(link.mass))
        moments = dict(zip(("ixx", "iyy", "izz"), map(repr, link.inertia()), strict=True))
        ElementTree.SubElement(inertial, "inertia", {**moments, "ixy": "0", "ixz": "0", "iyz": "0"})
    uses = [(shape, use) for shape in link.shapes for use in ("visual", "collision")]
    for shape, use in [*uses, *((shape, "visual") for shape in link.looks)]:
        part = ElementTree.SubElement(element, use)
        ElementTree.SubElement(part, "origin", xyz=words(shape.at), rpy="0 0 0")
        geometry = ElementTree.SubElement(part, "geometry")
        if shape.kind == "box":
            ElementTree.SubElement(geometry, "box", size=words([2 * half for half in shape.size]))
        elif shape.kind == "cylinder":
            radius, length = repr(shape.size[0]), repr(2 * shape.size[1])
            ElementTree.SubElement(geometry, "cylinder", radius=radius, length=length)
        elif shape.kind == "sphere":
            ElementTree.SubElement(geometry, "sphere", radius=repr(shape.size[0]))
        else:
            ElementTree.SubElement(geometry, "mesh", filename=f"{_MESHES}/{link.name}.stl")


def _urdf_joint(root: _Element, link: RobotLink) -> None:
    kind = "fixed" if link.axis is None else "revolute"
    joint = ElementTree.SubElement(root, "joint", name=link.joint, type=kind)
    ElementTree.SubElement(joint, "origin", xyz=words(link.xyz), rpy=words(link.rpy))
    ElementTree.SubElement(joint, "parent", link=link.parent)
    ElementTree.SubElement(joint, "child", link=link.name)
    if link.axis is not None:
        ElementTree.SubElement(joint, "axis", xyz=words(link.axis))
        bounds = {"lower": repr(link.middle - link.span), "upper": repr(link.middle + link.span)}
        ElementTree.SubElement(joint, "limit", bounds | {"velocity": repr(_SPEED), "effort": repr(_EFFORT)})
    if link.mimic is not None:
        ElementTree.SubElement(joint, "mimic", joint=f"{link.mimic[0]}_joint", multiplier=repr(link.mimic[1]))


def _body(parent: _Element, link: RobotLink) -> _Element:
    x, y, z, w = link.origin().quaternion().tolist()
    body = ElementTree.SubElement(parent, "body", name=link.name, pos=words(link.xyz), quat=words((w, x, y, z)))
    if link.mass:
        about = {"pos": words(link.centre), "mass": repr(link.mass), "diaginertia": words(link.inertia())}
        ElementTree.SubElement(body, "inertial", about)
    if link.axis is not None:
        ElementTree.SubElement(body, "joint", name=link.joint, axis=words(link.axis))
    for shape in link.shapes:
        place = {"pos": words(shape.at), "size": words(shape.size), "contype": "0", "conaffinity": "0"}
        ElementTree.SubElement(body, "geom", {"type": shape.kind, **place})
    return body


def _text(root: _Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
