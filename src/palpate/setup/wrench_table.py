"""The [force_torque] of a rig as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.setup.tables import RigPair, Three, require_path, require_positive

Six = tuple[str, str, str, str, str, str]


@dataclass(frozen=True)
class RigUnits:
    """Units of forces and torques in the log."""

    force: str = "N"
    torque: str = "N m"


@dataclass(frozen=True)
class RigNoise(RigPair):
    """Standard deviations of one reading; below `corner` [Hz] the noise goes as 1/f; None: `corner` is the log's.

    Raises:
        ValueError: a value is not positive and finite.
    """

    corner: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "corner")


@dataclass(frozen=True)
class RigForceTorque:
    """The [force_torque] of a rig: the wrench's columns, units and meaning in the log, and the sensor's properties.

    `acts_on` is "body", or "environment" where the wrench is what the robot does to the world; `frame` and
    `torque_frame` are "sensor" or "base", and `reference` is the point of the torque: "sensor", "base" (their origins),
    or a point [m] in the sensor's frame. `torque_axes` and `torque_frame` are those of the force if they are not given.
    """

    columns: Six = ("fx", "fy", "fz", "tx", "ty", "tz")
    topic: str | None = None
    units: RigUnits = field(default_factory=RigUnits)
    axes: tuple[str, str, str] = ("x", "y", "z")
    left_handed: bool = False
    torque_axes: tuple[str, str, str] | None = None
    acts_on: str = "body"
    frame: str = "sensor"
    torque_frame: str | None = None
    reference: str | Three = "sensor"
    noise: RigNoise | None = None
    range: RigPair | None = None
    gain_error: float = 0.0
    drift: RigPair | None = None
    payload: str | None = None

    def __post_init__(self) -> None:
        for name in ("frame", "torque_frame"):
            if (frame := getattr(self, name)) not in ("sensor", "base", *((None,) if name == "torque_frame" else ())):
                raise ValueError(f"{name} must be 'sensor' or 'base', not {frame!r}")
        if self.acts_on not in ("body", "environment"):
            raise ValueError(f"acts_on must be 'body' or 'environment', not {self.acts_on!r}")
        if self.acts_on == "environment" and all(axis.startswith("-") for axis in self.axes):
            raise ValueError(
                "acts_on = 'environment' and axes that are all reversed undo each other: state one of them"
            )
        if isinstance(self.reference, str) and self.reference not in ("sensor", "base"):
            raise ValueError(
                f"reference must be 'sensor', 'base', or a point [x, y, z] in m in the sensor's frame, such as of a "
                f"flange or a TCP, not {self.reference!r}"
            )
        if not 0 <= self.gain_error < 1:
            raise ValueError(
                f"gain_error must be a share of the force, at least 0 and below 1, not {self.gain_error:g}"
            )
        require_path("payload", self.payload)
