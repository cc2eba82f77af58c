"""Join the poses of a second table to the samples of a log by their times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.log import Log
from palpate.files.logs.orientation import QUATERNION
from palpate.files.units import TIME_UNITS
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose_track import PoseTrack

_SHIFT = "State offset [s] in the rig's [orientation], or record both on one clock."
_UNIT = "time_unit in the rig's [orientation]"
_LEAST = 0.1  # of the length of the log, that the poses are long in a unit that is proposed


def pose_layout(layout: LogLayout) -> LogLayout:
    """Return the layout by which the table of poses of a log with this layout is read."""
    return replace(
        layout,
        pose_file=None,
        offset=0.0,
        time=layout.pose_time or layout.time,
        time_unit=layout.pose_time_unit,
        rate=None,
        wrench=None,
        arrays=(),
        acceleration=None,
        temperature=None,
    )


def converted(layout: LogLayout) -> LogLayout:
    """Return the layout of samples to which the poses of a second table are joined, as the sensor's in the base."""
    return replace(layout, orientation_form=QUATERNION, inverse=False, sensor_rotation=(), joints=())


@takes_arrays
class PoseTable:
    """Poses of a table, read as far as the rows of a log need them, and interpolated at their times.

    Args:
        log: the table, opened with `pose_layout`.
        layout: of the log to which they are joined.
    """

    def __init__(self, log: Log, layout: LogLayout) -> None:
        self._log, self._poses = log, log.blocks()
        self._track = PoseTrack(layout.offset, layout.max_gap)
        self._span = [np.inf, -np.inf]  # s: of the poses so far, on the log's clock
        self._rows_span = [np.inf, -np.inf]  # s: of the log's rows
        self._rows = self._posed = self._outside = 0

    def at(self, time: Float[np.ndarray, " n"]) -> Mapping[str, np.ndarray]:
        """Return ORIENTATION (n, 4) and POSITION (n, 3) [m] of the next rows, at times (n,) [s]; NaN where unknown.

        Raises:
            InputError: time has another shape, the table cannot be read or has no orientation, or all poses are before
                the first row.
        """
        while self._track.answerable(time) < len(time):
            block = next(self._poses, None)
            if block is None:
                self._track.complete()
                break
            self._add(block)
        quaternion, position = self._track.at(time)
        known = time[np.isfinite(time)]
        self._rows_span = _widened(self._rows_span, known)
        self._rows += len(time)
        self._posed += int(np.count_nonzero(np.isfinite(quaternion[:, 0])))
        self._outside += int(np.count_nonzero((time < self._span[0]) | (time > self._span[1])))
        if self._span[1] < self._rows_span[0]:
            self.require_overlap()
        self._track.forget(float(known.min(initial=np.inf)) if len(known) else -np.inf)
        return {ORIENTATION: quaternion, POSITION: position}

    def require_overlap(self) -> None:
        """Check, after the last row, that a row has a pose.

        Raises:
            InputError: none has, and the times of poses and rows do not overlap.
        """
        (first, last), (start, end) = self._span, self._rows_span
        if self._posed or not self._rows or (first <= end and start <= last):
            return
        for block in self._poses:
            self._add(block)
        first, last = self._span
        what = (
            f"its poses are from {first:.3f} s to {last:.3f} s, and the rows of the log from {start:.3f} s to "
            f"{end:.3f} s: they do not overlap."
        )
        used = TIME_UNITS[self._log.time_unit[0] or "s"]
        others = {unit: scale / used for unit, scale in TIME_UNITS.items() if scale != used}
        unit = next((unit for unit, by in others.items() if _alike((by * first, by * last), (start, end))), "")
        mend = f'Times may be in {unit}: write time_unit = "{unit}" in the rig\'s [orientation].' if unit else _SHIFT
        raise InputError(what, where=str(self._log.path), hint=mend)

    @property
    def described(self) -> str:
        """The table and the times of the poses read so far, on the log's clock, in words."""
        return f"{self._log.path.name}, whose poses are from {self._span[0]:.3f} s to {self._span[1]:.3f} s"

    def notes(self) -> tuple[str, ...]:
        """Return notes on the poses so far, one sentence each."""
        (first, last), gaps = self._span, self._rows - self._posed - self._outside
        said = (
            (self._outside, f"have no pose: poses are from {first:.3f} s to {last:.3f} s"),
            (gaps, f"have no pose: poses around them are more than {self._track.max_gap:g} s apart"),
        )
        lacking = (f"{count:,} of {self._rows:,} samples {what}" for count, what in said if count)
        own = (*self._log.notes(), *self._track.notes(), *([self._log.torn] if self._log.torn else []))
        own = (note.replace("unit in the rig's [time]", _UNIT).replace("[time] unit", _UNIT) for note in own)
        return (*lacking, *(f"{self._log.path.name}: {note}" for note in own))

    def _add(self, block: Recording) -> None:
        if ORIENTATION not in block.channels:
            hint = "Name its columns in the rig's [orientation]."
            raise InputError("has no orientation.", where=str(self._log.path), hint=hint)
        self._track.add(block.time, block.channels[ORIENTATION], block.channels.get(POSITION))
        self._span = _widened(self._span, block.time[np.isfinite(block.time)] + self._track.offset)


def _alike(poses: tuple[float, float], rows: tuple[float, float]) -> bool:
    """Return whether two spans of time [s] overlap, and the first is not much shorter."""
    return poses[0] <= rows[1] and rows[0] <= poses[1] and poses[1] - poses[0] >= _LEAST * (rows[1] - rows[0])


def _widened(span: list[float], time: Float[np.ndarray, " n"]) -> list[float]:
    return [float(time.min(initial=span[0])), float(time.max(initial=span[1]))]
