"""The first ten minutes with a table of somebody else: inspected, a rig made of it, estimated, without an editor."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from claims.command import cli, heard
from claims.evidence.exports import EDITED, NOTED, PRESSED, RADIUS, READ, TIME, WRENCH, Export
from palpate.cli.estimate import estimate
from palpate.cli.inspect import inspect
from palpate.cli.rig_options import RigOptions
from palpate.files.contacts import read_contacts
from palpate.files.logs import read_recording
from palpate.setup import load_rig

GOOD, EDIT, LOST, REFUSAL = "read", "read after the line named", "read, and what is lost is said", "refused"
PUSH = 3.5  # N: of the lighter push


@dataclass(frozen=True)
class Outcome:
    """What became of a file, what is wrong with that, or "", and whether other numbers came out without a word."""

    verdict: str
    wrong: str = ""
    misread: bool = False


def plain_answers(folder: Path) -> np.ndarray:
    """(n, 4): answered, and point [m], of each row of the plain table."""
    log = folder / READ[0].name
    log.write_bytes(READ[0].data)
    cli("rig", "new", log, "-o", folder / "rig.toml")
    heard(lambda: estimate(log, output=folder / "contacts.csv", setup=RigOptions(rig=folder / "rig.toml")))
    return _answers(folder / "contacts.csv")


def first_minutes(export: Export, folder: Path, plain: np.ndarray) -> Outcome:
    """`inspect`, `rig new`, the one line that it names, `estimate`.

    Args:
        export: to read.
        folder: to write to.
        plain: see `plain_answers`.
    """
    log, rig = folder / export.name, folder / "made" / "rig.toml"
    log.write_bytes(export.data)
    rig.parent.mkdir()
    done = cli("rig", "new", log, "-o", rig, *export.options)
    code, said = done.returncode, done.output
    if code:
        known = export.refused and export.refused in said and not rig.exists()
        return Outcome(REFUSAL, "" if known else f"refused with: {said}")
    if export.refused:
        return Outcome(GOOD, "a rig was made", misread=True)
    verdict, text = GOOD, rig.read_text()
    if export.edit is not None:
        verdict = EDIT
        rig.write_text(text.replace(*export.edit))
    looked = heard(lambda: inspect(log)).output  # as the command, without the time that parsing its line takes
    wrong = [f"not said: {word}" for word in export.says if word not in (looked if export in NOTED else said)]
    wrong += ["not said what it is taken for"] * ("taken for" not in looked)
    wrong += ["the line to change is not in the rig"] * (export in EDITED and rig.read_text() == text)
    misread = list(_misread(export, log, rig, plain))
    return Outcome(LOST if export in NOTED else verdict, "; ".join(wrong + misread), misread=bool(misread))


def _misread(export: Export, log: Path, rig: Path, plain: np.ndarray) -> Iterator[str]:
    """Where samples and answers are others than those of the plain table."""
    recording = read_recording(log, load_rig(rig).layout())
    if len(recording) != len(TIME):
        yield f"{len(recording)} samples"
        return
    there = np.isfinite(recording.time)  # the rows that are lost have neither a time nor numbers
    if not (there.all() or export in NOTED):
        yield "samples without a time"
    time = recording.time - recording.time[0]
    if export.name != "wrapped.csv" and np.abs(time - TIME)[there].max() > 5e-7:  # of a time of day in float64
        yield "other times"
    off = np.abs(recording.wrenches() - WRENCH)[there]
    if off[:, :3].max() > export.tolerance[0] or off[:, 3:].max() > export.tolerance[1]:
        yield "other wrenches"
    heard(lambda: estimate(log, output=rig.with_name("contacts.csv"), setup=RigOptions(rig=rig)))
    pressed = PRESSED & there
    found, wanted = _answers(rig.with_name("contacts.csv"))[pressed], plain[pressed]
    torque = 2.0 * export.tolerance[0] * RADIUS + export.tolerance[1]  # N m: by how much those about the touch err
    if not found[:, 0].all() or np.abs(found - wanted).max() > max(2.0 * torque / PUSH, 1e-9):
        yield "other answers"


def _answers(path: Path) -> np.ndarray:
    contacts = read_contacts(path)
    return np.column_stack([contacts.estimate.answered, contacts.estimate.point])
