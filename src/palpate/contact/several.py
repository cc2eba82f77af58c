"""Frames of a sheet of taxels become touches: several at once, each with place, force, pressure, area and axes."""

from __future__ import annotations

from math import exp, inf

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.seam import columns_used, contours, is_ring, padded
from palpate.contact.touches import SkinSettings, SkinTouches
from palpate.contact.track import Tracker
from palpate.errors import InputError
from palpate.sensors.intensity import Intensity
from palpate.sensors.recording import CELLS, Recording
from palpate.sensors.skin import Health, Sheet
from palpate.sensors.skin_map import SkinMap

__all__ = ["Skin", "SkinSettings", "SkinTouches", "contours"]


class Skin:
    """The chain from frames to touches: each frame is answered with what those before it left (rest, identities).

    A cell's reading is taken from its rest, which follows drift while nothing touches it, and turned into force before
    anything is summed. Touches are connected cells; one whose pressure has two peaks with a saddle between them is
    two, whose cells are shared out by a mixture of two round Gaussians. The place is the centroid, divided by the sum
    of the forces [skin map, (1) corrected], on the map between cell centres; the force is the sum over the cells, each
    along its own normal.

    Args:
        place: where the cells sit.
        intensity: what their readings mean.
        sheet: rows, columns, bits, masked cells.
        health: rest and noise of the cells, from `palpate.sensors.skin.examine`.
        settings: how touches are found.

    Raises:
        InputError: map, curves and sheet are not of one size, or no cell is good.
    """

    def __init__(
        self,
        place: SkinMap,
        intensity: Intensity,
        sheet: Sheet,
        health: Health,
        settings: SkinSettings | None = None,
    ) -> None:
        from palpate.contact import _several  # compiled: loaded when first needed

        shape = (sheet.rows, sheet.columns)
        for what, size in (("the map", place.centres.shape[:2]), ("the frames examined", health.baseline.shape)):
            if size != shape:
                raise InputError(
                    f"{what} {'is' if what == 'the map' else 'are'} of {size[0]} x {size[1]} cells, "
                    f"the sheet of {shape[0]} x {shape[1]}.",
                    where="skin",
                )
        self.place, self.sheet, self.settings = place, sheet, settings or SkinSettings()
        self.health = health
        self.used = columns_used(place)
        self.ring = is_ring(place, self.used)
        good = sheet.mask() & health.good
        good[:, self.used :] = False
        if not good.any():
            raise InputError("no cell of the sheet is good: all are masked, dead or stuck.", where="skin")
        falling = intensity.curves[0].falling
        limits = np.array([curve.saturation for curve in intensity.curves])
        limits = np.where(np.isnan(limits), -np.inf if falling else sheet.top, limits)
        which = intensity.numbers(*shape)
        tables, steps = intensity.tables()
        self._sheet = (sheet.rows, sheet.columns, self.used, self.ring)
        self._cell = (
            good.ravel(),
            health.noise.ravel().copy(),
            place.normals.reshape(-1, 3).copy(),
            place.areas.ravel().copy(),
            which.ravel(),
            limits[which].ravel(),
        )
        self._curves = (tables, steps, -1.0 if falling else 1.0)
        self._grid = padded(place, self.used, self.ring)
        count = sheet.cells
        numbers = [np.zeros(count) for _ in range(4)]
        flags = [np.zeros(count, dtype=np.bool_) for _ in range(2)]
        whole = [np.zeros(count, dtype=np.int64) for _ in range(4)]
        self._work = (*numbers, *flags, *whole)
        self._touches = _several.touches
        self._extra = _several.EXTRA
        self._out = np.zeros((_several.MOST, _several.WIDTH))
        self._raw = np.zeros(count)
        self._tracker = Tracker(self.settings.reach, self.settings.speed, self.settings.patience)
        self._turn = 0.0 if sheet.bits is None else sheet.top + 1.0
        self.reset()
        self.update_into(0.0, health.baseline)  # compiles, before anything is in a hurry
        self._tracker.follow(0.0, self._out[:1, :3])
        self._tracker = Tracker(self.settings.reach, self.settings.speed, self.settings.patience)
        self.reset()

    def reset(self) -> None:
        """Forget what frames left: the drift of the rest, readings that wrapped around, identities."""
        rest = self.health.baseline.ravel().copy()
        count = len(rest)
        self._state = (rest, np.full(count, np.nan), np.zeros(count, np.int64), np.zeros(count, np.int64))
        self._tracker.reset()
        self._last, self.invalid = np.nan, 0

    @property
    def force(self) -> Float[np.ndarray, "rows columns"]:
        """[N] of each cell in the last frame, below the thresholds too; a view that the next frame overwrites."""
        return self._work[2].reshape(self.sheet.rows, self.sheet.columns)

    @property
    def label(self) -> Int[np.ndarray, "rows columns"]:
        """Which area each cell belongs to in the last frame, from 1; 0: none, negative: the rim of that area."""
        return self._work[6].reshape(self.sheet.rows, self.sheet.columns)

    @property
    def wrapped(self) -> Int[np.ndarray, "rows columns"]:
        """How often each cell's reading went over an end of its range and came out at the other."""
        return self._state[3].reshape(self.sheet.rows, self.sheet.columns)

    def update_into(self, time: float, frame: np.ndarray) -> Float[np.ndarray, "n w"] | None:
        """The touches of one frame for a control loop, nothing allocated; None where the frame cannot be used.

        Returns:
            Rows as `contact.estimate.ROW` lays them out, behind them row, column, area, load, peak and mean pressure,
            variances along the axes, angle, cells and identity; the next frame overwrites them.
        """
        if frame.size != len(self._raw):
            return None
        self._raw[:] = frame.reshape(-1)
        settings = self.settings
        passed = min(max(time - self._last, 0.0), settings.drift)
        drift = 1.0 - exp(-passed / settings.drift) if passed == passed and settings.drift < inf else 0.0  # not NaN
        if time == time:
            self._last = time
        count = self._touches(
            self._raw,
            self._sheet,
            self._cell,
            self._state,
            self._curves,
            (settings.on, settings.off, settings.sure, settings.share, drift, self._turn),
            self._grid,
            self._work,
            self._out,
        )
        if count < 0:
            self.invalid += 1
            return None
        found = self._out[:count]
        found[:, self._extra + 10] = self._tracker.follow(time, found[:, :3])
        return found

    def update(self, time: float, frame: np.ndarray) -> SkinTouches:
        """The touches of one frame, as values; one row that says so where there is none.

        Args:
            time: [s] on the clock of the frames.
            frame: rows x columns raw readings; another size, or many that are no number, is INVALID.
        """
        found = self.update_into(time, frame)
        rows = self._nothing(found) if found is None or not len(found) else found
        return self._value(rows, np.zeros(len(rows), np.int64), np.full(len(rows), time))

    def run(
        self, frames: Recording, first: int = 0, forces: Float[np.ndarray, "n rows columns"] | None = None
    ) -> SkinTouches:
        """The touches of a block, at least one row a frame.

        Args:
            frames: with `CELLS`, in order.
            first: number of the first frame in its log.
            forces: where the force [N] of each cell is to be written.
        """
        parts: list[np.ndarray] = []
        for k, (time, frame) in enumerate(zip(frames.time.tolist(), frames.channels[CELLS], strict=True)):
            found = self.update_into(time, frame)
            parts.append(self._nothing(found) if found is None or not len(found) else found.copy())
            if forces is not None:
                forces[k] = self.force
        counts = [len(part) for part in parts]
        rows = np.concatenate(parts) if parts else np.zeros((0, self._out.shape[1]))
        return self._value(rows, first + np.repeat(np.arange(len(parts)), counts), np.repeat(frames.time, counts))

    def notes(self) -> tuple[str, ...]:
        """What was met so far, one sentence each."""
        said: list[str] = [*self.health.notes]
        if self.used < self.sheet.columns:
            said.append(
                f"the last {self.sheet.columns - self.used} of {self.sheet.columns} columns lie over others and are "
                "left out: a press there is felt twice"
            )
        if self.ring:
            said.append("the sheet closes around the link: touches cross the seam")
        drifted = np.abs(self._state[0].reshape(self.sheet.rows, -1) - self.health.baseline) / self.health.noise
        if drifted.max() > self.settings.on:
            row, column = np.unravel_index(int(np.argmax(drifted)), drifted.shape)
            moved = f"{drifted.max():.0f} deviations of its noise, most at cell ({row}, {column})"
            said.append(f"the rest of cells drifted by up to {moved}; it was followed where nothing touched")
        if self.invalid:
            said.append(f"{self.invalid} frames could not be used (another size, or no numbers)")
        wrapped = np.argwhere(self.wrapped > 0).tolist()
        if wrapped:
            cells = ", ".join(f"({row}, {column})" for row, column in wrapped[:5])
            said.append(
                f"readings of {len(wrapped)} cells went over the end of the range and came out at the other "
                f"({cells}{', ...' if len(wrapped) > 5 else ''}): they were put right where it was clear"
            )
        return tuple(said)

    def _nothing(self, found: np.ndarray | None) -> Float[np.ndarray, "1 w"]:
        row = np.full((1, self._out.shape[1]), np.nan)
        row[0, 20] = 0.0
        row[0, 21] = Status.INVALID if found is None else Status.NO_CONTACT
        row[0, -1] = 0.0
        return row

    def _value(
        self, rows: Float[np.ndarray, "n w"], sample: Int[np.ndarray, " n"], time: Float[np.ndarray, " n"]
    ) -> SkinTouches:
        extra = rows[:, self._extra :]
        row, column, area, load, peak, pressure = (extra[:, k].copy() for k in range(6))
        return SkinTouches(
            sample,
            np.array(time, dtype=np.float64),
            extra[:, 10].astype(np.int64),
            ContactEstimate.from_rows(rows[:, : self._extra]),
            row,
            column,
            area,
            load,
            peak,
            pressure,
            np.sqrt(extra[:, 6:8]),
            extra[:, 8].copy(),
            extra[:, 9].copy(),
        )
