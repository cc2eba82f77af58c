"""The settings of the touched forearm, its sensors and its touches."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, inf, pi, sin

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.spatial.pose import Pose
from palpate_lab.simulation.skin_bench import Rolled

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]

STEP_RATE = 1000  # Hz, of the physics
GRAVITY = 9.80665  # m/s^2, down the base's z
MILD_DRIFT = Drift(
    walk=[0.003] * 3 + [1e-4] * 3, warm_up=[0.002] * 3 + [5e-5] * 3, settling=300.0, weight=0.05
)  # of a good strain-gauge sensor that was just switched on: 3 mN in a second, 0.12 N/min at first


def _mount() -> Pose:
    """Return the sheet's pose: its middle 120 mm out of the sensor, the seam turned by 30 degrees."""
    return Pose.from_quaternion((0.0, 0.0, sin(pi / 12), cos(pi / 12)), (0.0, 0.0, 0.12))


@dataclass(frozen=True)
class ForearmSettings:
    """The forearm: a cylinder along z of its link, whose middle is that of the sheet.

    Attributes:
        sheet: sheet of cells round the cylinder; its radius is the cylinder's.
        bare: length [m] of the cylinder beyond the sheet at each end, which feels nothing.
        mount: T_sensor_link.
        mass, centre: mass [kg] and centre of mass [m] of the link, in its frame: the force/torque sensor's payload.
        moving: True: the arm turns the sensor slowly about its origin, by about 35 degrees each way, once the time
            `quiet` is over; False: it keeps still.
        touches: number of indenters, so the largest number of touches at once.
        seconds: duration of the log [s].
        quiet: time [s] at its start without touch or motion.
        force: least and largest normal force of a touch [N].
        radius: least and largest radius of an indenter's sphere [m].
        friction: Coulomb's coefficient of every contact.
        lean: largest angle between push and normal, as a multiple of the friction angle: above 1 some slide.
        drags: share of touches that are dragged along the surface, by 10 to 40 mm.
        unseen: share of touches next to the sheet.
        margin: distance [cells] from the sheet's edges within which no touch is aimed.
        spacing: least distance [m] between two touches at once, along the surface.
        stiffness: stiffness [N/m] of the hand that guides an indenter.
        modulus: modulus of the skin [Pa], E/(1 - nu^2): radius of the pressed disc by Hertz, a^3 = 3 F R / (4 E).
        wrench_rate, skin_rate: rates [Hz], divisors of 1000.
        force_noise, torque_noise: standard deviation of one reading [N], [N m].
        bias: bias of the force/torque sensor at the start [N, N m].
        drift: drift of the bias, and uncertainty of the payload's weight; None: none.
        cell_noise: standard deviation of a cell's noise [counts].
        unequal: standard deviation of the cells' gains, as a share.
        clock_offset: time [s] added to the stamps of the skin, relative to those of wrench and poses.
    """

    sheet: Rolled = field(default_factory=lambda: Rolled(rows=10))
    bare: float = 0.035
    mount: Pose = field(default_factory=_mount)
    mass: float = 0.9
    centre: Three = (0.003, -0.002, -0.01)
    moving: bool = True
    touches: int = 3
    seconds: float = 60.0
    quiet: float = 3.0
    force: tuple[float, float] = (2.0, 12.0)
    radius: tuple[float, float] = (0.008, 0.015)
    friction: float = 0.5
    lean: float = 1.3
    drags: float = 0.25
    unseen: float = 1 / 6
    margin: float = 0.5
    spacing: float = 0.03
    stiffness: float = 800.0
    modulus: float = 4e5
    wrench_rate: int = 1000
    skin_rate: int = 100
    force_noise: float = 0.04
    torque_noise: float = 1.5e-3
    bias: Six = (1.3, -0.8, 2.1, 0.03, -0.05, 0.02)
    drift: Drift | None = None
    cell_noise: float = 1.0
    unequal: float = 0.02
    clock_offset: float = 0.0

    def __post_init__(self) -> None:
        """Check that the numbers are possible.

        Raises:
            InputError: a rate does not divide 1000 Hz, or a number is out of its range.
        """
        for rate in (self.wrench_rate, self.skin_rate):
            if rate < 1 or STEP_RATE % rate:
                raise InputError(f"a rate must divide the {STEP_RATE} Hz of the physics, not {rate} Hz.")
        if not 1 <= self.touches <= 5:
            raise InputError(f"touches must be from 1 to 5, not {self.touches}.")
        for name in ("seconds", "mass", "friction", "stiffness", "modulus"):
            if not 0.0 < getattr(self, name) < inf:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}.")
        for name in ("quiet", "lean", "drags", "unseen", "margin", "spacing", "force_noise", "torque_noise", "unequal"):
            if not 0.0 <= getattr(self, name) < inf:
                raise InputError(f"{name} must not be negative, but is {getattr(self, name)}.")
        for name in ("force", "radius"):
            least, most = getattr(self, name)
            if not 0.0 < least <= most < inf:
                raise InputError(f"{name} must be two positive numbers, the larger one last, not {least}, {most}.")
        if not 0.0 < self.sheet.radius < inf:
            raise InputError("the sheet must be wrapped round a cylinder, so its radius must be positive and finite.")
        if self.unseen > 0.0 and self.bare < 0.03:
            what = f"touches next to the sheet (unseen) need bare ends of 30 mm or more, not {1e3 * self.bare:g} mm."
            raise InputError(what, hint="Raise bare, or set unseen to 0.")

    @property
    def covered(self) -> float:
        """Distance [m] from the middle to the sheet's edge, along z."""
        return 0.5 * self.sheet.rows * self.sheet.pitch

    @property
    def half_length(self) -> float:
        """Half of the cylinder's length [m]."""
        return self.covered + self.bare
