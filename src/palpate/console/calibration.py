"""Run calibrations: protect their inputs, write the model, print figures and notes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

from tyro.conf import arg

from palpate.console.console import counting, lines, note, title
from palpate.console.options import Log, NameOption, Output
from palpate.files.atomic import keep_inputs
from palpate.files.logs.layout import pose_path
from palpate.files.models import provenance, write_model
from palpate.setup import Rig, load_rig


@dataclass(frozen=True)
class CalibrationResult:
    """The result of a calibration, with the messages for the user, a sentence each.

    Args:
        figures: (name, value) of each.
        model: what `Calibration.write` writes.
        notes: about the log and the model.
        warnings: what to check before the model is used.
        hints: what to change in the rig or the log to get a better result.
        next: what to do with the output.
    """

    figures: Iterable[tuple[str, object]]
    model: Any = None
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()
    hints: Sequence[str] = ()
    next: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Calibration(ABC):
    """A command `palpate calibrate NAME`; a subclass is a dataclass whose fields are its arguments.

    Its paths other than `output` are inputs, a `rig` together with the files that it names. Other packages add
    calibrations by an entry point `palpate.calibrations` called NAME.
    """

    log: Log
    output: Output
    sensor: Annotated[NameOption, arg(help="name of the sensor, where the rig is of a robot.")] = None
    replaces: ClassVar[str] = ""
    """Input that the output may replace: a key of `Rig.files`, or "rig" for the rig itself; "" for none."""

    @abstractmethod
    def identify(self) -> CalibrationResult:
        """Read the inputs and return a `CalibrationResult` with the model.

        Raises:
            InputError: the inputs cannot be used, or contradict what the calibration assumes.
        """

    def write(self, found: CalibrationResult) -> None:
        """Write the model to the output.

        Raises:
            InputError: the output cannot be written.
            TypeError: no kind of model file is registered for the model.
        """
        write_model(self.output, found.model)

    @cached_property
    def stated(self) -> Rig:
        """`Rig` of the argument `rig`; an empty one without it.

        Raises:
            InputError: the rig cannot be read.
        """
        rig: Path | None = getattr(self, "rig", None)
        return Rig() if rig is None else load_rig(rig, self.sensor)

    @cached_property
    def reads(self) -> dict[str, Path]:
        """Name of the argument -> path, of each input file, and "poses", a second table of the log."""
        given = {name: path for name, path in vars(self).items() if isinstance(path, Path) and name != "output"}
        poses = pose_path(self.stated.orientation.file, given["log"]) if "log" in given else None
        return given if poses is None else {**given, "poses": poses}

    def record(self, **settings: object) -> dict[str, str]:
        """Return provenance for a model, name -> text: version, name and digest of the inputs, `settings`.

        Raises:
            OSError: an input file cannot be read.
        """
        return provenance(self.reads, settings)

    def run(self) -> None:
        """Identify the model, write the output, and print the figures and notes.

        Raises:
            InputError: the inputs cannot be used, or the output is an input or cannot be written.
            TypeError: no kind of model file is registered for the model.
        """
        files = [*self.reads.items(), *self.stated.files().items()]
        keep_inputs(self.output, [path for name, path in files if name != self.replaces])
        with counting():
            found = self.identify()
        self.write(found)
        title(f"{self.log} -> {self.output}")
        lines(found.figures)
        note(found.notes)
        note(found.warnings, kind="warning")
        note(found.hints, kind="hint")
        note(found.next)


def origin(record: dict[str, str], name: str) -> str:
    """Return "NAME (sha256:...)" of the input `name` in a provenance record, with the start of the digest.

    Raises:
        KeyError: the record has no such input.
    """
    file, _, digest = record[name].partition(" ")
    return f"{file} ({digest[:19]})"
