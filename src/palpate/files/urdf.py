"""Read a robot description (URDF): meshes, the tree of fixed frames, and the kinematics of moving joints."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import GeometryError, InputError, importing_extra
from palpate.files.inputs import NO_XML, read_xml
from palpate.files.units import near
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.frames import FrameTree
from palpate.spatial.pose import Pose, quaternion_from_rotation
from palpate.surfaces._load import arrays_of, load_arrays
from palpate.surfaces.collada import ColladaAsset
from palpate.surfaces.mesh import Mesh

__all__ = ["GEOMETRIES", "Kinematics", "LinkBody", "Urdf"]

GEOMETRIES = ("visual", "collision")  # in order of preference: the visual geometry is closer to the shape
_XACRO = "Expand it first: xacro robot.urdf.xacro > robot.urdf (ROS 2: ros2 run xacro xacro ...)."
_FAR = 1e6  # m, and for all other numbers of an attribute
_MOVING = ("revolute", "continuous", "prismatic")
_ROUND, _HALVED = 96, 4  # facets round a cylinder, halvings of an icosahedron: chords err by R / 1500 or less


@dataclass(frozen=True)
class Joint:
    """A joint.

    Attributes:
        origin: T_parent_child at position zero.
        mimics: joint that it follows, or "".
        follows: factor and offset of its position from that of the other.
        element: of the XML.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Pose
    mimics: str
    follows: tuple[float, float]
    element: Any


@frozen_value(eq=True)
class LinkBody:
    """The triangles of a link, in its frame.

    Attributes:
        vertices, faces: (v, 3) [m] and (f, 3), of all its meshes and primitives.
        geometry: entry of `GEOMETRIES` that they are from.
        files: meshes that were read.
        notes: on what is not used of the meshes, a sentence each.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    geometry: str
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    def mesh(self, source: str, **options: Any) -> Mesh:
        """Return the link as a `Mesh`, with the options of `Mesh.from_arrays`.

        Raises:
            GeometryError: the triangles make no usable surface; the message begins with `source`.
        """
        try:
            made = Mesh.from_arrays(self.vertices, self.faces, **options)
        except GeometryError as error:
            raise GeometryError(f"{source}: {error}") from error
        return replace(made, notes=(*made.notes, *self.notes))


class Urdf:
    """A robot description.

    Args:
        path: the URDF file.
        packages: ROS package -> its folder; others are searched for above the file and in ROS's paths.

    Raises:
        InputError: the file cannot be read or is no URDF, a joint is malformed, or xacro must be expanded first.
    """

    def __init__(self, path: Path, packages: Mapping[str, Path] | None = None) -> None:
        self.path, self.packages = path, dict(packages or {})
        root = read_xml(path, "a URDF")
        if path.suffix == ".xacro" or any("xacro" in str(each.tag) for each in root.iter()):
            raise InputError("is written in xacro.", where=str(path), hint=_XACRO)
        if root.tag != "robot":
            raise InputError(f"is not a URDF: it describes a {root.tag!r}, not a robot.", where=str(path))
        self._links = {link.get("name", ""): link for link in root.iterfind("link")}
        self.joints = tuple(self._joint(joint) for joint in root.iterfind("joint"))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, in the order of the file."""
        return tuple(self._links)

    def shaped(self) -> list[str]:
        """Return the names of the links that have a geometry."""
        return [name for name, link in self._links.items() if any(_shapes(link, each) for each in GEOMETRIES)]

    def fixed(self) -> FrameTree:
        """Return the tree of the links that fixed joints connect."""
        return _tree(joint for joint in self.joints if joint.kind == "fixed")

    def root(self, link: str) -> str:
        """Return the topmost link above `link`.

        Raises:
            InputError: there is no such link, a link has two parents, or the joints form a loop.
        """
        self.require(link)
        tree = _tree(self.joints)
        return tree.up(link)[-1] if link in tree.frames else link  # a link without joints is its own root

    def chain(self, base: str, sensor: str) -> list[Joint]:
        """Return the joints between two links that can move, in the order of the file.

        Raises:
            InputError: there is no such link, not one path connects the two, or a joint in it is neither fixed nor of
                one axis.
        """
        found = [joint for joint, _ in self.steps(base, sensor) if joint.kind != "fixed"]
        return sorted(found, key=self.joints.index)

    def steps(self, base: str, sensor: str) -> list[tuple[Joint, bool]]:
        """Return all joints from one link to another, each with True if passed from parent to child.

        Raises:
            InputError: there is no such link, not one path connects the two, or a joint in it is neither fixed nor of
                one axis.
        """
        for link in (base, sensor):
            self.require(link)
        if base == sensor:  # which may have no joint
            return []
        try:
            frames = _tree(self.joints).path(base, sensor).frames
        except InputError as problem:
            raise InputError(problem.what, where=str(self.path), hint=problem.hint) from problem
        ends = {(joint.parent, joint.child): joint for joint in self.joints}
        found = [(ends[a, b], True) if (a, b) in ends else (ends[b, a], False) for a, b in pairwise(frames)]
        for joint, _ in found:
            if joint.kind not in (*_MOVING, "fixed"):
                between = f"joint {joint.name!r}, between {base!r} and {sensor!r},"
                what = f"{between} is {joint.kind}, which one number cannot state."
                raise InputError(what, where=str(self.path), hint="Choose a base link after this joint.")
        return found

    def axis(self, joint: Joint) -> Float[np.ndarray, " 3"]:
        """Return a joint's axis (3,), of any length, in its own frame; x if the file gives none.

        Raises:
            InputError: the axis is not three finite numbers.
        """
        element = joint.element.find("axis")
        if element is None:
            return np.array([1.0, 0.0, 0.0])
        return self._numbers(element, "xyz", f"the axis of joint {joint.name!r}", (1.0, 0.0, 0.0))

    def limits(self, joint: Joint) -> tuple[float, float, float]:
        """Return lowest and highest position [rad, m] and speed limit [rad/s, m/s] of a joint; 0 where omitted.

        The range of a continuous joint is -inf to inf.

        Raises:
            InputError: the joint has no <limit>, or a number in it cannot be read.
        """
        element, of = joint.element.find("limit"), f"the limit of joint {joint.name!r}"
        if element is None:
            raise InputError(f"joint {joint.name!r} has no limit.", where=str(self.path), hint="Add its <limit>.")
        lower, upper, speed = (float(self._numbers(element, k, of, (0.0,))[0]) for k in ("lower", "upper", "velocity"))
        return (-np.inf, np.inf, speed) if joint.kind == "continuous" else (lower, upper, speed)

    def require_tree(self) -> None:
        """Check that the joints form one tree.

        Raises:
            InputError: a link has two parents, as in a closed loop; joints form a circle; or there are two roots.
        """
        above = {link: [joint for joint in self.joints if joint.child == link] for link in self._links}
        for link, joints in above.items():
            if len(joints) > 1:
                parents = " and ".join(f"{joint.parent!r} (joint {joint.name!r})" for joint in joints)
                what = f"link {link!r} has {len(joints)} parents, {parents}: the joints form a closed loop."
                hint = "Remove all but one of these joints, and let those of a gripper's linkage mimic the driven one."
                raise InputError(what, where=str(self.path), hint=hint)
        roots = [link for link, joints in above.items() if not joints]
        if len(roots) > 1:
            what = f"the links form {len(roots)} trees, with the roots {', '.join(map(repr, roots))}."
            raise InputError(what, where=str(self.path), hint="Join them by a fixed joint, or remove the others.")
        tree = _tree(self.joints)
        try:
            for link in tree.frames:
                tree.up(link)
        except InputError as problem:
            hint = "Remove a joint, so that they form a tree."
            raise InputError(problem.what, where=str(self.path), hint=hint) from problem

    def require(self, link: str) -> None:
        """Check that there is a link of this name.

        Raises:
            InputError: there is none.
        """
        if link not in self._links:
            raise InputError(f"there is no link {link!r}.", where=str(self.path), hint=near(link, self._links))

    def body(self, link: str, geometry: str | None = None) -> LinkBody:
        """Return a link's meshes, boxes, cylinders and spheres, scaled and placed in its frame.

        Args:
            link: name of the link.
            geometry: one of `GEOMETRIES`; None: the first that the link has.

        Raises:
            InputError: there is no such link, it has no such geometry, a size in it is not a positive number, or a
                package or mesh is missing or cannot be read.
        """
        self.require(link)
        kinds = GEOMETRIES if geometry is None else (geometry,)
        taken = next((kind for kind in kinds if _shapes(self._links[link], kind)), None)
        if taken is None:
            what = "geometry" if geometry is None else f"{geometry} geometry"
            raise InputError(f"link {link!r} has no {what}.", where=str(self.path), hint=near(link, self.shaped()))
        vertices, faces, files, count = list[np.ndarray](), list[np.ndarray](), list[Path](), 0
        for shape in _shapes(self._links[link], taken):
            points, triangles, file = self._shape(shape, link)
            vertices.append(self._origin(shape, f"link {link!r}").apply(points))
            faces.append(triangles + count)
            files += [] if file is None else [file]
            count += len(points)
        read = tuple(dict.fromkeys(files))
        return LinkBody(np.concatenate(vertices), np.concatenate(faces), taken, read, tuple(_not_turned(read)))

    def _shape(self, shape: Any, link: str) -> tuple[np.ndarray, np.ndarray, Path | None]:
        """Return vertices [m] in the shape's frame, faces, and the mesh file or None."""
        mesh = shape.find("geometry/mesh")
        if mesh is None:
            return *arrays_of(self._primitive(shape.find("geometry"), f"link {link!r}"), str(self.path)), None
        file = self.resolve(mesh.get("filename", ""))
        scale = self._numbers(mesh, "scale", f"link {link!r}", (1.0, 1.0, 1.0)) * (ColladaAsset.of(file).metres or 1.0)
        points, faces = load_arrays(file)
        mirrored = bool(np.prod(scale) < 0)  # the other hand of a pair: facets are seen from the other side
        return points * scale, faces[:, ::-1] if mirrored else faces, file

    def _primitive(self, geometry: Any, of: str) -> Any:
        from trimesh import creation

        for kind in geometry:
            if kind.tag == "box":
                return creation.box(extents=self._numbers(kind, "size", of))
            if kind.tag == "cylinder":
                radius, length = (self._numbers(kind, key, of)[0] for key in ("radius", "length"))
                return creation.cylinder(radius, length, sections=_ROUND)
            if kind.tag == "sphere":
                return creation.icosphere(subdivisions=_HALVED, radius=self._numbers(kind, "radius", of)[0])
        raise InputError(f"{of} has a geometry that is not a mesh, box, cylinder or sphere.", where=str(self.path))

    def resolve(self, name: str) -> Path:
        """Return the file that `package://NAME/...`, `file://...` or a path relative to the URDF names.

        Raises:
            InputError: there is no such package or file, or the scheme is another one.
        """
        scheme, _, rest = name.rpartition("://")
        rest = unquote(rest) if scheme else rest
        if scheme in ("package", "model"):
            package, _, inside = rest.partition("/")
            folders = list(self._folders(package))
            if not folders:
                what = f"mesh {name!r}: package {package!r} is not found."
                hint = f"Name its folder: --package {package}=FOLDER, or packages in the rig's [surface]."
                raise InputError(what, where=str(self.path), hint=hint)
            files = [folder / inside for folder in folders]
        elif scheme in ("", "file"):
            files = [self.path.parent / rest]
        else:
            what = f"mesh {name!r} is not the address of a file."
            raise InputError(what, where=str(self.path), hint="Use package:// or a path.")
        found = next((file for file in files if file.is_file()), None)
        if found is None:
            raise InputError(f"mesh {name!r} is missing: there is no file {files[0]}.", where=str(self.path))
        return found

    def _folders(self, package: str) -> Iterator[Path]:
        """Yield where a package may be: in `packages`, or above the URDF, then in ROS's paths."""
        if package in self.packages:
            yield self.packages[package]
            return
        for above in self.path.resolve().parents:
            if above.name == package or _declares(above / "package.xml", package):
                yield above
            if (above / package).is_dir():
                yield above / package
        for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
            for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                for one in (Path(folder, inside, package), Path(folder)):
                    if one.is_dir() and one.name == package:
                        yield one

    def _joint(self, joint: Any) -> Joint:
        name, kind = joint.get("name", ""), joint.get("type", "fixed")
        ends = [None if end is None else end.get("link") for end in (joint.find("parent"), joint.find("child"))]
        if None in ends or not {*ends} <= {*self._links}:
            raise InputError(f"joint {name!r} does not join two links of the URDF.", where=str(self.path))
        place, mimics, follows = self._origin(joint, of := f"joint {name!r}"), "", (1.0, 0.0)
        if (mimic := joint.find("mimic")) is not None:
            factor, offset = self._numbers(mimic, "multiplier", of, (1.0,)), self._numbers(mimic, "offset", of, (0.0,))
            mimics, follows = mimic.get("joint", ""), (float(factor[0]), float(offset[0]))
        return Joint(name, kind, str(ends[0]), str(ends[1]), place, mimics, follows, joint)

    def _origin(self, element: Any, of: str) -> Pose:
        """Return the pose of an `origin`: rpy are about the fixed axes x, y, z, in this order."""
        from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

        origin = element.find("origin")
        if origin is None:
            return Pose.identity()
        turn, shift = (self._numbers(origin, key, of, (0.0, 0.0, 0.0)) for key in ("rpy", "xyz"))
        return Pose(Rotation.from_euler("xyz", turn).as_matrix(), shift)

    def _numbers(
        self, element: Any, key: str, of: str, default: tuple[float, ...] | None = None
    ) -> Float[np.ndarray, " k"]:
        """Return the numbers of an attribute: three of a vector, else one."""
        text = element.get(key)
        if text is None and default is not None:
            return np.array(default)
        wanted = 3 if key in ("xyz", "rpy", "size", "scale") else 1
        try:
            values = np.array([float(part) for part in str(text).split()])
        except ValueError:
            values = np.zeros(0)
        least = 0.0 if default is None else -_FAR
        if len(values) != wanted or not ((least < values) & (values < _FAR)).all():
            what = f"{key} of {of} must be {wanted} finite numbers (a size above 0 and below 1e6 m), not {text!r}."
            raise InputError(what, where=str(self.path))
        return values


@takes_arrays
class Kinematics:
    """Forward kinematics of links in another link, computed by pinocchio.

    Args:
        urdf: the robot.
        base: link in whose frame the others are given.
        links: the other links; one name is one link.

    Attributes:
        links: names of the other links.
        joints: names of the joints whose positions are needed; for one that mimics another, that other.
        turning: (j,) whether each of these turns, so that its position is an angle.

    Raises:
        InputError: there is no such link, or the joints do not form one tree; a joint between is neither fixed nor of
            one axis, or mimics one that does not move by itself; or pinocchio is not installed, or cannot read the
            URDF.
    """

    def __init__(self, urdf: Urdf, base: str, links: str | Sequence[str]) -> None:
        with importing_extra("joint states need pinocchio", "urdf", where=str(urdf.path)):
            self._pin: Any = import_module("pinocchio")
        self.links = (links,) if isinstance(links, str) else tuple(links)
        urdf.require_tree()
        known = {joint.name: joint for joint in urdf.joints}
        moving = dict.fromkeys(joint.name for link in self.links for joint in urdf.chain(base, link))
        chain = [known[name] for name in moving]
        for joint in chain:
            if joint.mimics and (joint.mimics not in known or known[joint.mimics].mimics):
                what = f"joint {joint.name!r} follows {joint.mimics!r}, which does not move by itself."
                raise InputError(what, where=str(urdf.path))
        self.joints = tuple(dict.fromkeys(joint.mimics or joint.name for joint in chain))
        self._limited = [known[name].kind == "revolute" for name in self.joints]
        self.turning = np.array([known[name].kind != "prismatic" for name in self.joints], dtype=bool)
        try:
            self._model = self._pin.buildModelFromUrdf(str(urdf.path))
        except Exception as problem:  # whatever its parser meets
            reason = " ".join(str(problem).split())[:160]
            raise InputError(f"pinocchio cannot read this URDF ({reason}).", where=str(urdf.path)) from problem
        body = self._pin.FrameType.BODY
        lost = [joint.name for joint in chain if not self._model.existJointName(joint.name)]
        lost += [link for link in (base, *self.links) if not self._model.existFrame(link, body)]
        if lost:  # it goes on after what it cannot parse
            what = f"pinocchio cannot read {lost[0]!r} of this URDF: it, or another element of the file, is malformed."
            raise InputError(what, where=str(urdf.path))
        self._data, self._where = self._model.createData(), self._pin.neutral(self._model)
        self._frames = [self._model.getFrameId(link, body) for link in (base, *self.links)]
        places = [self._model.joints[self._model.getJointId(joint.name)] for joint in chain]  # in pinocchio's numbers
        sources = [self.joints.index(joint.mimics or joint.name) for joint in chain]
        self._moved = list(zip(places, sources, (joint.follows for joint in chain), strict=True))

    def require_radians(self, values: Float[np.ndarray, "n k"], where: str) -> None:
        """Check that positions of `joints` (n, k) are not in degrees; `where` is their place, for the message.

        Raises:
            InputError: most positions of a limited revolute joint exceed 2 pi, or values have another shape.
        """
        if not len(values):
            return
        beyond = np.mean(np.abs(values) > 2 * np.pi, axis=0) > 0.5  # fewer may be faults
        for k in np.flatnonzero(beyond & np.array(self._limited, dtype=bool)):
            largest = np.abs(values[:, k]).max()
            what = f"joint {self.joints[k]!r} reads up to {largest:.4g}, more than a turn: it seems to be in degrees."
            raise InputError(what, where=where, hint="Write positions of joints in radians.")

    def poses(self, values: Float[np.ndarray, "n j"]) -> tuple[Float[np.ndarray, "n k 4"], Float[np.ndarray, "n k 3"]]:
        """Return quaternions x, y, z, w (n, k, 4) and positions (n, k, 3) [m] of the links in the base.

        `values` are positions of `joints`, (n, j) [rad, m].

        Raises:
            InputError: values has another shape.
        """
        values, row_of = _distinct(values)
        pin, model, data, where = self._pin, self._model, self._data, self._where
        placements = [data.oMf[frame] for frame in self._frames]  # pinocchio writes into them
        made = np.empty((len(values), len(placements), 4, 4))
        for k, row in enumerate(self._positions(values)):
            where[:] = row
            pin.framesForwardKinematics(model, data, where)
            made[k] = [each.homogeneous for each in placements]
        base, links = made[:, :1], made[:, 1:]
        turned = np.swapaxes(base[..., :3, :3], -1, -2)
        shift = np.einsum("...ij,...j->...i", turned, links[..., :3, 3] - base[..., :3, 3])
        return quaternion_from_rotation(turned @ links[..., :3, :3])[row_of], shift[row_of]

    def jacobians(self, values: Float[np.ndarray, "n j"], link: str) -> Float[np.ndarray, "n 6 j"]:
        """Return the derivatives (n, 6, j) of a link's pose by the positions of `joints`, in the base.

        The rows are rotation vector [rad] and translation [m].

        Raises:
            InputError: values has another shape, or the link is not one of `links`.
        """
        if link not in self.links:
            raise InputError(f"link must be one of {', '.join(self.links)}, not {link!r}.")
        values, row_of = _distinct(values)
        pin, model, data, aligned = self._pin, self._model, self._data, self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        base, frame = self._frames[0], self._frames[1 + self.links.index(link)]
        made = np.zeros((len(values), 6, len(self.joints)))
        for k, where in enumerate(self._positions(values)):
            pin.computeJointJacobians(model, data, where)
            pin.updateFramePlacements(model, data)
            of_base, of_link = (pin.getFrameJacobian(model, data, each, aligned) for each in (base, frame))
            lever = data.oMf[frame].translation - data.oMf[base].translation
            turn = data.oMf[base].rotation.T
            turning = turn @ (of_link[3:] - of_base[3:])
            moving = turn @ (of_link[:3] - of_base[:3] - np.cross(of_base[3:], lever, axis=0))
            for place, source, (factor, _) in self._moved:
                made[k, :3, source] += factor * turning[:, place.idx_v]
                made[k, 3:, source] += factor * moving[:, place.idx_v]
        return made[row_of]

    def _positions(self, values: Float[np.ndarray, "n j"]) -> Float[np.ndarray, "n q"]:
        """Return the numbers by which pinocchio states positions of `joints`."""
        made = np.tile(self._where, (len(values), 1))
        for place, source, (factor, offset) in self._moved:
            value = factor * values[:, source] + offset
            if place.nq == 2:  # a continuous joint: cosine and sine
                made[:, place.idx_q], made[:, place.idx_q + 1] = np.cos(value), np.sin(value)
            else:
                made[:, place.idx_q] = value
        return made


def _distinct(values: Float[np.ndarray, "n j"]) -> tuple[Float[np.ndarray, "m j"], Int[np.ndarray, " n"]]:
    """Return the rows that differ from the one before, and of each row its place among these."""
    moved = np.ones(len(values), dtype=bool)  # an arm that stays, stays in one pose
    moved[1:] = (values[1:] != values[:-1]).any(axis=1)
    return values[moved], np.cumsum(moved) - 1


def _tree(joints: Iterable[Joint]) -> FrameTree:
    return FrameTree((joint.parent, joint.child, joint.origin) for joint in joints)


def _shapes(link: Any, geometry: str) -> list[Any]:
    return [shape for shape in link.iterfind(geometry) if shape.find("geometry") is not None]


def _declares(file: Path, package: str) -> bool:
    try:
        return file.is_file() and ElementTree.parse(file).getroot().findtext("name", "").strip() == package
    except NO_XML:
        return False


def _not_turned(files: Iterable[Path]) -> Iterator[str]:
    """Yield a note for each mesh that states another up axis than z.

    It is not applied: RViz, Gazebo and MoveIt ignore it too, so that the meshes of robots lie right without it.
    """
    for file in files:
        if (asset := ColladaAsset.of(file)).turned:
            why = "not applied to a link of a URDF, as in RViz, Gazebo and MoveIt"
            yield f"{file.name} states {asset.up}, which is {why}: if it lies turned, write the turn in its <origin>"
