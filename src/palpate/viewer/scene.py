"""Prepare contacts on a body for drawing at each moment: arrays and words, independent of any screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.ellipse import ellipse
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.events import Events
from palpate.contact.origins import Origin
from palpate.contact.touch_finder import find_touches
from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces import Surface
from palpate.viewer.drawing import box, corners
from palpate.viewer.heat import FineMesh, density, refined
from palpate.viewer.samples import sample_starts, strongest, thinned, totals
from palpate.viewer.timeline import Timeline, downsampled

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, ViserServer

MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100)
_OF_ROBOT = 4  # how many of them for a robot, on which ellipses of several links are seen at once
PLOTTED = 800  # rows of a plot: two a pixel
TRAIL = 300  # samples of a trail
SMALL = 4, 32  # rings of an ellipse's points, the rim the last; points on each: a polygon that nobody sees
LARGE = 8, 64  # the same of an ellipse that is large beside the body
_LARGE = 0.05  # sizes of the body, of the longer half-axis
_LIFT = 5e-3  # sizes of the body by which an ellipse lies above it
_ABOUT = 0.2  # sizes of the body that are shown about a contact
_ROOM = 0.3  # sizes of the body about it for an arrow that is still to come
_SURE = 3.0  # deviations that a torque is from zero before it is drawn
_SAMPLED = 2_000  # contacts that a typical value is taken from
_FEW = 50  # while they come
_STRONG = 0.95  # quantile of what counts as usual
_OUT = 0.05  # sizes of the body that its axes are longer than it
_BEYOND = 0.05  # sizes of the body from an arrow's tail to its label
_OUTERMOST = 200  # directions in which the outline is looked for
_MEDIAN_BEND = 0.6745 * 6**0.5  # median of a - 2 b + c of normal values, in their deviations
_ARROW = 0.35  # sizes of the body that an arrow of a usual force is long


@runtime_checkable
class Layer(Protocol):
    """A sensor's additions to the page, drawn once and then moved: objects, caption lines, controls, pictures."""

    @property
    def covers(self) -> bool:
        """True if the layer hides the body below it, and its heat."""
        ...

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """Points that must be in the picture if the body has no mesh, (k, 3) [m]."""
        ...

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Add the layer's objects to the 3D view of the server or browser, in `Scene.placed` units."""

    def panel(self, gui: GuiApi) -> None:
        """Add controls and pictures to the panel, below the caption."""

    def show(self, scene: Scene, index: int) -> None:
        """Move the layer's objects and pictures to a sample of the scene, or of one with other contacts."""

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return (name, value with unit) pairs, plain text, that go below the contacts in the caption."""
        ...

    def legend(self) -> list[str]:
        """Return the legend of its marks, a list of HTML items as by `palpate.viewer.legend.item`."""
        ...


@runtime_checkable
class MovingBody(Protocol):
    """A layer that is a body with moving parts, which a film draws in place of the scene's body."""

    def body_at(self, index: int) -> FineMesh:
        """Return the body as it is at a sample of the scene."""
        ...


@frozen_value(eq=True)
class ShownContact:
    """A contact as it is drawn and described.

    Attributes:
        identity: number of the contact.
        status: status of the estimate.
        point, normal: (3,) [m] and unit; NaN if there is none.
        force: (3,) [N] on the body.
        torque: [N m] about the normal.
        deviation: (3,) [m] standard deviations of the point along x, y, z; NaN if no noise is known.
        axes: (2,) half-axes [m] of the 95 % ellipse, the longer first; NaN if there is none.
        frame: (3, 3) rotation whose columns are the long axis, the short axis and the normal.
        covariance: (3, 3) [m^2] of the point.
        features: finite values that the sensor adds, by name, in SI units.
        origin: sensor and link of a robot; blank for a rig of one sensor.
    """

    identity: int
    status: Status
    point: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    force: Float[np.ndarray, "3"]
    torque: float
    deviation: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "2"]
    frame: Float[np.ndarray, "3 3"]
    covariance: Float[np.ndarray, "3 3"]
    features: Mapping[str, float]
    origin: Origin = Origin()

    @cached_property
    def located(self) -> bool:
        """True if there is a point to draw."""
        return bool(np.isfinite(self.point).all() and np.isfinite(self.normal).all())

    @cached_property
    def force_deviation(self) -> float:
        """Standard deviation of the force's magnitude [N]; NaN if the sensor does not know it."""
        known = self.features
        if "force_xx" not in known:
            return known.get("force_sd", float("nan"))
        entries = [[known.get(f"force_{min(i, j)}{max(i, j)}", np.nan) for j in "xyz"] for i in "xyz"]
        spread, size = np.array(entries), float(np.linalg.norm(self.force))
        return float(np.sqrt(self.force @ spread @ self.force)) / size if size > 0 else float("nan")


@dataclass(frozen=True)
class SceneMoment:
    """A sample of a scene with its contacts.

    Attributes:
        index: number among the scene's samples.
        sample: row of the log.
        seconds: time since the start [s].
        time: as recorded [s].
        contacts: at least one, the strongest first; its status says if nothing touches.
    """

    index: int
    sample: int
    seconds: float
    time: float
    contacts: tuple[ShownContact, ...]


@frozen_value
class Scene:
    """A body and its contacts over n rows and m samples, prepared so that any moment can be drawn.

    Attributes:
        title: name, such as the log's.
        bounds: (2, 3) [m] corners of the box that is shown.
        body: mesh to draw; None: the layers draw it.
        contacts: in the surface's frame, n rows.
        starts: (m,) first row of each sample.
        touched: (n,) rows that are contacts with a place: answered, or at the sensor's range.
        timeline: times of the samples.
        heat: (v,) time of touch per area at the body's vertices [s/m^2].
        newton: length of an arrow per newton [m].
        magnification: factor by which ellipses are drawn larger, one of `MAGNIFICATIONS`.
        layers: drawings that sensors add.
        surface: the body, on which ellipses are laid; None: they are flat.
        other: scene of other contacts on the same body and clock, for comparison.
    """

    title: str
    bounds: Float[np.ndarray, "2 3"]
    body: FineMesh | None
    contacts: Contacts
    starts: Int[np.ndarray, " m"]
    touched: Bool[np.ndarray, " n"]
    timeline: Timeline
    heat: Float[np.ndarray, " v"]
    newton: float
    magnification: int
    layers: tuple[Layer, ...] = ()
    surface: Surface | None = None
    other: Scene | None = None

    def __len__(self) -> int:
        return len(self.starts)

    @cached_property
    def size(self) -> float:
        """Diagonal of the box that is shown [m]."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @cached_property
    def _middle(self) -> Float[np.ndarray, "3"]:
        return self.bounds.mean(axis=0)

    def placed(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return points (*batch, 3) [m] relative to the scene's middle, over its size.

        Raises:
            InputError: points has another shape.
        """
        return (points - self._middle) / self.size

    @cached_property
    def strongest(self) -> Int[np.ndarray, " m"]:
        """Row of each sample's strongest contact, (m,)."""
        return strongest(self.contacts, self.starts)

    @cached_property
    def total(self) -> Float[np.ndarray, " m"]:
        """Sum of the magnitudes of each sample's forces, (m,) [N]."""
        return totals(self.contacts, self.starts)

    @property
    def several(self) -> bool:
        """True if some sample has more than one contact."""
        return len(self.starts) < len(self.contacts)

    @cached_property
    def opening(self) -> int:
        """Number of the sample shown first: that of the strongest contact."""
        force = np.linalg.norm(self.contacts.force[self.strongest], axis=1)
        return int(np.where(self.touched[self.strongest] & np.isfinite(force), force, -1.0).argmax())

    @cached_property
    def torque(self) -> float:
        """Usual size of the torque about the normal [N m], its 95 % quantile; 0 if none is known."""
        torque = np.abs(self.contacts.torque[np.isfinite(self.contacts.torque)])
        return float(np.quantile(torque, _STRONG)) if len(torque) else 0.0

    @cached_property
    def touches(self) -> Events:
        """Touches as `Events`, numbered as in `palpate events` and the report."""
        return find_touches(self.contacts)

    @cached_property
    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outermost points of the body, or of the layers' places, (k, 3) [m]."""
        if self.body is None:
            return corners(self.bounds)
        return self.body.vertices[np.unique((self.body.vertices @ _directions().T).argmax(axis=0))]

    @cached_property
    def axes(self) -> Float[np.ndarray, "3 2 3"]:
        """Ends of the axes of the surface's frame, beyond the body, (3, 2, 3) [m]."""
        ends = np.diag(np.maximum(self.bounds[1], 0.0) + _OUT * self.size)
        return np.stack([np.zeros((3, 3)), ends], axis=1)

    def seen_with(self, contacts: Sequence[ShownContact]) -> Float[np.ndarray, "k 3"]:
        """Return points of the body and of the contacts' arrows, (k, 3) [m]; without arrows, with room for some."""
        tails = self._tails(contacts)
        room = corners(self.bounds + _ROOM * self.size * np.array([[-1.0], [1.0]]))
        axes = np.clip(self.axes[:, 1], room.min(axis=0), room.max(axis=0))  # a frame may be far from its body
        return np.concatenate([self.outline, axes, tails if len(tails) else room])

    def seen_near(self, contact: ShownContact) -> Float[np.ndarray, "k 3"]:
        """Return points of a located contact's arrow and surroundings, (k, 3) [m]."""
        about = contact.point + _ABOUT * self.size * np.array([[-1.0] * 3, [1.0] * 3])
        return np.concatenate([corners(about), self._tails([contact])])

    def _tails(self, contacts: Sequence[ShownContact]) -> Float[np.ndarray, "k 3"]:
        """Return the places of the arrows' labels, (k, 3) [m]."""
        known = [each for each in contacts if each.located and np.isfinite(each.force).all()]
        return np.array([self.labelled(each) for each in known]).reshape(-1, 3)

    def labelled(self, contact: ShownContact) -> Float[np.ndarray, "3"]:
        """Return the place of a located contact's label, beyond its arrow's tail, (3,) [m]."""
        length = float(np.linalg.norm(contact.force))
        beyond = _BEYOND * self.size / length if length > 0 else 0.0
        return contact.point - (self.newton + beyond) * contact.force

    @cached_property
    def torque_noise(self) -> float:
        """Standard deviation of the torque about a line through its neighbours [N m]; 0 if not known."""
        torque = self.contacts.torque[self.strongest[self.timeline.in_touch]]
        bends = np.abs(np.diff(torque, 2))
        bends = bends[np.isfinite(bends)]
        return float(np.median(bends)) / _MEDIAN_BEND if len(bends) else 0.0

    def turning(self, contact: ShownContact) -> float:
        """Return a contact's torque as a share of the usual torque; 0 if it does not exceed three times its noise.

        Noise is that from sample to sample, and n . (dp x f) of the place's error, with the variance v' C v, v = f x n.
        """
        lever = np.cross(contact.force, contact.normal)
        spread = float(lever @ np.nan_to_num(contact.covariance) @ lever)
        noise = float(np.sqrt(max(spread, 0.0) + self.torque_noise**2))
        sure = abs(contact.torque) > _SURE * noise and self.torque > 0  # NaN is not
        return contact.torque / self.torque if sure else 0.0

    @cached_property
    def turns(self) -> bool:
        """True if the torque is drawn during some touch."""
        return any(self.turning(self.at(k).contacts[0]) for k in thinned(self.timeline.touches, _FEW).tolist())

    def ready(self) -> None:
        """Compute what the first picture needs: touches, outline, turns, totals, machine code."""
        _ = (self.touches, self.outline, self.turns, self.total)
        opening = self.at(self.opening).contacts[0]
        if opening.located and np.isfinite(opening.axes).all():
            self.ellipse_on_body(opening, 1)  # loads machine code

    def copied(self) -> Scene:
        """Return a copy whose layers can be drawn for another browser; computed values are kept."""
        made = copy(self)
        object.__setattr__(made, "layers", tuple(copy(layer) for layer in self.layers))
        return made

    def with_contacts(self, contacts: Contacts) -> Scene:
        """Return the `Scene` with other contacts, at least one row."""
        starts, touched, timeline = _sampled(contacts)
        return replace(self, contacts=contacts, starts=starts, touched=touched, timeline=timeline)

    def compared(self, contacts: Contacts, title: str) -> Scene:
        """Return the `Scene` with other contacts for comparison.

        Args:
            contacts: on the same clock, at least one row.
            title: name of these contacts.

        Raises:
            InputError: the two have no time in common.
        """
        other = replace(self.with_contacts(contacts), title=title)
        if not self._ahead(other) <= self.timeline.duration or self._ahead(other) + other.timeline.duration < 0:
            raise InputError(f"has no time in common with {self.title}, so they cannot be compared.", where=title)
        return replace(self, other=other)

    def meanwhile(self, seconds: float) -> SceneMoment | None:
        """Return the `SceneMoment` of `other` at a time [s] since the start of these contacts; None without `other`."""
        other = self.other
        return None if other is None else other.at(other.timeline.at(seconds - self._ahead(other)))

    def seconds_at(self, time: float) -> float:
        """Convert a recorded time [s] to seconds since the first known time of the contacts."""
        return time - self._began

    def _ahead(self, other: Scene) -> float:
        """Return by how many seconds another's clock starts later."""
        return other._began - self._began

    @cached_property
    def _began(self) -> float:
        """First known time as recorded [s]; 0 where none is known."""
        known = self.contacts.time[np.isfinite(self.contacts.time)]
        return float(known[0]) if len(known) else 0.0

    def scaled(self) -> Scene:
        """Return the `Scene` with arrows and ellipses scaled to its contacts; without contacts itself."""
        shown = self.contacts[thinned(np.flatnonzero(self.touched), _FEW)]
        if not len(shown):
            return self
        return replace(self, newton=_newton(self.size, shown), magnification=_magnified(self.size, shown, self.layers))

    def scaled_to(self, force: float) -> Scene:
        """Return the `Scene`, with an arrow of 0.35 of the body's size for a force [N] whose arrow would exceed it."""
        return replace(self, newton=_ARROW * self.size / force) if force * self.newton > self.size else self

    def rows(self, index: int) -> slice:
        """Return the rows of a sample as a slice."""
        end = self.starts[index + 1] if index + 1 < len(self.starts) else len(self.contacts)
        return slice(int(self.starts[index]), int(end))

    def at(self, index: int) -> SceneMoment:
        """Return the `SceneMoment` of a sample, by its number in the scene."""
        return _moment(self.contacts, self.rows(index), index, float(self.timeline.clock[index]))

    def ellipse_on_body(self, contact: ShownContact, magnification: int) -> Float[np.ndarray, "k 3"]:
        """Return points of a located contact's 95 % ellipse, (k, 3) [m], laid on the body.

        The points of a `disc` in the tangent plane are moved to the nearest point of the surface, and as far above it
        as the contact point is, such as on a skin.
        """
        axes = np.minimum(magnification * contact.axes, 2.0 * self.size)
        within = disc(*(LARGE if axes[0] > _LARGE * self.size else SMALL))
        flat = contact.point + (within * axes) @ contact.frame[:, :2].T
        if self.surface is None:
            return flat + _LIFT * self.size * contact.normal
        points, normals, _ = self.surface.project(flat)
        above = max(0.0, float((contact.point - points[0]) @ normals[0]))  # the first point is the middle
        return points + (above + _LIFT * self.size) * normals

    def _total_beside(self, clock: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the compared contacts' total force at times since the start, (k,) [N]; NaN elsewhere."""
        if (other := self.other) is None:
            return np.full(len(clock), np.nan)
        seconds = clock - self._ahead(other)
        at = np.searchsorted(other.timeline.clock, seconds + 1e-9, side="right") - 1
        return np.where((at >= 0) & (seconds <= other.timeline.duration + 1e-9), other.total[np.maximum(at, 0)], np.nan)

    @property
    def moving(self) -> MovingBody | None:
        """The layer that is a body with moving parts, on which past places say little; None: there is none."""
        return next((layer for layer in self.layers if isinstance(layer, MovingBody)), None)

    def trail(self, index: int, seconds: float) -> tuple[Float[np.ndarray, "k 2 3"], Float[np.ndarray, " k"]]:
        """Return the contacts' paths in the last seconds: segments (k, 2, 3) [m], and ages (k,), 0 now, 1 oldest."""
        now = self.timeline.clock[index]
        first = self.timeline.span(now - seconds, now).start
        stride = max(1, -(-(index - first) // TRAIL))
        picked = index - stride * np.arange((index - first) // stride + 1, dtype=np.int64)[::-1]
        ends = np.append(self.starts, len(self.contacts))
        count = ends[picked + 1] - ends[picked]
        turn = np.repeat(np.arange(len(picked)), count)  # which of the picked samples
        rows = np.arange(len(turn)) + np.repeat(ends[picked] - np.cumsum(count) + count, count)
        turn, rows = turn[self.touched[rows]], rows[self.touched[rows]]
        identity = self.contacts.identity[rows]
        order = np.lexsort((turn, identity))
        before, after = order[:-1], order[1:]
        joined = (identity[before] == identity[after]) & (turn[before] + 1 == turn[after])
        before, after = before[joined], after[joined]
        latest = np.argsort(turn[after], kind="stable")
        both = np.stack([rows[before[latest]], rows[after[latest]]], axis=1)
        points = self.contacts.point[both] + 2e-3 * self.size * self.contacts.normal[both]
        age = (now - self.timeline.clock[picked[turn[after[latest]]]]) / max(seconds, 1e-9)
        return points, age

    def curves(self, window: slice | None = None) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 5"]]:
        """Return times [s], (k,), and two forces [N] and x, y, z [mm] of the strongest contact, (k, 5).

        The second force is that of the strongest contact; the first its part along the normal, the sum of all if there
        are several, or the sum of the compared contacts' forces.

        Args:
            window: slice of samples; None: all.
        """
        picked = slice(None) if window is None else window
        rows, found = self.strongest[picked], self.contacts
        force = found.force[rows]
        first = self.total[picked] if self.several else -np.sum(force * found.normal[rows], axis=1)
        if self.other is not None:
            first = self._total_beside(self.timeline.clock[picked])
        values = np.column_stack([first, np.linalg.norm(force, axis=1), 1e3 * found.point[rows]])
        values[~self.touched[rows], 2:] = np.nan
        return downsampled(self.timeline.clock[picked], values, PLOTTED)


def prepare(surface: Surface | None, contacts: Contacts, title: str = "", layers: Sequence[Layer] = ()) -> Scene:
    """Return a `Scene` of contacts in the surface's frame.

    Args:
        surface: the body; None: the layers show it.
        contacts: at least one row.
        title: name of the scene.
        layers: drawings that sensors add.

    Raises:
        InputError: there are no rows.
        GeometryError: an implicit surface cannot be drawn as a mesh.
    """
    if not len(contacts):
        raise InputError("contains no samples, so there is nothing to show.", where=title)
    starts, touched, timeline = _sampled(contacts)
    points = contacts.point[touched]
    mesh = None if surface is None else surface.drawn()
    bounds = box(np.concatenate([points, *(layer.places for layer in layers)])) if mesh is None else mesh.bounds
    size = float(np.linalg.norm(bounds[1] - bounds[0]))
    body, heat = None, np.zeros(0)
    if mesh is not None:
        width = _width(size, points)
        body = refined(mesh, np.unique((points / width).round(), axis=0) * width, width)
        seconds = np.repeat(timeline.seconds, np.diff(starts, append=len(contacts)))
        heat = density(body, points, contacts.normal[touched], seconds[touched], width)
    shown = contacts[thinned(np.flatnonzero(touched), _SAMPLED)]
    newton, magnification = _newton(size, shown), _magnified(size, shown, layers)
    return Scene(
        title, bounds, body, contacts, starts, touched, timeline, heat, newton, magnification, tuple(layers), surface
    )


def moment_of(found: Contacts) -> SceneMoment:
    """Return the `SceneMoment` of contacts of one sample, without a scene."""
    return _moment(found, slice(0, len(found)), 0, 0.0)


def _moment(found: Contacts, rows: slice, index: int, seconds: float) -> SceneMoment:
    """Return the moment of the rows of one sample."""
    order = np.argsort(-np.linalg.norm(found.force[rows], axis=1), kind="stable")  # NaN last
    first = rows.start
    shown = tuple(_shown(found, first + k) for k in order.tolist())
    return SceneMoment(index, int(found.sample[first]), seconds, float(found.time[first]), shown)


def _shown(found: Contacts, row: int) -> ShownContact:
    axes, frame = ellipse(found.covariance[row], found.normal[row])
    features = {name: float(values[row]) for name, values in found.features.items()}
    return ShownContact(
        identity=int(found.identity[row]),
        status=Status(int(found.status[row])),
        point=found.point[row],
        normal=found.normal[row],
        force=found.force[row],
        torque=float(found.torque[row]),
        deviation=np.sqrt(np.maximum(np.diag(found.covariance[row]), 0.0)),
        axes=axes,
        frame=frame,
        covariance=found.covariance[row],
        features={name: value for name, value in features.items() if np.isfinite(value)},
        origin=Origin() if found.origins is None else found.origins.among[int(found.origins.index[row])],
    )


@cache
def disc(rings: int, around: int) -> Float[np.ndarray, "k 2"]:
    """Return points of the unit disc, (1 + rings * around, 2): the middle, then ring after ring, the rim last."""
    turn = 2 * np.pi * np.arange(around) / around
    share = np.arange(1, rings + 1)[:, None] / rings
    points = np.stack([share * np.cos(turn), share * np.sin(turn)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), points.reshape(-1, 2)])


def rim(count: int) -> int:
    """Return how many of an ellipse's `count` points, the last ones, are on its rim: 32 or 64."""
    return next(around for rings, around in (SMALL, LARGE) if count == 1 + rings * around)


def no_contacts() -> Contacts:
    """Return `Contacts` of one sample without a contact, for a scene that waits for its first."""
    row = np.zeros((1, ROW.length))
    row[:, : ROW.torque], row[:, ROW.covariance] = np.nan, np.nan
    row[:, ROW.status] = Status.NO_CONTACT
    return Contacts.single(np.zeros(1), ContactEstimate.from_rows(row))


@takes_arrays
def before(normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the unit direction (3,) from which to see a contact: in front, somewhat aside and above.

    Raises:
        InputError: normal has another shape.
    """
    way = normal + 0.5 * np.cross([0.0, 0.0, 1.0], normal) + [0.0, 0.0, 0.4]
    way = way if np.hypot(way[0], way[1]) > 0.3 else way + np.array([0.35, -0.45, 0.0])
    length = float(np.linalg.norm(way))
    return way / length if length > 0.1 else normal


def rounded_up(value: float) -> float:
    """Return the smallest of 1, 2, 5, 10, ... (times powers of ten) that is not less than `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9)))


def _sampled(contacts: Contacts) -> tuple[Int[np.ndarray, " m"], Bool[np.ndarray, " n"], Timeline]:
    """Return the first row of each sample, the rows with a place, and the timeline."""
    starts = sample_starts(contacts)
    touched = contacts.located & (contacts.answered | (contacts.status == Status.SATURATED))
    return starts, touched, Timeline.of(contacts.time[starts], np.logical_or.reduceat(touched, starts))


def _newton(size: float, shown: Contacts) -> float:
    """Return the length of an arrow per newton [m]."""
    strong = float(np.nanquantile(np.linalg.norm(shown.force, axis=1), _STRONG)) if len(shown) else 1.0
    return _ARROW * size / max(strong, 1e-9)


@cache
def _directions() -> Float[np.ndarray, "k 3"]:
    """Return unit vectors that are evenly spread over the sphere."""
    rise = np.linspace(-1.0, 1.0, _OUTERMOST)
    turn, flat = np.pi * (1.0 + 5.0**0.5) * np.arange(_OUTERMOST), np.sqrt(1.0 - rise**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), rise], axis=1)


def _width(size: float, points: Float[np.ndarray, "n 3"]) -> float:
    """Return the width of the spot that a touch leaves [m]."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else size
    return float(np.clip(extent / 40, size / 300, size / 50))


def _magnified(size: float, shown: Contacts, layers: Sequence[Layer]) -> int:
    among = MAGNIFICATIONS[:_OF_ROBOT] if any(isinstance(each, MovingBody) for each in layers) else MAGNIFICATIONS
    axes = ellipse(shown.covariance, shown.normal)[0][:, 0]
    axes = axes[axes > 0]
    wanted = size / 25 / float(np.median(axes)) if len(axes) else 1.0
    return next((times for times in among if times >= wanted), among[-1])
