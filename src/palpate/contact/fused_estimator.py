"""A skin says where contacts are, a force/torque sensor what they sum up to: each contact with its force in 3-D."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from numpy.typing import ArrayLike

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.contact.estimator import NOTHING_BESIDE, instant, rows_of, samples
from palpate.contact.fused import FusedFrames, FusedLocator
from palpate.contact.locate import Locator
from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.contact.zero_follower import ZeroFollower
from palpate.contact.zero_gate import ContactShape
from palpate.errors import InputError
from palpate.sensors.compensation import Compensation
from palpate.sensors.drift import Drift
from palpate.sensors.filters import Filter
from palpate.sensors.recording import AVERAGED, CELLS, FORCE, TORQUE, Recording, apart
from palpate.sensors.smoothing import BothWays, Forward, known_rate, require_forward
from palpate.sensors.wrench_sensor import Measured, Placement, Tare, WrenchSensor
from palpate.sensors.zero_filter import FollowedSensor, ZeroHistory
from palpate.spatial._arrays import require_out, shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

__all__ = ["FEATURES", "FusedEstimator"]

FEATURES = (
    "share",
    "bound",
    "unexplained",
    "belief",
    "force_xx",
    "force_xy",
    "force_xz",
    "force_yy",
    "force_yz",
    "force_zz",
)
SHARE, BOUND, UNEXPLAINED, BELIEF, SPREAD = range(5)  # where they stand behind the skin's
LOOKS = 0.1  # s after which the place of what the skin does not feel is looked for again: that takes milliseconds
PERSISTS = 0.05  # s that something must be unexplained before it is a contact: a touch that begins is felt first
AGREES = 0.8  # of the frames with a contact may be unexplained before that is a doubt
ENOUGH = 50  # frames with a contact, for doubts


class FusedEstimator:
    """The `ContactEstimator` of a skin and a force/torque sensor on one link.

    Each frame of the skin gives places, normals and normal forces, the wrench at that time what they sum up to
    (`FusedLocator`). A frame without a wrench keeps the skin's forces, with `share` 1. What the skin cannot explain
    for 50 ms is one more contact, of identity 0, at the place that is believed most.

    Features, behind those of the skin: `share`, the posterior over the prior deviation of a contact's force: 1 where
    the wrench says nothing of it; `bound`, 1 where its friction cone binds; `unexplained`, the probability of a wrench
    as far from what the skin feels as this one, where the skin feels all; `belief` in the place of a contact, 1 where
    the skin feels it, else of all places about it; `force_xx` ... `force_zz` [N^2], the covariance of the force.

    Args:
        taxels: of the skin; its filter smooths the wrenches too.
        sensor: of wrenches.
        fused: on the surface, in the surface's frame, which is the skin's too.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
        drift: how the sensor's zero wanders: it is followed while neither skin nor wrench tells of a contact.
        covered: the body is touched nowhere but on the skin, so that where this feels nothing, nothing touches.
        live: for samples as they come. False is for logs: in `pairs` and `stream` the zero is smoothed by what comes
            after a touch, for which blocks wait 10 minutes at most.

    Attributes:
        kelvin: as of `WrenchEstimator`.
    """

    channels = (CELLS, FORCE, TORQUE, AVERAGED)

    @takes_arrays
    def __init__(
        self,
        taxels: TaxelEstimator,
        sensor: WrenchSensor,
        fused: FusedLocator,
        mount: Pose | None = None,
        mount_covariance: Float[np.ndarray, "6 6"] | None = None,
        drift: Drift | None = None,
        covered: bool = False,
        live: bool = True,
    ) -> None:
        noise = sensor.noise
        if noise is None:
            raise InputError(
                "fusing a skin with wrenches needs the noise of the wrenches.",
                where="force_torque.noise",
                hint="State it in the rig, or use a log that begins untouched.",
            )
        self.taxels, self.sensor, self.fused = taxels, sensor, fused
        self.mount = Pose.identity() if mount is None else mount
        self.features = (*taxels.features, *FEATURES)
        self._placement = Placement(self.mount, mount_covariance)
        self._filter, self._forward = taxels.filter, None
        recursion = None if self._filter is None else self._filter.recursion(known_rate(taxels.rate, "frames"))
        if recursion is not None and isinstance(sensor, Compensation):
            both = BothWays(recursion, known_rate(taxels.rate, "frames")).least if self._zero_phase else None
            sensor.smoothed_by(self._filter, taxels.rate, recursion.share.min() if both is None else both)
        if recursion is not None and not self._zero_phase:
            self._forward = Forward(recursion, known_rate(taxels.rate, "frames"))
        self._covered, self.kelvin = covered, np.nan
        self._follower = self._teller = None if drift is None else self._follows(drift, noise)
        self._behind = None if drift is None or live else self._follows(drift, noise, smooth=True)
        self._rows = taxels.empty(taxels.most)
        self.reset()

    @property
    def most(self) -> int:
        """Contacts of one frame: those that the skin feels, and one that it does not."""
        return self.taxels.most + 1

    @property
    def _zero_phase(self) -> bool:
        return self._filter is not None and self._filter.zero_phase

    def empty(self, *batch: int) -> Float[np.ndarray, "*batch w"]:
        """Rows for `update_into`: `contact.estimate.ROW`, then `features`, then the identity."""
        return np.zeros((*batch, ROW.length + len(self.features) + 1))

    def reset(self) -> None:
        """Forget what frames left; not the tares."""
        self.taxels.reset()
        self.sensor.reset()
        if self._forward is not None:
            self._forward.reset()
        if self._follower is not None:
            self._follower.reset()
        self._teller = self._follower
        self._noted = dict[str, None]()
        self._since = self._looked = np.nan  # [s] when the wrench began to be unexplained, and its place was looked for
        self._place: _Place | None = None
        self._frames = self._missing = self._touched = self._unexplained = self._opposed = 0

    def tare(self, recording: Recording) -> Tare:
        """Take what both read at rest off from now on.

        Raises:
            InputError: too few frames, or not steady: what was seen.
        """
        wrench = self.sensor.tare(recording)
        cells = self.taxels.tare(recording)
        self.reset()
        doubt = "; ".join(each.doubt for each in (wrench, cells) if each.doubt)
        return Tare(f"{wrench.said}; {cells.said}", doubt)

    def run(self, recording: Recording) -> Contacts:
        """The contacts of a block, at least one row a frame.

        Raises:
            InputError: a channel is missing or of another size, or the filter looks ahead.
        """
        require_forward(self._filter)
        return self._joined(self.taxels.run(recording), recording)

    def pairs(
        self, blocks: Iterable[Recording], forces: Callable[[np.ndarray], None] | None = None
    ) -> Iterator[tuple[Recording, Contacts]]:
        """Each block with its contacts, in order, as soon as they are known; see `TaxelEstimator.pairs`."""
        first, ready = 0, self.sensor.ready(blocks)
        if self._behind is not None:
            yield from self._both_sides(self._behind, self.taxels.pairs(ready, forces))
            return
        beside = _Beside(self.sensor, self._filter, self.taxels.rate) if self._filter and self._zero_phase else None
        for block, found in self.taxels.pairs(ready if beside is None else beside.measured(ready), forces):
            yield block, self._joined(found, block, first, None if beside is None else beside.taken())
            first += len(block)

    def stream(self, blocks: Iterable[Recording]) -> Iterator[Contacts]:
        """The contacts of `pairs` alone."""
        return (found for _, found in self.pairs(blocks))

    def update(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Contacts:
        """The contacts of one frame.

        Args:
            time: [s] on the clock of the frames.
            reading: (k + 7,): the cells row by row, force [N] and torque [N m] as measured, NaN where there is none,
                and of how many readings they are the mean (1; 0: interpolated).
            rotation: (3, 3) sensor in base, where the payload needs it.
            acceleration: (3,) [m/s^2] of the sensor's origin in its own frame; None: at rest.

        Raises:
            InputError: the reading has another shape, the rest is not known, or the filter looks ahead.
        """
        rows, time = self.empty(self.most), instant(time)
        rows = rows[: self.update_into(time, reading, rows, rotation, acceleration)]
        count = len(rows)
        return Contacts.of_rows(np.zeros(count, np.int64), np.full(count, time, np.float64), rows, self.features)

    def update_into(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows w"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """`update` into rows of `empty`: how many are written, at least 1, as many as fit."""
        require_forward(self._filter)
        width = len(self.taxels.body) + 7
        values, time = shaped(reading, (width,), "reading"), instant(time)
        out = rows_of(out, ROW.length + len(self.features) + 1)
        cells, wrench, averaged = values[:-7], values[-7:-1], values[-1:]
        count = self.taxels.update_into(time, cells, self._rows)
        follower = self._entered(time, self.kelvin)
        measured = self.sensor.single(time, wrench, rotation, acceleration)
        located, skin = self._placed(measured, averaged), self._rows[:count]
        if follower is not None:
            kept = follower.sensor.kept_of(follower.sensor.held, 1)
            follower.add(time, kept, self._told(skin))
        rows, _ = self._framed(np.array([time]), skin, np.array([count]), located)
        count = min(len(rows), len(out))
        out[:count] = rows[:count]
        return count

    def run_into(
        self,
        time: ArrayLike,
        readings: ArrayLike,
        out: Float[np.ndarray, "rows width"],
        counts: Int[np.ndarray, " n"],
        beside: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    ) -> int:
        """`run` of arrays; see `ContactEstimator` and, for what a reading is, `update`."""
        require_forward(self._filter)
        require_out(out, (None, ROW.length + len(self.features) + 1))
        time, readings, beside = samples(time, readings, counts, beside)
        done = used = 0
        while done < len(time) and len(out) - used >= self.most:
            one = slice(done, done + 1)
            channels = apart(self.channels, readings[one])
            kept = {name: values[one] for name, values in beside.items()}
            block = Recording(time[one], {**channels, **kept}, source="the stream")
            self.taxels.run_into(block.time, channels[CELLS], self._rows, counts[one])
            skin = self._rows[: int(counts[done])]
            follower = self._entered(float(time[done]), ZeroFollower.kelvin(kept))
            located = self._wrenches(block)
            if follower is not None:
                follower.add(block.time, follower.sensor.kept(block), self._told(skin))
            rows, counts[one] = self._framed(block.time, skin, counts[one], located)
            out[used : used + len(rows)] = rows
            used += len(rows)
            done += 1
        return done

    def notes(self) -> tuple[str, ...]:
        """What was met so far, one sentence each."""
        said = [*self._noted, *self.taxels.notes(), *self.sensor.notes()]
        said += [] if self._teller is None else self._teller.notes()
        if self._missing:
            said.append(
                f"{self._missing} of {self._frames} frames have no wrench: their forces are the skin's alone (share 1)"
            )
        return tuple(said)

    def doubts(self) -> tuple[str, ...]:
        """What may be wrong: the skin and the wrench that do not belong together."""
        said = [*self.taxels.doubts(), *self.sensor.doubts()]
        said += [] if self._teller is None else self._teller.doubts()
        if self._touched >= ENOUGH and self._opposed > AGREES * self._touched:
            said.append(
                f"the wrench points against what the skin feels in {self._opposed} of {self._touched} frames with a "
                "contact: is it the reaction (axes, left_handed), or of the other end of the link?"
            )
        elif self._touched >= ENOUGH and self._unexplained > AGREES * self._touched:
            said.append(
                f"in {self._unexplained} of {self._touched} frames with a contact the wrench is not that of what the "
                "skin feels: are skin map, surface.pose, clocks and units of one link?"
            )
        return tuple(said)

    def zero_history(self) -> ZeroHistory | None:
        """How the zero of the wrenches went; None where it is not followed."""
        return None if self._teller is None else self._teller.history()

    def _follows(self, drift: Drift, noise: Float[np.ndarray, "6 6"], smooth: bool = False) -> ZeroFollower:
        """What follows the zero of the wrenches, from its tare on."""
        if not isinstance(self.sensor, FollowedSensor):
            raise InputError("the zero of this sensor cannot be followed.", where="drift")
        if self._zero_phase:
            raise InputError(
                "the zero beside a skin is followed as samples come, and a filter of zero phase looks ahead.",
                where="drift",
                hint="Use a Butterworth filter without zero_phase, or none.",
            )
        matrix = self._placement.matrix
        locator = Locator(self.fused.surface, friction=self.fused.settings.friction, noise=matrix @ noise @ matrix.T)
        return ZeroFollower(self.sensor, drift, ContactShape(locator, self._placement), smooth=smooth)

    def _entered(self, time: float, kelvin: float) -> ZeroFollower | None:
        """What follows the zero, told that samples of this time come next."""
        if self._follower is not None:
            self._follower.enter(time, kelvin)
        return self._follower

    def _told(self, skin: Float[np.ndarray, "n v"]) -> bool | None:
        """What the skin says of whether something touches."""
        if np.isfinite(skin[:, ROW.point]).all(axis=1).any():
            return True
        return False if self._covered else None

    def _wrenches(self, recording: Recording) -> _Located:
        """In the surface's frame, with covariances and statuses; NaN where there is none."""
        return self._placed(self.sensor.measure(recording), recording.channels[AVERAGED][:, 0])

    def _placed(
        self,
        measured: Measured,
        averaged: Float[np.ndarray, " n"],
        smoothed: _Smoothed | None = None,
    ) -> _Located:
        wrenches, share = measured.wrench, 1.0 / np.maximum(np.nan_to_num(averaged, nan=1.0), 1.0)
        if smoothed is not None:
            wrenches, share = smoothed[0], share * smoothed[1]
        elif self._forward is not None:
            share = share * self._forward.share(self._forward(measured.time, measured.status, wrenches))
        located, covariances = self.sensor.place(measured, wrenches, share, self._placement)
        if covariances is None:
            raise InputError("fusing needs the noise of the wrenches.", where="force_torque.noise")
        return located, covariances, measured.status

    def _joined(self, found: Contacts, block: Recording, first: int = 0, smoothed: _Taken | None = None) -> Contacts:
        """Contacts of the skin with the wrenches of their frames, in pieces where the zero is followed."""
        made = list[_Framed]()
        for cut in self._cuts(found, block, first):
            piece = cut.samples
            follower = self._entered(float(piece.time[0]), ZeroFollower.kelvin(piece.channels)) if len(piece) else None
            located = self._wrenches(piece) if smoothed is None else self._placed(*smoothed)
            if follower is not None:
                follower.add(piece.time, follower.sensor.kept(piece), self._told(cut.skin))
            made.append(self._framed(piece.time, cut.skin, cut.counts, located))
        return self._contacts(made, block, first)

    def _both_sides(
        self, follower: ZeroFollower, pairs: Iterable[tuple[Recording, Contacts]]
    ) -> Iterator[tuple[Recording, Contacts]]:
        """Blocks of a log with the zero that was found from both sides."""
        follower.reset()
        self._teller, made, first = follower, list[_Framed](), 0

        def cuts() -> Iterator[_Cut]:
            begin = 0
            for block, found in pairs:
                yield from self._cuts(found, block, begin)
                begin += len(block)

        for cut, zero in follower.both_sides((cut.samples, self._told(cut.skin), cut) for cut in cuts()):
            if zero is not None:
                follower.sensor.follow(zero)
            made.append(self._framed(cut.samples.time, cut.skin, cut.counts, self._wrenches(cut.samples)))
            if cut.block is not None:
                yield cut.block, self._contacts(made, cut.block, first)
                first, made = first + len(cut.block), []

    def _cuts(self, found: Contacts, block: Recording, first: int) -> Iterator[_Cut]:
        """A block in pieces of one window of the zero, where it is followed."""
        skin = found.rows()
        edges = np.searchsorted(found.sample - first, np.arange(len(block) + 1))
        followed = self._follower is not None and len(block) > 0
        cuts = list(ZeroFollower.pieces(block.time)) if followed else [slice(0, len(block))]
        for cut in cuts:
            part = edges[cut.start : cut.stop + 1]
            yield _Cut(block.picked(cut), skin[part[0] : part[-1]], np.diff(part), block if cut is cuts[-1] else None)

    def _contacts(self, made: list[_Framed], block: Recording, first: int) -> Contacts:
        counts = np.concatenate([np.zeros(0, np.int64), *(each for _, each in made)])
        sample, time = first + np.repeat(np.arange(len(block)), counts), np.repeat(block.time, counts)
        return Contacts.of_rows(
            sample, time, np.concatenate([self.empty(0), *(rows for rows, _ in made)]), self.features
        )

    def _framed(
        self,
        time: Float[np.ndarray, " n"],
        skin: Float[np.ndarray, "r v"],
        counts: Int[np.ndarray, " n"],
        located: _Located,
    ) -> _Framed:
        """Return the rows of frames: the skin's, `counts` of each, then one of what it does not feel; and how many."""
        wrenches, covariances, status = located
        frame = np.repeat(np.arange(len(counts)), counts)
        touching = np.asarray(np.isfinite(skin[:, ROW.point]).all(axis=1))
        felt = skin[np.cumsum(counts) - counts, ROW.status] != Status.INVALID
        usable = (status < 0) & np.isfinite(wrenches).all(axis=1)
        pressed = np.bincount(frame[touching], minlength=len(counts))
        contacts = self._pressing(skin[touching])
        known = np.where((felt & usable)[:, None], wrenches, np.nan)
        fused = self.fused.fuse_frames(contacts, pressed, known, covariances)
        self._noted |= dict.fromkeys(fused.notes)
        self._frames += len(counts)
        self._missing += int(np.count_nonzero(~usable))
        self._judge(skin[touching, ROW.force], frame[touching], wrenches, usable & (pressed > 0), fused.alarm)
        after = ROW.length + len(self.taxels.features)
        rows = np.full((len(skin), after + len(FEATURES) + 1), np.nan)
        rows[:, :after], rows[:, -1] = skin[:, :-1], skin[:, -1]
        rows[touching, after + UNEXPLAINED], rows[touching, after + BELIEF] = fused.p[frame[touching]], 1.0
        _write(fused, rows, touching, after)
        alone = touching & ~usable[frame]
        rows[alone, ROW.force] = skin[alone, ROW.force]
        found = self._unseen(time, felt & (usable | (pressed > 0)), usable, fused)
        if not found:
            return rows, counts
        more = np.isin(np.arange(len(counts)), list(found))
        within, ends, instead = more[frame], np.cumsum(counts)[more], more & (pressed == 0)
        kept = np.insert(~instead[frame], ends, True)  # not the row that says that there is no contact
        new = np.array([place.row for place in found.values()])
        new[:, after + UNEXPLAINED] = fused.p[more]
        rows = np.insert(rows, ends, new, axis=0)[kept]
        new = [place.contact for place in found.values()]
        contacts = np.insert(contacts[within[touching]], np.cumsum(pressed[more]), new, axis=0)
        fused = self.fused.fuse_frames(contacts, pressed[more] + 1, wrenches[more], covariances[more])
        self._noted |= dict.fromkeys(fused.notes)
        pushed = np.insert(touching & within, ends, True)[kept]
        _write(fused, rows, pushed, after)
        return rows, np.where(instead, 0, counts) + more

    def _pressing(self, skin: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n 17"]:
        """Return contacts of the skin as `fused` takes them."""
        normals, status = skin[:, ROW.normal], skin[:, ROW.status]
        normal = np.maximum(-np.sum(normals * skin[:, ROW.force], axis=1), 0.0)
        deviations = np.where(status == Status.SATURATED, np.maximum(normal, 1.0), 0.0)
        spreads = np.nan_to_num(skin[:, ROW.covariance].reshape(-1, 3, 3))
        return self.fused.rows(skin[:, ROW.point], normals, normal, deviations, spreads)

    def _judge(
        self,
        forces: Float[np.ndarray, "m 3"],
        frame: Int[np.ndarray, " m"],
        wrenches: Float[np.ndarray, "n 6"],
        touched: Bool[np.ndarray, " n"],
        alarm: Bool[np.ndarray, " n"],
    ) -> None:
        """Count the frames in which skin and wrench disagree, for doubts."""
        total = np.zeros((len(wrenches), 3))
        np.add.at(total, frame, forces)
        unexplained = touched & alarm
        opposed = unexplained & (np.sum(total * wrenches[:, :3], axis=1) < 0.0)
        self._touched += int(np.count_nonzero(touched))
        self._unexplained += int(np.count_nonzero(unexplained))
        self._opposed += int(np.count_nonzero(opposed))

    def _unseen(
        self,
        time: Float[np.ndarray, " n"],
        reporting: Bool[np.ndarray, " n"],
        usable: Bool[np.ndarray, " n"],
        fused: FusedFrames,
    ) -> dict[int, _Place]:
        """Return frames in which something lasts that the skin does not feel, with its place, looked for now and then.

        `reporting`: frames in which skin or wrench have something to say.
        """
        found = dict[int, _Place]()
        for k, now in enumerate(time.tolist()):
            if not reporting[k]:
                self._since = np.nan
            elif usable[k] and self._persists(now, bool(fused.alarm[k])):
                if self._place is None or not now - self._looked < LOOKS:
                    self._place, self._looked = self._looked_for(fused.whitened[k], fused.factors[k]), now
                found[k] = self._place
        return found

    def _persists(self, time: float, alarm: bool) -> bool:
        """Whether what is unexplained lasts."""
        if not alarm:
            self._since, self._place = np.nan, None
            return False
        if np.isnan(self._since):
            self._since = time
        return time - self._since >= PERSISTS

    def _looked_for(self, whitened: Float[np.ndarray, "6"], factor: Float[np.ndarray, "6 6"]) -> _Place:
        """Return the contact that the skin does not feel, where it is believed most."""
        places = self.fused.unseen_by(whitened, factor)
        inside, several = places.cluster == 0, int(places.cluster.max()) + 1
        believed = places.belief[inside].sum()
        share, away = places.belief[inside] / believed, places.points[inside] - places.points[0]
        row = np.full(ROW.length + len(self.features) + 1, np.nan)
        row[ROW.point], row[ROW.normal] = places.points[0], places.normals[0]
        row[ROW.covariance] = np.einsum("k,ki,kj->ij", share, away, away).ravel()
        row[ROW.residual], row[ROW.candidates] = 0.0, several
        row[ROW.status] = Status.CONTACT if several == 1 else Status.AMBIGUOUS
        row[ROW.length + len(self.taxels.features) + BELIEF], row[-1] = believed, 0.0
        return _Place(row, self.fused.unseen_row(places))


class _Place(NamedTuple):
    """A contact that the skin does not feel: as a row but for its force, and as `FusedLocator.rows` has it."""

    row: Float[np.ndarray, " w"]
    contact: Float[np.ndarray, "17"]


class _Cut(NamedTuple):
    """Samples of one window of the zero, with what the skin alone says of them.

    Attributes:
        samples: they; skin: rows of all of them; counts: how many each has.
        block: that they end; None: it goes on.
    """

    samples: Recording
    skin: Float[np.ndarray, "r v"]
    counts: Int[np.ndarray, " n"]
    block: Recording | None


_Framed = tuple[Float[np.ndarray, "_ w"], Int[np.ndarray, " _"]]  # rows, and how many of each frame
_Located = tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"], Int8[np.ndarray, " n"]]  # see `_wrenches`
_Smoothed = tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, " n"]]  # wrenches, and what is left of their noise
_Taken = tuple[Measured, Float[np.ndarray, " n"], _Smoothed]  # the second: means of how many readings


class _Beside:
    """Wrenches of the blocks that the skin is given, in their order, where a filter of zero phase looks ahead."""

    def __init__(self, sensor: WrenchSensor, filter: Filter, rate: float | None) -> None:
        self._sensor, self._waiting = sensor, deque[tuple[Measured, np.ndarray]]()
        self._both = BothWays(filter.recursion(known_rate(rate, "frames")), known_rate(rate, "frames"))

    def measured(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        """The same, once their wrenches are measured."""
        for block in blocks:
            measured = self._sensor.measure(block)
            self._both.push(measured.time, measured.status, measured.wrench)
            self._waiting.append((measured, block.channels[AVERAGED][:, 0]))
            yield block
        self._both.finish()

    def taken(self) -> _Taken:
        """Of the next block."""
        measured, averaged = self._waiting.popleft()
        wrenches, good = measured.wrench.copy(), measured.status < 0
        share = np.ones(len(good))
        wrenches[good], share[good] = self._both.take(int(np.count_nonzero(good)))
        return measured, averaged, (wrenches, share)


def _write(fused: FusedFrames, rows: Float[np.ndarray, "r w"], which: Bool[np.ndarray, " r"], after: int) -> None:
    """Write what is known of the forces of contacts into `which` of the rows."""
    rows[which, ROW.force] = fused.force
    rows[which, after + SHARE], rows[which, after + BOUND] = fused.share, fused.bound
    rows[which, after + SPREAD : after + SPREAD + 6] = fused.spread
