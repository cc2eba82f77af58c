"""Estimate each contact with its 3-D force: a skin gives places, a force/torque sensor the sum of forces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import prod

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.contact.contacts import Contacts
from palpate.contact.drift_gate import ContactShape
from palpate.contact.estimate import ROW, Status
from palpate.contact.estimator import Answered, Channels, ContactEstimator, Counts, Known, Rows, Times
from palpate.contact.locate import Locator
from palpate.contact.surface_wrenches import Piece, SurfaceWrenches, Wrenches
from palpate.errors import InputError
from palpate.sensors.fused.agreement import Agreement
from palpate.sensors.fused.lasting_unseen import LastingUnseen, fuse_with_unseen
from palpate.sensors.fused.locator import FusedFrames, FusedLocator
from palpate.sensors.taxels.estimator import SIX, SQUARE, TaxelEstimator
from palpate.signals.drift import Drift
from palpate.signals.recording import AVERAGED, CELLS, FORCE, TORQUE, Recording
from palpate.signals.smoothing import require_forward
from palpate.signals.wrench_sensor import Placement, Tare, WrenchSensor
from palpate.signals.zero_filter import ZeroHistory
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

FEATURES = ("share", "bound", "unexplained", "belief", *SIX)
SHARE, BOUND, UNEXPLAINED, BELIEF = range(4)  # their columns after the skin's


class FusedEstimator(ContactEstimator):
    """An estimator of the contacts on a link with a skin and a force/torque sensor, each with its force in 3-D.

    A reading is (k + 7,), or (3 k + 7,) with three axes: the cells row by row, force [N] and torque [N m] as measured,
    NaN where there is none, and the number of readings of which they are the mean (0: interpolated).

    The skin gives places, normals and normal forces, the wrench their sum (`FusedLocator`); without a wrench forces are
    the skin's, with `share` 1. Where the skin does not explain the wrench for 50 ms, one more contact, of identity 0,
    is added at the place of the largest belief.

    Features, after the skin's: `share`, posterior over prior standard deviation of the tangential force; `bound`, 1
    where the friction cone binds; `unexplained`, the probability of a wrench as far from the expected one, if the skin
    feels all; `belief`, the probability of the contact's place; `force_xx` ... `force_zz` [N^2], the force's
    covariance.

    Args:
        taxels: estimator of the skin; its filter smooths the wrenches too.
        sensor: sensor of wrenches.
        fused: locator with the surface, in the skin's frame.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
        drift: of the sensor's bias, which is followed while neither skin nor wrench shows a contact.
        covered: whether the body is touched only on the skin.
        live: whether samples come live; else `pairs` and `stream` smooth the bias by samples after a touch, for which
            blocks wait 10 minutes at most.

    Attributes:
        kelvin: temperature of the sensor, see `WrenchEstimator`.

    Raises:
        InputError: the sensor's noise is not known, or the filter has zero phase while the bias is followed.
    """

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
                hint="State noise in the rig's [force_torque], or use a log that begins untouched.",
            )
        super().__init__((CELLS, FORCE, TORQUE, AVERAGED), _features(taxels), taxels.most + 1, mount, taxels.filter)
        self.taxels, self.sensor, self.fused = taxels, sensor, fused
        self._covers = ROW.length + self.features.index("force_xx")
        self._covered, self.kelvin, shape = covered, np.nan, None
        placement = Placement(self.mount, mount_covariance)
        if drift is not None:
            if taxels.filter is not None and taxels.filter.zero_phase:
                raise InputError(
                    "with a skin the zero is followed sample by sample, and a filter with zero_phase needs later "
                    "samples.",
                    where="drift",
                    hint="Use a Butterworth filter without zero_phase, or none.",
                )
            matrix = placement.matrix
            noise = matrix @ noise @ matrix.T
            shape = ContactShape(Locator(fused.surface, friction=fused.settings.friction, noise=noise), placement)
        self._wrenches = SurfaceWrenches(
            sensor, placement, taxels.filter, taxels.rate, drift, shape, logs=not live, of="frames"
        )
        self._unseen = LastingUnseen(fused, ROW.length + len(taxels.features) + BELIEF, self._width)
        self._rows = taxels.empty(taxels.most)
        self.reset()

    def reset(self) -> None:
        """Forget earlier frames, notes and warnings, but not the tares."""
        super().reset()
        self.taxels.reset()
        self._wrenches.reset()
        self._unseen.reset()
        self._noted = dict[str, None]()
        self._agreement = Agreement()
        self._frames = self._missing = 0

    def tare(self, recording: Recording) -> Tare:
        """Tare the skin and the force/torque sensor by a recording at rest, `reset`, and return one `Tare` of both.

        Raises:
            InputError: the recording has too few samples, is not steady, or lacks a channel.
        """
        wrench = self.sensor.tare(recording)
        cells = self.taxels.tare(recording)
        self.reset()
        doubt = "; ".join(each.warning for each in (wrench, cells) if each.warning)
        return Tare(f"{wrench.note}; {cells.note}", doubt)

    def answer(self, block: Recording, watched: bool = False) -> Answered:
        """Return the contacts of a block's frames as `Answered`, with the force [N] of each taxel if `watched`.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        return next(self._rejoined(self._wrenches.forward(self._pieces([self.taxels.answer(block, watched)]))))

    def answers(self, blocks: Iterable[Recording], watched: bool = False) -> Iterator[Answered]:
        """Yield an `Answered` for each block of a log, from its start, with each taxel's force [N] if `watched`.

        Raises:
            InputError: a channel is missing, or the first frames do not determine the skin's baseline.
        """
        skin = self.taxels.answers(self.sensor.ready(blocks), watched)
        return self._rejoined(self._wrenches.of_log(self._pieces(skin)))

    def run(self, recording: Recording) -> Contacts:
        """Return the `Contacts` of a block; an unknown baseline and bad cells of the skin come from its first frames.

        Raises:
            InputError: a channel is missing or has another shape, the first frames do not determine the baseline, or
                the filter has zero phase.
        """
        require_forward(self.filter)
        self.taxels.look(recording)
        return super().run(recording)

    def zero_history(self) -> ZeroHistory | None:
        """Return the `ZeroHistory` of the wrenches; None where their zero is not followed."""
        return self._wrenches.history()

    def notes(self) -> tuple[str, ...]:
        """Return notes on the skin, the wrenches and the frames so far, one sentence each."""
        said = [*self._noted, *self.taxels.notes(), *self._wrenches.notes()]
        if self._missing:
            said.append(
                f"{self._missing} of {self._frames} frames have no wrench: their forces are the skin's alone (share 1)"
            )
        return tuple(said)

    def warnings(self) -> tuple[str, ...]:
        """Return warnings of the skin, of the wrenches, and of their disagreement, one sentence each."""
        return (*self.taxels.warnings(), *self._wrenches.warnings(), *self._agreement.warnings())

    def _single(self, time: float, reading: ArrayLike, out: Rows, rotation: Known, acceleration: Known) -> int:
        values = shaped(reading, (prod(self.taxels.body.one) + 7,), "reading")
        cells, wrench, averaged = values[:-7], values[-7:-1], values[-1:]
        count = self.taxels.update_into(time, cells, self._rows)
        skin = self._rows[:count]
        touched = self._touches(skin) if self._wrenches.followed else None
        wrenches = self._wrenches.single(
            time, wrench, rotation, acceleration, kelvin=self.kelvin, averaged=averaged, touched=touched
        )
        rows, _ = self._fused(np.array([time]), skin, np.array([count]), wrenches)
        count = min(len(rows), len(out))
        out[:count] = rows[:count]
        return count

    def _arrays(self, time: Times, readings: np.ndarray, beside: Channels, out: Rows, counts: Counts) -> int:
        self.taxels.require_rest()
        return super()._arrays(time, readings, beside, out, counts)

    def _touches(self, skin: Float[np.ndarray, "n v"]) -> bool | None:
        """Return whether the skin feels a contact; None if it does not, but the body may be touched elsewhere."""
        if np.isfinite(skin[:, ROW.point]).all(axis=1).any():
            return True
        return False if self._covered else None

    def _pieces(self, skin: Iterable[Answered]) -> Iterator[Piece]:
        """Yield the pieces of blocks, with the contacts of the skin alone."""
        for block, rows, counts, seen in skin:
            ends = np.concatenate([[0], np.cumsum(counts)])
            cuts = self._wrenches.cuts(block.time)
            for cut in cuts:
                samples, part = block.picked(cut), rows[ends[cut.start] : ends[cut.stop]]
                last = cut is cuts[-1]
                answered = Answered(samples, part, counts[cut], seen if last else None)
                averaged = samples.channels.get(AVERAGED, np.ones((len(samples), 1)))[:, 0]
                yield Piece(samples, block if last else None, self._touches(part), averaged, answered)

    def _rejoined(self, pieces: Iterable[tuple[Piece, Wrenches]]) -> Iterator[Answered]:
        """Yield complete blocks with fused contacts, from their pieces."""
        made = list[tuple[np.ndarray, np.ndarray]]()
        for (samples, ends, _, _, skin), wrenches in pieces:
            if skin is not None:
                made.append(self._fused(samples.time, skin.rows, skin.counts, wrenches))
            if ends is not None:
                rows, counts = zip(*made, strict=True)
                yield Answered(ends, np.concatenate(rows), np.concatenate(counts), None if skin is None else skin.seen)
                made = []

    def _fused(
        self,
        time: Float[np.ndarray, " n"],
        skin: Float[np.ndarray, "r v"],
        counts: Int[np.ndarray, " n"],
        located: Wrenches,
    ) -> tuple[Float[np.ndarray, "_ w"], Int[np.ndarray, " _"]]:
        """Return the rows of frames, the skin's and then that of an unseen contact, and their number in each."""
        wrenches, covariances, status = located
        if covariances is None:
            raise InputError("fusing needs the noise of the wrenches.", where="force_torque.noise")
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
        touched = usable & (pressed > 0)
        self._agreement.add(skin[touching, ROW.force], frame[touching], wrenches, touched, fused.alarm)
        after = ROW.length + len(self.taxels.features)
        rows = np.full((len(skin), self._width), np.nan)
        rows[:, :after], rows[:, -1] = skin[:, :-1], skin[:, -1]
        rows[touching, after + UNEXPLAINED], rows[touching, after + BELIEF] = fused.p[frame[touching]], 1.0
        _write(fused, rows, touching, after, self._covers)
        alone = touching & ~usable[frame]
        rows[alone, ROW.force] = skin[alone, ROW.force]
        found = self._unseen.found(time, felt & (usable | (pressed > 0)), usable, fused)
        if not found:
            return rows, counts
        more = np.isin(np.arange(len(counts)), list(found))
        within, ends, instead = more[frame], np.cumsum(counts)[more], more & (pressed == 0)
        kept = np.insert(~instead[frame], ends, True)  # not the row that says that there is no contact
        new, unseen = (np.array(each) for each in zip(*found.values(), strict=True))
        new[:, after + UNEXPLAINED] = fused.p[more]
        rows = np.insert(rows, ends, new, axis=0)[kept]
        given = (contacts[within[touching]], pressed[more], unseen, wrenches[more], covariances[more])
        fused = fuse_with_unseen(self.fused, *given)
        self._noted |= dict.fromkeys(fused.notes)
        pushed = np.insert(touching & within, ends, True)[kept]
        _write(fused, rows, pushed, after, self._covers)
        return rows, np.where(instead, 0, counts) + more

    def _pressing(self, skin: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n 21"]:
        """Return contacts of the skin as rows (n, 21) of `FusedLocator.rows`."""
        normals, status = skin[:, ROW.normal], skin[:, ROW.status]
        normal = np.maximum(-np.sum(normals * skin[:, ROW.force], axis=1), 0.0)
        deviations = np.where(status == Status.SATURATED, np.maximum(normal, 1.0), 0.0)
        spreads = np.nan_to_num(skin[:, ROW.covariance].reshape(-1, 3, 3))
        shear = None
        if self.taxels.body.response is not None:
            six = skin[:, self._covers : self._covers + 6]
            along = np.einsum("nij,ni,nj->n", six[:, SQUARE].reshape(-1, 3, 3), normals, normals)
            across = 0.5 * (six[:, [0, 3, 5]].sum(axis=1) - along)
            deviations = np.hypot(deviations, np.sqrt(np.maximum(along, 0.0)))
            shear = np.column_stack([skin[:, ROW.force] + normal[:, None] * normals, 1.0 / across])
        return self.fused.rows(skin[:, ROW.point], normals, normal, deviations, spreads, shear)


def _features(taxels: TaxelEstimator) -> tuple[str, ...]:
    """Return the skin's features, then those of the fusion; a force's covariance replaces that of a skin with shear."""
    return (*taxels.features, *(name for name in FEATURES if name not in taxels.features))


def _write(
    fused: FusedFrames, rows: Float[np.ndarray, "r w"], which: Bool[np.ndarray, " r"], after: int, covers: int
) -> None:
    """Write forces, shares, bounds and covariances into the rows of the mask `which`."""
    rows[which, ROW.force] = fused.force
    rows[which, after + SHARE], rows[which, after + BOUND] = fused.share, fused.bound
    rows[which, covers : covers + 6] = fused.spread
