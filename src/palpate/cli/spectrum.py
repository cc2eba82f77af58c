"""Draw spectra of force and contact point for `palpate inspect --spectrum`, and propose a filter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.console.console import lines, note
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.atomic import replacing, write_text
from palpate.setup.setup import Setup
from palpate.setup.tables import RigFilter
from palpate.signals.recording import FORCE, Recording
from palpate.signals.spectrum import Cutoff, Spectrum, propose_cutoff, spectrum
from palpate.viewer import plots
from palpate.viewer._style import save
from palpate.viewer.report import Report, Section, Tile, picture, render

PLACE = "place"  # (n, 3) m: channel of the point of contact, NaN where there is none
KINDS = (".html", ".svg", ".png")


def located(recording: Recording, setup: Setup) -> Recording:
    """Return `force_and_place` of each sample's strongest contact in a recording, without the rig's filter.

    Raises:
        InputError: the rig or a file that it names cannot be used.
        GeometryError: the file of the surface has no usable surface.
    """
    found = replace(setup, filter=RigFilter(), head=recording).prepared().estimator.run(recording)
    return replace(force_and_place(found[found.strongest()]), source=recording.source)


def force_and_place(contacts: Contacts) -> Recording:
    """Return a `Recording` of FORCE (n, 3) [N] and PLACE (n, 3) [m], NaN where not answered, of n contacts."""
    point = np.where(contacts.answered[:, None], contacts.point, np.nan)
    return Recording(contacts.time, {FORCE: contacts.force, PLACE: point})


def draw_spectrum(recording: Recording, output: Path, name: str) -> None:
    """Draw the spectra of FORCE and, where there is one, of PLACE; print the filter that they suggest.

    Args:
        recording: from `located` or a log.
        output: a file of one of `KINDS`.
        name: of the log, for the page.

    Raises:
        InputError: the log is too short, its rate varies, the force does not change, the output cannot be written, or
            matplotlib or jinja2 is not installed.
    """
    force = _spectrum(recording, FORCE)
    proposal = propose_cutoff(force)
    panels = [plots.SpectrumPanel(force.frequency, force.density, "force", "N", proposal.floor, proposal.frequency)]
    facts = [("cut-off", proposal.sentence), *(("as a filter", setting) for setting in proposal.settings)]
    if (place := _place(recording)) is not None:
        found, edge = place
        millimetres = (1e6 * found.density, "place", "mm", 1e6 * edge.floor)
        panels.append(plots.SpectrumPanel(found.frequency, *millimetres, edge.frequency))
        facts.append(("place", edge.sentence))
    _write(output, panels, force, facts, name)
    lines([("spectrum", f"{output}, of {force.samples:,} samples in {force.stretches:,} stretches"), *facts])


def _spectrum(recording: Recording, channel: str) -> Spectrum:
    found = spectrum(recording.time, recording.channels[channel])
    if not found.density.any():
        hint = "Connect the sensor, or switch off its driver's dead band, and record again."
        raise InputError(f"has no spectrum: {channel} does not change.", where=recording.source, hint=hint)
    return found


def _place(recording: Recording) -> tuple[Spectrum, Cutoff] | None:
    """Return spectrum and cut-off of the place; None, with a note, where stretches are too short."""
    if PLACE not in recording.channels:
        return None
    try:
        found = _spectrum(recording, PLACE)
    except InputError as problem:
        note([f"no spectrum of the place: {problem}"])
        return None
    return found, propose_cutoff(found, "m")


def _write(
    output: Path, panels: list[plots.SpectrumPanel], force: Spectrum, facts: list[tuple[str, str]], name: str
) -> None:
    if output.suffix.lower() != ".html":
        with replacing(output) as temporary:
            save(plots.spectra(panels), temporary, output.suffix.lower().removeprefix("."))
        return
    captions = "Dashed: the noise floor of each axis. The line: the proposed cut-off, where there is one."
    shown = tuple(picture(plots.spectra([panel]), f"The spectrum of the {panel.title}. {captions}") for panel in panels)
    cutoff = "none" if panels[0].cutoff is None else f"{panels[0].cutoff:.3g} Hz"
    tiles = (
        Tile("proposed cut-off", cutoff),
        Tile("rate", f"{force.rate:.4g} Hz", f"{force.samples:,} samples"),
        Tile("resolution", f"{force.frequency[0]:.3g} Hz", f"{force.segments:,} periodograms averaged"),
    )
    section = Section("Spectra", settings=tuple(facts), pictures=shown)
    summary = "How fast the force and the place of contact move, and from which frequency on there is noise only."
    write_text(output, render(Report(f"Spectrum of {name}", summary, tiles, sections=(section,))))
