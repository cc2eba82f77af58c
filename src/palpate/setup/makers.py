"""Read frame, point and sign of a wrench, and the form of a pose, from the column names of makers' logs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.files.units import split_unit
from palpate.setup.names import orientation_columns, position_columns


@dataclass(frozen=True)
class NamedWrench:
    """Meaning of a wrench whose columns have a maker's names; the settings are those of [force_torque] in a rig.

    Attributes:
        whose: words for a sentence: "is the wrench ..."; "" for names of no known maker.
        unknown: what the names leave open, a sentence; "": nothing.
    """

    whose: str = ""
    frame: str = "sensor"
    torque_frame: str | None = None
    reference: str = "sensor"
    acts_on: str = "body"
    unknown: str = ""

    @property
    def settings(self) -> dict[str, str]:
        """Settings in a rig, key -> value, that are not the usual ones."""
        stated = {"acts_on": self.acts_on, "torque_frame": self.torque_frame, "reference": self.reference}
        return {key: value for key, value in stated.items() if value not in (None, "body", "sensor")}


_WRENCHES = {
    r"O_F_ext_hat_K": NamedWrench(
        "of a Franka arm, what it does to the world, along the axes of its base O and about its origin",
        frame="base",
        reference="base",
        acts_on="environment",
    ),
    r"K_F_ext_hat_K": NamedWrench(
        "of a Franka arm, what it does to the world, in its stiffness frame K, which is taken as the sensor's",
        acts_on="environment",
    ),
    r"actual_TCP_force": NamedWrench(
        "of a UR arm along the axes of its base",
        frame="base",
        unknown="a UR arm of the CB series writes torques about the TCP, one of the e-Series about the tool flange: "
        "state that point as reference [x, y, z] in [force_torque], in m in the frame of the logged pose",
    ),
    r"external_tcp_force": NamedWrench("of a Doosan arm along the axes of its base", frame="base"),
    r"tool_external_wrench": NamedWrench(
        unknown="a Kinova arm's interface does not state the axes of tool_external_wrench, nor its point: check frame, "
        "acts_on and reference in [force_torque] by a press whose place is known",
    ),
    r"jr3": NamedWrench(
        unknown="the axes of JR3 sensors are left-handed unless the driver corrects them: check axes and left_handed "
        'in [force_torque], as axes = ["-x", "y", "z"] and left_handed = true',
    ),
    r"fActualETT": NamedWrench(
        "of a Doosan arm, its force along the axes of the base and its torque along those of the tool",
        frame="base",
        torque_frame="sensor",
    ),
}


def named_wrench(columns: Sequence[str]) -> NamedWrench:
    """Return the meaning of a wrench by the name of its first column."""
    return next((found for name, found in _WRENCHES.items() if re.search(name, columns[0], re.I)), NamedWrench())


@dataclass(frozen=True)
class NamedPose:
    """Columns of the sensor's pose, found by their names.

    Attributes:
        orientation: columns of the orientation.
        form: form of the orientation, as [orientation] in a rig has it.
        position: columns of the position; (): none, or they are in the orientation's matrix.
        sure: whether the names leave no doubt.
        ordered: whether the order of a quaternion is known.
        remark: what to check, a sentence; "": nothing.
        inverse: whether it is the base in the sensor.
        proven: whether the numbers show what it is.
    """

    orientation: tuple[str, ...]
    form: str
    position: tuple[str, ...] = ()
    sure: bool = True
    remark: str = ""
    ordered: bool = True
    inverse: bool = False
    proven: bool = False


_NUMBERED = re.compile(r"^(?P<head>.*?)[\W_]*(?P<number>\d{1,2})\W*$")
_POSES = {  # name of a series of numbers -> form, numbers of the orientation, of the position, words
    (r"O_T_EE\w*$", 16): ("matrix_columns", slice(0, 16), slice(0), "the end effector's pose of a Franka arm"),
    (r"(actual|target)_TCP_pose$", 6): ("rotation_vector", slice(3, 6), slice(0, 3), "the TCP's pose of a UR arm"),
}
_UNORDERED = (  # name of a series of numbers, count, numbers of the orientation, of the position
    (r"(?:^|[\W_])(?:q|quat\w*|orientation|rot\w*)$", 4, slice(0, 4), slice(0)),
    (r"(?:^|[\W_])pose$", 7, slice(3, 7), slice(0, 3)),
)
_VECTOR = "are taken for a rotation vector: if they are Euler angles, state their form"
_THREE = (  # names of three columns, form, remark
    (("roll", "pitch", "yaw"), "euler_xyz", "are taken for angles about fixed axes x, y, z"),
    (("rx", "ry", "rz"), "rotation_vector", _VECTOR),
    (("ox", "oy", "oz"), "rotation_vector", _VECTOR),
    (("a", "b", "c"), "euler_ZYX_deg", "are taken for a KUKA arm's angles about moving axes z, y, x in degrees"),
    (tuple(f"toolposetheta{axis}" for axis in "xyz"), "euler_xyz_deg", "are the angles of a Kinova arm's tool"),
)


def named_pose(names: Sequence[str]) -> NamedPose | None:
    """Return the columns of the sensor's pose and the form of its orientation, or None if no names look like one."""
    series: dict[str, dict[int, str]] = {}
    for name in names:
        if match := _NUMBERED.match(name):
            series.setdefault(match["head"], {})[int(match["number"])] = name
    for (pattern, count), (form, turned, moved, whose) in _POSES.items():
        for head, numbered in series.items():
            if re.search(pattern, head) and sorted(numbered) == list(range(count)):
                columns = tuple(numbered[k] for k in range(count))
                remark = f"{columns[0]!r} ... is {whose}, which is taken for the sensor's"
                return NamedPose(columns[turned], form, columns[moved], remark=remark)
    position = position_columns(names) or ()
    if (quaternion := orientation_columns(names)) is not None:
        return NamedPose(quaternion, "quaternion", position)
    for pattern, count, turned, moved in _UNORDERED:
        for head, numbered in series.items():
            if re.search(pattern, head, re.I) and max(numbered) - min(numbered) + 1 == len(numbered) == count:
                columns = tuple(numbered[k] for k in sorted(numbered))
                return NamedPose(columns[turned], "quaternion", columns[moved] or position, ordered=False)
    bare = {split_unit(name)[0].strip().lower().replace("_", ""): name for name in names}
    for words, form, remark in _THREE:
        if set(words) <= bare.keys():
            columns = tuple(bare[word] for word in words)
            stated = form == "euler_xyz" and "deg" in (split_unit(columns[0])[1] or columns[0])
            sure = words[0].startswith("toolpose")
            form = f"{form}{'_deg' * stated}"
            return NamedPose(columns, form, position, sure, remark=f"{columns[0]!r} ... {remark}")
    return None


def pose_columns(names: Sequence[str]) -> set[str]:
    """Return the set of columns that are of a pose by their names."""
    found = named_pose(names)
    return set() if found is None else {*found.orientation, *found.position}
