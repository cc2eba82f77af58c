"""Hold a robot as values: the [robot] of its rig, and a rig for each of its named sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from palpate.contact.origins import Origin
from palpate.errors import InputError
from palpate.files.units import near
from palpate.files.urdf import Urdf
from palpate.setup.rig import Rig
from palpate.setup.setup import SensorKind
from palpate.setup.tables import require_path, require_positive


@dataclass(frozen=True)
class RobotTable:
    """The [robot] of a rig: its URDF, and what moves it.

    `urdf` states links and joints; `packages`: name -> folder, for packages of the URDF that are not found otherwise.
    `joints` is a topic of joint states, "/tf", or joint -> column [rad, m] of a table. `base` is the link in whose
    frame contacts of all sensors are given together; None: the root of the URDF. `gravity` is "fixed" (the base stands
    upright: -z is down), the topic of an IMU, or a frame of /tf whose -z is down. `encoder` [degrees] is the standard
    deviation of each joint's position. No pose is interpolated between joint states more than `max_gap` [s] apart.
    `expected` names links that are always touched, such as feet on the ground: their contacts are no events.

    Raises:
        ValueError: a value is out of bounds, or one that is needed is missing.
    """

    urdf: str | None = None
    packages: Mapping[str, str] = field(default_factory=lambda: {}, hash=False)
    joints: str | Mapping[str, str] | None = None
    base: str | None = None
    gravity: str | None = None
    encoder: float = 0.0
    max_gap: float = 0.25
    expected: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_path("urdf", self.urdf)
        require_positive(self, "max_gap")
        if not 0 <= self.encoder <= 45:
            raise ValueError(f"encoder must be a standard deviation from 0 to 45 degrees, not {self.encoder:g}")
        if self.urdf is not None and self.gravity is None:
            raise ValueError(
                'gravity is missing: write gravity = "fixed" if -z of the base points down, else the topic of an IMU '
                "or a frame of /tf"
            )
        if self.urdf is None and (self.joints is not None or self.base is not None):
            raise ValueError("joints and base need the robot's urdf, which is missing")

    def read_urdf(self, folder: Path) -> Urdf | None:
        """Return the description of the robot, whose path starts in `folder`; None: none is named.

        Raises:
            InputError: the file cannot be read.
        """
        packages = {name: folder / inside for name, inside in self.packages.items()}
        return None if self.urdf is None else Urdf(folder / self.urdf, packages)


@dataclass(frozen=True)
class RobotSensor:
    """A sensor of a robot.

    Attributes:
        name: its name.
        rig: rig of this sensor alone.
        frame: link in whose frame it reports; None: not stated.
        link: name of the link that is touched; "" if none is stated.
        expected: whether it is always touched, so that its contacts are no events.
    """

    name: str
    rig: Rig
    frame: str | None
    link: str
    expected: bool

    @property
    def kind(self) -> SensorKind:
        """Kind of the sensor."""
        return self.rig.kind()

    def require_frame(self) -> str:
        """Return the link in whose frame it reports.

        Raises:
            InputError: it is not stated.
        """
        if self.frame is None:
            what = f"the link of the sensor {self.name!r} is not known, so its contacts have no base frame."
            raise InputError(what, hint="Name it as link in the rig.")
        return self.frame

    @property
    def origin(self) -> Origin:
        """Names of the sensor and of its link, as contacts have them."""
        return Origin(self.name, self.link)


@dataclass(frozen=True)
class Robot:
    """A robot: a tree of links, and named sensors on them.

    Attributes:
        table: the [robot] of its rig.
        sensors: name -> sensor, in the order of the file.
        faulty: name of a sensor that the rig does not state well -> what is wrong.
        path: file of the rig.
        urdf: description of the robot; None: the rig names none.
    """

    table: RobotTable
    sensors: Mapping[str, RobotSensor]
    faulty: Mapping[str, InputError]
    path: Path
    urdf: Urdf | None

    @property
    def base(self) -> str:
        """Link in whose frame the contacts of all sensors are given.

        Raises:
            InputError: the rig names no URDF, or the URDF has no such link or several roots.
        """
        if self.urdf is None:
            hint = "Add urdf, joints and base to [robot]."
            raise InputError("the base frame needs the robot's links.", where=str(self.path), hint=hint)
        if self.table.base is not None:
            self.urdf.require(self.table.base)
        return self.table.base or self.urdf.root(self.urdf.links[0])

    def picked(self, names: tuple[str, ...] | str | None) -> tuple[RobotSensor, ...]:
        """Return the named sensors, of text with commas between them; for None all that are not faulty.

        Raises:
            InputError: there is no sensor of a name, or it is faulty.
        """
        names = tuple(names.split(",")) if isinstance(names, str) else names
        for name in names or ():
            if name in self.faulty:
                raise self.faulty[name]
            if name not in self.sensors:
                what = f"the robot has no sensor {name!r}."
                raise InputError(what, where="--sensor", hint=near(name, self.sensors))
        return tuple(each for name, each in self.sensors.items() if names is None or name in names)

    def files(self) -> dict[str, Path]:
        """Return a dict, key -> path, of the files that the rig names; a key begins with the sensor's name."""
        own = {} if self.table.urdf is None else {"urdf": self.path.parent / self.table.urdf}
        of_sensors = {
            f"{name}.{key}": path for name, each in self.sensors.items() for key, path in each.rig.files().items()
        }
        return own | of_sensors
