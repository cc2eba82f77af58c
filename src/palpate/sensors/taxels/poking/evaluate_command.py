"""Define `palpate evaluate` for places of taxels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.console.console import lines, note, table, title
from palpate.errors import InputError
from palpate.evaluation.errors import HEADER
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.models import load_toml
from palpate.sensors.taxels.place_formats import holds_taxels, read_taxel_places
from palpate.sensors.taxels.plots import error_map, moved_map
from palpate.sensors.taxels.poking.evaluate import TaxelErrors, compare_places
from palpate.viewer.report import Report, ReportTable, Section, Tile, percent, picture, render, require_report

WORST = 12  # taxels that are named


def is_taxel_file(path: Path) -> bool:
    """Return whether a file contains places of taxels; False if there is no file.

    Raises:
        InputError: the file cannot be read.
    """
    if not path.is_file():
        return False
    if path.suffix.lower() == ".toml":
        return load_toml(path).get("kind") == "taxels"
    return path.suffix.lower() in (".txt", ".csv", ".urdf") and holds_taxels(path)


def evaluate_taxels(estimate: Path, truth: Path, output: Path | None) -> None:
    """Print how far taxels are off, and write a page.

    Raises:
        InputError: a file that cannot be read or written, a page that is not .html, two skins, or no report package.
    """
    if output is not None:
        if output.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"a page cannot be written as {output.suffix!r}.", where=str(output), hint="Use .html.")
        keep_inputs(output, (estimate, truth))
        require_report()
    try:
        errors = compare_places(read_taxel_places(estimate), read_taxel_places(truth))
    except InputError as problem:
        raise problem if problem.where != "taxels" else InputError(problem.what, where=str(truth)) from problem
    title(f"{estimate} against {truth}")
    facts = _facts(errors)
    lines(facts)
    rows = [(name, *summary.row(1e3)) for name, summary in errors.summaries()]
    table(("[mm]", *HEADER), rows)
    if errors.lacking:
        note([f"{errors.lacking} numbers have a taxel in only one of the two, and are left out"])
    if output is not None:
        write_text(output, render(_page(f"{estimate.name} against {truth.name}", errors, facts, rows)))


def _facts(errors: TaxelErrors) -> list[tuple[str, str]]:
    said = [("taxels", f"{len(errors.number):,} have both places")]
    if errors.motion is not None:
        shift = 1e3 * float(np.linalg.norm(errors.motion.apply(errors.estimate).mean(0) - errors.estimate.mean(0)))
        turn = float(np.degrees(np.linalg.norm(errors.motion.rotation_vector())))
        said.append(("rigid motion", f"{shift:.2f} mm in the middle of the skin, {turn:.2f} degrees"))
    if errors.known.any():
        count = int(errors.known.sum())
        said.append(("95 % ellipsoids", f"hold the truth in {percent(errors.coverage)} of {count:,} (should be 95)"))
    return said


def _page(names: str, errors: TaxelErrors, facts: list[tuple[str, str]], rows: list[tuple[str, ...]]) -> Report:
    summaries = dict(errors.summaries())
    whole, rigid = summaries["absolute"], summaries.get("one rigid motion taken off")
    tiles = [Tile("absolute", f"{1e3 * whole.mean:.2f} mm", f"mean; worst {1e3 * whole.worst:.2f} mm")]
    if rigid is not None:
        tiles.append(Tile("relative", f"{1e3 * rigid.mean:.2f} mm", f"mean; worst {1e3 * rigid.worst:.2f} mm"))
    if errors.known.any():
        tiles.append(Tile("95 % ellipsoids", percent(errors.coverage), "hold the truth"))
    pictures = (
        picture(moved_map(errors.estimate, errors.truth), "From each true place (ring) to the one found (dot)."),
        picture(error_map(errors.estimate, 1e3 * errors.absolute), "How far off each taxel is."),
    )
    order = np.argsort(-errors.absolute)[:WORST]
    worst = tuple(
        (
            str(errors.number[k]),
            str(errors.module[k]) if errors.module[k] >= 0 else "-",
            f"{1e3 * errors.absolute[k]:.2f}",
            f"{1e3 * errors.relative[k]:.2f}",
            "yes" if errors.touched[k] else "never",
        )
        for k in order.tolist()
    )
    tables = (
        ReportTable(("[mm]", *HEADER), tuple(rows)),
        ReportTable(("taxel", "module", "absolute [mm]", "relative [mm]", "touched"), worst, "The farthest off."),
    )
    sections = (Section("Errors", pictures=pictures, settings=tuple(facts), tables=tables),)
    return Report(names, f"{names}: taxel by taxel, by their numbers.", tuple(tiles), sections=sections)
