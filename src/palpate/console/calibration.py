"""Run calibrations: protect their inputs, write the model, print figures and notes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from palpate.console.console import counting, lines, note, title
from palpate.files.atomic import keep_inputs
from palpate.files.models import provenance, write_model
from palpate.setup import Rig, load_rig

__all__ = ["Calibration", "CalibrationResult", "origin"]

Lines = Iterable[tuple[str, object]]


@dataclass(frozen=True)
class CalibrationResult:
    """The result of a calibration, with the messages for the user.

    Args:
        figures: name and value of each.
        model: the model that `Calibration.write` writes to the output.
        notes: about the log and the model, a sentence each.
        warnings: what to check before the model is used.
        hints: what to change in the rig or the log to get a better result.
        next: what to do with the output.
    """

    figures: Lines
    model: Any = None
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()
    hints: Sequence[str] = ()
    next: Sequence[str] = ()


class Calibration(ABC):
    """A command `palpate calibrate NAME`; a subclass is a dataclass whose fields are its arguments.

    Paths other than `output` are inputs, a `rig` together with the files that it names; all other fields are settings.
    Other packages add calibrations by an entry point `palpate.calibrations`, whose name is the command's.
    """

    log: Path
    output: Path
    replaces: ClassVar[str] = ""
    """Input that the output may replace: a key of `Rig.files`, or "rig" for the rig itself; "" for none."""

    @abstractmethod
    def identify(self) -> CalibrationResult:
        """Read the inputs, find the model, and return it in a `CalibrationResult`.

        Raises:
            InputError: the inputs cannot be used, or contradict what the calibration assumes.
        """

    def write(self, found: CalibrationResult) -> None:
        """Write the model to the output.

        Raises:
            InputError: the output cannot be written.
        """
        write_model(self.output, found.model)

    @cached_property
    def stated(self) -> Rig:
        """The `Rig` given as argument, or an empty one without it.

        Raises:
            InputError: the rig cannot be read.
        """
        rig: Path | None = getattr(self, "rig", None)
        return Rig() if rig is None else load_rig(rig)

    @cached_property
    def reads(self) -> dict[str, Path]:
        """Input files: name of the argument -> path."""
        return {name: path for name, path in vars(self).items() if isinstance(path, Path) and name != "output"}

    def record(self, **settings: object) -> dict[str, str]:
        """Return the provenance of a model, name -> text: version, input files with their digests, and `settings`."""
        return provenance(self.reads, settings)

    def run(self) -> None:
        """Identify the model, write the output, and print the figures and notes.

        Raises:
            InputError: the inputs cannot be used, or the output is an input or cannot be written.
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
    """Return a short description of a file in a provenance record: its name, and the start of its digest."""
    file, _, digest = record[name].partition(" ")
    return f"{file} ({digest[:19]})"
