"""Results of building a sensor from a rig and of guessing a sensor from a log."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.contact.estimator import ContactEstimator
from palpate.files.logs.layout import LogLayout
from palpate.signals.wrench_sensor import Tare

FIRST = 1.0  # s of a stream from which is taken what the rig does not state, where no tare says how long


@dataclass
class BuiltEstimator:
    """An estimator, with notes and warnings about how it was built.

    Attributes:
        estimator: ready for the first sample.
        notes: what was done or assumed, one sentence each.
        warnings: what may be wrong, one sentence each.
        settings: settings in force, name -> value.
    """

    estimator: ContactEstimator
    notes: list[str] = field(default_factory=list[str])
    warnings: list[str] = field(default_factory=list[str])
    settings: dict[str, object] = field(default_factory=dict[str, object])

    def tared(self, tare: Tare) -> None:
        """Append the note of a tare to `notes`, and its warning, if any, to `warnings`."""
        self.notes.append(tare.note)
        self.warnings += [tare.warning] if tare.warning else []


@dataclass(frozen=True)
class Guess:
    """A guess that a log was written by one kind of sensor.

    Attributes:
        why: what in the log looks like this sensor.
        layout: how to read the log.
        text: the tables of a rig, as TOML with comments.
        remarks: what the reader should check, one sentence each.
        lacking: what must be known before a rig can be written; "": nothing.
        frame: the sensor's frame as the log's messages name it; "" if they do not.
    """

    why: str
    layout: LogLayout
    text: str
    remarks: tuple[str, ...] = ()
    lacking: str = ""
    frame: str = ""
