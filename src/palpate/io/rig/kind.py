"""What a kind of sensor is: its table in a rig, what of a log it reads, and how its estimator is built."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.contact.estimator import ContactEstimator
from palpate.io.logs import LogContents
from palpate.io.logs.layout import Layout
from palpate.sensors.recording import Recording

if TYPE_CHECKING:
    from palpate.io.rig.body import Body
    from palpate.io.rig.rig import Rig

__all__ = ["FIRST", "Guess", "Prepared", "SensorKind", "seen_first"]

FIRST = 1.0  # s of a stream from which is taken what the rig does not state, where no tare says how long


@dataclass
class Prepared:
    """An estimator, and what is to be known of how it was made.

    Attributes:
        estimator: ready for the first sample.
        said: what was done or assumed, one sentence each.
        doubted: what may be wrong about it.
        facts: settings in force, for the record beside a result and for the report.
    """

    estimator: ContactEstimator
    said: list[str] = field(default_factory=list[str])
    doubted: list[str] = field(default_factory=list[str])
    facts: dict[str, object] = field(default_factory=dict[str, object])


@dataclass(frozen=True)
class Guess:
    """What a log looks like to one kind of sensor.

    Attributes:
        why: the sentence that says what in the log looks like this sensor.
        layout: how to read it.
        text: the tables of a rig, as TOML with comments.
        remarks: what the reader should check.
        lacking: what must be known before a rig can be written, or "".
        frame: of the sensor, as the log's messages name it; "" where they do not.
    """

    why: str
    layout: Layout
    text: str
    remarks: tuple[str, ...] = ()
    lacking: str = ""
    frame: str = ""


def seen_first(rig: Rig) -> float:
    """Seconds of a stream for its tare, or for the rate of samples that a filter needs and the rig does not state."""
    measured = rig.filter.kind != "none" and rig.filter.rate is None
    return rig.estimate.tare or (FIRST if measured else 0.0)


@dataclass(frozen=True)
class SensorKind:
    """One sensor.

    Args:
        name: of its table in a rig.
        called: what it is, in a sentence.
        table: dataclass of its table.
        channels: of a Recording that it reads, the main one first.
        layout: where a log of a rig keeps them.
        build: an estimator, from the rig and the start of a log, if there is one.
        guess: whether a log looks as if this sensor had written it; None: it does not. The body, where one is given.
        paths: keys of its table that name files.
        refused: option of the command line -> why it means nothing to this sensor.
        needs_surface: whether it locates on the rig's [surface].
        check: what else must hold of a rig; raises InputError.
        parts: names of the sensors that it is made of, whose tables it reads; a rig with all of them is of this kind.
        start: seconds of a stream that `build` wants to see before the first answer; 0: none.
    """

    name: str
    called: str
    table: type[Any]
    channels: tuple[str, ...]
    layout: Callable[[Rig], Layout]
    build: Callable[[Rig, Recording | None], Prepared]
    guess: Callable[[Path, LogContents, Body | None], Guess | None] = lambda log, contents, body: None
    paths: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=lambda: {})
    needs_surface: bool = True
    check: Callable[[Rig, Path], None] = lambda rig, path: None
    parts: tuple[str, ...] = ()
    start: Callable[[Rig], float] = seen_first
