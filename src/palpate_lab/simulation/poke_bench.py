"""A bench for pokes: a flat tip on a compliant skin, the taxels below, and a force/torque sensor above the elbow.

The truth is the integral over the cells of the tip, never an estimate.

Contact, an elastic foundation (Johnson, Contact Mechanics, 4.3): the tip is a grid of cells; a cell that is d deep
below the free surface bears the pressure p = k max(0, d). With x along the curvature c of the surface and a tip tilted
by (u, v), d = e - c x^2 / 2 - u x - v y, and e is such that the normal force is the wanted one. The truth is the centre
of pressure. Friction (Coulomb) on each cell is -p (g + w r / r_max) with g the same everywhere, so that the force lies
in a cone about the normal, and w turning about the centre of pressure, so that it adds a moment about the normal and no
force; |g| + |w| is below the coefficient of friction.

Response, vertical stress under point loads on a half space (Boussinesq 1885; Johnson, 3.2):
sigma = sum over cells of 3 P h^3 / (2 pi (h^2 + r^2)^(5/2)), h the depth of the taxels and r the flat distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, pi, radians, tan
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.pose import Pose
from palpate_lab.simulation.forearm import Forearm, nearby, places_near

FAR = 9e-3  # m from all that presses: 15 N there are less than a quarter of a count


@dataclass(frozen=True)
class Tip:
    """The tip of the tool, and the forces and angles of its pokes.

    Args:
        side: side of the square [m].
        cells: number of cells along it.
        tilt: standard deviation of the tilt about each side [rad].
        cone: half angle [rad] about the normal within which the force lies, evenly over the solid angle.
        friction: coefficient of friction; must be at least tan(cone).
        spin: largest share of the remaining friction that turns about the normal.
        light, heavy: bounds of the normal force [N], evenly between.
    """

    side: float = 4e-3
    cells: int = 8
    tilt: float = radians(3.0)
    cone: float = radians(17.0)
    friction: float = 0.5
    spin: float = 1.0
    light: float = 4.0
    heavy: float = 15.0

    def __post_init__(self) -> None:
        if not (0 < self.light <= self.heavy and tan(self.cone) <= self.friction):
            raise ValueError("forces must be positive, and the cone within friction")


HAND = Tip(cone=radians(30.0), friction=0.6)  # by hand: with a narrow cone the free method finds the axis of the link


@dataclass(frozen=True)
class SoftLayer:
    """The compliant skin above the taxels.

    Args:
        depth: depth of the taxels below its surface [m].
        stiffness: stiffness of the foundation [Pa/m].
        unequal: standard deviation of a taxel's gain, drawn once.
        counts: counts above rest at 15 N on a taxel's centre; 255 is the range.
        noise: noise before rounding [counts].
        threshold: counts above which a taxel answers: about three of them to a poke.
    """

    depth: float = 2.5e-3
    stiffness: float = 4e8
    unequal: float = 0.1
    counts: float = 200.0
    noise: float = 0.3
    threshold: float = 1.5


@dataclass(frozen=True)
class Elbow:
    """The elbow between sensor and link: pitch j3 about the sensor's y, then roll j4 about the link's z.

    T_sensor_link = Trans_z(upper) Rot_y(j3) Rot_z(j4); at zero the forearm continues the upper arm.

    Args:
        upper: distance from the sensor to the elbow [m].
        table: (j3, j4) [deg] and minutes of each dataset [taxel poking, table I].
    """

    upper: float = 0.085
    table: tuple[tuple[float, float, float], ...] = (
        (94.0, 0.0, 13.0),
        (15.0, -90.0, 5.0),
        (35.0, -40.0, 4.0),
        (94.0, 0.0, 7.0),
        (94.0, 0.0, 7.0),
        (45.0, 0.0, 7.0),
        (94.0, -90.0, 7.0),
    )

    def pose(self, j3: Float[np.ndarray, "*batch"], j4: Float[np.ndarray, "*batch"]) -> Pose:
        """Return T_sensor_link, a `Pose`, at joint angles (*batch) [rad]."""
        c3, s3, c4, s4, zero = np.cos(j3), np.sin(j3), np.cos(j4), np.sin(j4), np.zeros_like(j3)
        rows = [[c3 * c4, -c3 * s4, s3], [s4, c4, zero], [-s3 * c4, s3 * s4, c3]]
        return Pose(np.moveaxis(np.array(rows), (0, 1), (-2, -1)), np.stack([zero, zero, zero + self.upper], axis=-1))

    @cached_property
    def joints(self) -> Float[np.ndarray, "d 2"]:
        """Joint angles of the datasets, (d, 2) [rad]."""
        return np.array([(radians(row[0]), radians(row[1])) for row in self.table])

    def shared(self, pokes: int) -> Int[np.ndarray, " n"]:
        """Return the dataset of each poke, (n,), in turn, in proportion to the datasets' minutes."""
        until = np.cumsum([row[2] for row in self.table])
        return np.asarray(np.searchsorted(until, until[-1] * (np.arange(pokes) + 0.5) / pokes), dtype=np.int64)


@dataclass(frozen=True)
class PokeErrors:
    """Standard deviations, along each axis, of the errors of sensor and robot.

    Args:
        noise_force, noise_torque: noise of each poke [N], [N m].
        bias_force, bias_torque: bias in each configuration [N], [N m].
        frame, frame_angle: error of the link's pose in each configuration [m], [rad].
        common, common_angle: error of the link's pose that is the same in all configurations [m], [rad].
        cross_talk: cross-talk as a share, entry by entry.
        lever: length [m] between forces and torques.
    """

    noise_force: float
    noise_torque: float
    bias_force: float
    bias_torque: float
    frame: float
    frame_angle: float
    common: float
    common_angle: float
    cross_talk: float
    lever: float = 0.1

    @property
    def noise(self) -> Float[np.ndarray, "6 6"]:
        """Covariance (6, 6) of the noise of a poke's wrench, force first, diagonal [N^2, (N m)^2]."""
        return np.diag(np.repeat([self.noise_force, self.noise_torque], 3) ** 2)


_DEGREE = radians(1.0)
MIX = PokeErrors(0.15, 0.015, 0.3, 0.03, 3e-3, _DEGREE, 3e-3, _DEGREE, 0.02)
PERSET = PokeErrors(0.15, 0.015, 0.4, 0.045, 4.5e-3, 2 * _DEGREE, 0.0, 0.0, 0.01)
NOISE2 = PokeErrors(0.4, 0.035, 0.25, 0.03, 3e-3, 1.2 * _DEGREE, 0.8e-3, 0.0, 0.006)


@dataclass(frozen=True, eq=False)
class TipContacts:
    """Contacts of the tip on the link, in the frame of the link, and the responses of the taxels.

    Attributes:
        contact: (n, 3) [m] centre of pressure.
        force: (n, 3) [N] on the body.
        torque: (n, 3) [N m] about the origin.
        spin: (n,) [N m] moment about the normal that remains at the contact.
        poke, taxel: (m,) numbers of the pairs that respond.
        response: (m,) counts above rest of each pair, before noise and rounding.
    """

    contact: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    torque: Float[np.ndarray, "n 3"]
    spin: Float[np.ndarray, " n"]
    poke: Int[np.ndarray, " m"]
    taxel: Int[np.ndarray, " m"]
    response: Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class PokeSession:
    """Pokes as they are measured, and their truth.

    Attributes:
        pokes: measured pokes.
        contacts: (n, 3) [m] true centres of pressure, in the frame of the link.
        directions: (n, 3) unit vectors of the force on the body, in the frame of the link.
        force: (n,) [N] size of the force.
        bench: bench, with the skin and the drawn errors.
        touches: exact contacts and responses.
    """

    pokes: Pokes
    contacts: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, " n"]
    bench: PokeBench
    touches: TipContacts


@dataclass(frozen=True, eq=False)
class PokeBench(Value):
    """A skin on an arm, with the errors that one session has.

    The true pose of the link is the reported one composed with Exp of the error on the link's side:
    c_sensor = R (Exp(phi) c_link + rho) + o. A wrench is measured as (1 + C) w + b + noise, w of the tool on the body
    about the origin of the sensor.

    Attributes:
        skin: true skin.
        errors: standard deviations that the errors were drawn from.
        arm, tip, layer: settings of the arm, the tip and the skin's layer.
        gains: (k,) gain of each taxel, about 1.
        bias: (d, 6) [N, N m] b of each configuration.
        frames: (d, 6) rho [m] and phi [rad] of each configuration, the common part included.
        cross_talk: (6, 6) C; torque from force in m, force from torque in 1/m.
    """

    skin: Forearm
    errors: PokeErrors
    arm: Elbow
    tip: Tip
    layer: SoftLayer
    gains: Float[np.ndarray, " k"]
    bias: Float[np.ndarray, "d 6"]
    frames: Float[np.ndarray, "d 6"]
    cross_talk: Float[np.ndarray, "6 6"]

    def __post_init__(self) -> None:
        for name in ("gains", "bias", "frames", "cross_talk"):
            object.__setattr__(self, name, frozen(getattr(self, name), name=name))

    @classmethod
    def drawn(
        cls,
        rng: np.random.Generator,
        *,
        skin: Forearm | None = None,
        errors: PokeErrors = MIX,
        arm: Elbow | None = None,
        tip: Tip | None = None,
        layer: SoftLayer | None = None,
    ) -> PokeBench:
        """Draw a `PokeBench` with one session's errors and gains.

        Args:
            rng: random numbers of everything drawn.
            skin: None: seven modules of twelve on a forearm.
            errors: standard deviations of the errors.
            arm: None: the usual one.
            tip: None: the usual one.
            layer: None: the usual one.
        """
        skin, arm, tip, layer = skin or Forearm.of(), arm or Elbow(), tip or Tip(), layer or SoftLayer()
        e, count = errors, len(arm.table)
        bias = rng.standard_normal((count, 6)) * np.repeat([e.bias_force, e.bias_torque], 3)
        common = rng.standard_normal(6) * np.repeat([e.common, e.common_angle], 3)
        frames = common + rng.standard_normal((count, 6)) * np.repeat([e.frame, e.frame_angle], 3)
        share = np.kron(np.array([[1.0, 1.0 / e.lever], [e.lever, 1.0]]), np.ones((3, 3)))
        cross_talk = e.cross_talk * share * rng.standard_normal((6, 6))
        gains = np.maximum(1.0 + layer.unequal * rng.standard_normal(len(skin.places)), 0.1)
        return cls(skin, errors, arm, tip, layer, gains, bias, frames, cross_talk)

    def session(
        self, rng: np.random.Generator, pokes: int = 1000, *, among: Int[np.ndarray, " j"] | None = None
    ) -> PokeSession:
        """Simulate pokes all over the skin, shared among the datasets as in the paper, and return the `PokeSession`.

        Args:
            rng: random numbers of places, forces and noise.
            pokes: number of pokes.
            among: taxels to stay near; others do not answer. None: all.

        Raises:
            InputError: no place is near these taxels alone.
        """
        points = places_near(self.skin, rng, pokes, among=among)
        return self.poke_at(points, self.directions(points, rng), self.arm.shared(pokes), rng)

    def directions(self, points: Float[np.ndarray, "n 3"], rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
        """Draw unit directions of force on the body (n, 3), evenly over the cone about the inward normal."""
        axes, _ = self.skin.frame(points)
        along = rng.uniform(cos(self.tip.cone), 1.0, len(points))
        around, side = rng.uniform(0.0, 2 * pi, len(points)), np.sqrt(1 - along**2)
        local = np.stack([side * np.cos(around), side * np.sin(around), -along], axis=-1)
        return np.einsum("ni,nij->nj", local, axes)

    def poke_at(
        self,
        points: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        configuration: Int[np.ndarray, " n"] | int,
        rng: np.random.Generator,
    ) -> PokeSession:
        """Simulate pokes with the middle of the tip at given points, and return the `PokeSession`.

        Args:
            points: (n, 3) [m] on the surface of the link.
            directions: (n, 3) of the force on the body, within friction.
            configuration: configuration of each poke.
            rng: random numbers of forces, tilts and noise.

        Raises:
            ValueError: a direction beyond friction.
        """
        configuration = np.broadcast_to(np.asarray(configuration, dtype=np.int64), (len(points),))
        normal = rng.uniform(self.tip.light, self.tip.heavy, len(points))
        touches = self.touch(points, directions, normal, rng)
        reported = self.arm.pose(*self.arm.joints.T)
        true = reported @ Pose.from_rotation_vector(self.frames[:, 3:].copy(), self.frames[:, :3])
        turn, origin = true.rotation[configuration], true.translation[configuration]
        force = np.einsum("nij,nj->ni", turn, touches.force)
        torque = np.einsum("nij,nj->ni", turn, touches.torque) + np.cross(origin, force)
        wrench = np.concatenate([force, torque], axis=1)
        noise = rng.standard_normal(wrench.shape) * np.sqrt(np.diag(self.errors.noise))
        wrench = wrench + wrench @ self.cross_talk.T + self.bias[configuration] + noise
        counts = self.read_out(touches.response, rng)
        rows = counts > self.layer.threshold
        answers = np.bincount(touches.poke[rows], minlength=len(points))
        pokes = Pokes(
            wrench,
            reported.rotation[configuration],
            reported.translation[configuration],
            configuration,
            np.concatenate([[0], np.cumsum(answers)]),
            touches.taxel[rows],
            counts[rows],
            len(self.skin.places),
            noise=self.errors.noise,
            weight=np.ones(len(points)),
            time=3.0 * np.arange(len(points)),
            threshold=self.layer.threshold,
        )
        size = np.linalg.norm(touches.force, axis=1)
        return PokeSession(pokes, touches.contact, touches.force / size[:, None], size, self, touches)

    def read_out(self, exact: Float[np.ndarray, " m"], rng: np.random.Generator) -> Float[np.ndarray, " m"]:
        """Convert exact counts above rest (m,) to integer counts of 8 bits (floats, 0 to 255), with noise."""
        return np.clip(np.rint(exact + self.layer.noise * rng.standard_normal(exact.shape)), 0.0, 255.0)

    def touch(
        self,
        points: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        normal: Float[np.ndarray, " n"],
        rng: np.random.Generator,
    ) -> TipContacts:
        """Compute contacts and responses, `TipContacts`, of the tip at points, pressed with normal forces (n,) [N].

        Raises:
            ValueError: a direction that does not press, or is beyond friction.
        """
        axes, curvature = self.skin.frame(points)
        local = np.einsum("nij,nj->ni", axes, directions)
        lean = local[:, :2] / -local[:, 2:]
        slip = np.linalg.norm(lean, axis=1)
        if np.any(local[:, 2] >= 0) or np.any(slip > self.tip.friction + 1e-12):
            raise ValueError("a force's direction must press, and lie within friction")
        x, y, load = self.pressed(normal, curvature, rng)
        cx, cy = (load * x).sum(axis=1) / normal, (load * y).sum(axis=1) / normal
        z = -0.5 * curvature[:, None] * x**2
        ax, ay = x - cx[:, None], y - cy[:, None]
        turning = self.tip.spin * rng.uniform(-1.0, 1.0, len(points)) * (self.tip.friction - slip)
        turning = turning / np.hypot(ax, ay).max(axis=1)
        pull = np.stack(
            [
                load * (lean[:, :1] - turning[:, None] * ay),
                load * (lean[:, 1:] + turning[:, None] * ax),
                -load,
            ],
            axis=-1,
        )
        place = np.stack([x, y, z], axis=-1)
        force, moment = pull.sum(axis=1), np.cross(place, pull).sum(axis=1)
        contact = np.stack([cx, cy, (load * z).sum(axis=1) / normal], axis=-1)
        out = [np.einsum("ni,nij->nj", each, axes) for each in (contact, force, moment)]
        spin = (load * turning[:, None] * (ax**2 + ay**2)).sum(axis=1)
        torque = out[2] + np.cross(points, out[1])
        return TipContacts(points + out[0], out[1], torque, spin, *self.answers(points, x, y, load))

    def pressed(
        self, normal: Float[np.ndarray, " n"], curvature: Float[np.ndarray, " n"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:
        """Return x, y [m] of the cells of tips turned and tilted at random, and the force [N] on each, all (n, c).

        x is round the link, y along it.
        """
        tip, count = self.tip, len(normal)
        step = tip.side * ((np.arange(tip.cells) + 0.5) / tip.cells - 0.5)
        u, v = (each.ravel() for each in np.meshgrid(step, step))
        angle = rng.uniform(0.0, 2 * pi, (count, 1))
        x, y = np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v
        tilt = tip.tilt * rng.standard_normal((count, 2))
        gap = 0.5 * curvature[:, None] * x**2 + tilt[:, :1] * x + tilt[:, 1:] * y
        spring = self.layer.stiffness * (tip.side / tip.cells) ** 2
        order = np.sort(gap, axis=1)
        bearing = np.arange(1.0, gap.shape[1] + 1.0)
        deep = (normal[:, None] / spring + np.cumsum(order, axis=1)) / bearing
        last = np.count_nonzero(deep > order, axis=1) - 1  # the depth at which as many cells bear as are above it
        return x, y, spring * np.maximum(deep[np.arange(count), last][:, None] - gap, 0.0)

    def answers(
        self,
        points: Float[np.ndarray, "n 3"],
        x: Float[np.ndarray, "n c"],
        y: Float[np.ndarray, "n c"],
        load: Float[np.ndarray, "n c"],
    ) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Compute the responses of taxels to forces near points.

        Args:
            points: (n, 3) [m] on the surface.
            x: (n, c) [m] along the first tangent from each point.
            y: (n, c) [m] along the second tangent.
            load: (n, c) [N] force there.

        Returns:
            Point (m,) and taxel (m,) of the pairs that are near each other, and the exact counts above rest (m,).
        """
        there = np.flatnonzero(self.skin.places.there)
        poke, entry = nearby(self._tree, points, FAR + float(np.hypot(x, y).max(initial=0.0)))
        taxel = there[entry]
        away = self.skin.offsets(points, poke, taxel)
        square = (x[poke] - away[:, :1]) ** 2 + (y[poke] - away[:, 1:]) ** 2
        response = self.gains[taxel] * self._scale * (load[poke] * boussinesq(square, self.layer.depth)).sum(axis=1)
        return poke, taxel, response

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.skin.places.positions[self.skin.places.there])

    @cached_property
    def _scale(self) -> float:
        """Counts per pascal, such that 15 N, evenly on a tip over a taxel, give the layer's `counts`."""
        step = self.tip.side * ((np.arange(self.tip.cells) + 0.5) / self.tip.cells - 0.5)
        square = (step[:, None] ** 2 + step**2).ravel()
        return self.layer.counts / (15.0 * float(boussinesq(square, self.layer.depth).mean()))


def boussinesq(square: Float[np.ndarray, "*batch"], depth: float) -> Float[np.ndarray, "*batch"]:
    """Return the vertical stress [Pa] at a depth [m] of 1 N at the surface, at the squared distance [m^2] along it."""
    near = square + depth**2
    return (3 * depth**3 / (2 * pi)) / (near * near * np.sqrt(near))
