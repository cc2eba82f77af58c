"""Define `palpate evaluate` for a marker ring against the angles and forces of its calibration's truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from palpate.console.console import lines, note, table, title
from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError
from palpate.evaluation.errors import HEADER, ErrorSummary
from palpate.evaluation.matching import match_instants
from palpate.files.tables.table import TextTable
from palpate.viewer.report import percent

TRUTH = ("angle_deg", "force_n")
_QUANTITIES = (  # column of the truth; the scale from SI to its unit; the name of the standard deviation
    ("angle_deg", 180 / np.pi, "angle_sd"),
    ("force_n", 1.0, "force_sd"),
    ("depth_mm", 1e3, "depth_sd"),
    ("shear_n", 1.0, ""),
)
_TITLES = {"angle_deg": "angle [deg]", "force_n": "force [N]", "depth_mm": "depth [mm]", "shear_n": "shear [N]"}
_WITHIN = 1.96  # deviations: 95 % of a normal distribution


def evaluate_ring(path: Path, found: Contacts, known: TextTable, tolerance: float) -> None:
    """Print how far the contacts of a marker ring are from known angles, forces, depths and shears.

    Args:
        path: file of the contacts.
        found: the contacts, in the ring's frame.
        known: `TRUTH`, and, where known, time, depth_mm and shear_n; a row a frame where it has no time.
        tolerance: rows of the truth so close to a contact's time count [s].

    Raises:
        InputError: the contacts are not those of a marker ring, the truth has another number of rows than frames, or no
            frame has both a contact and a truth.
    """
    if "angle" not in found.features:
        what = "has no angles, which a truth with the columns angle_deg and force_n needs: it is of no marker ring."
        raise InputError(what, where=str(path))
    names = [name for name, *_ in _QUANTITIES if name in known.names]
    truth = dict(zip(names, known.numbers(names)[0].T, strict=True))
    time, touched = _times(found, known), np.isfinite(truth["angle_deg"])
    radius = float(np.nanmedian(np.hypot(*found.point[:, :2].T))) if found.answered.any() else 1.0
    circle = radius * np.stack([f(np.radians(truth["angle_deg"])) for f in (np.cos, np.sin, np.zeros_like)], axis=-1)
    match, _, near = match_instants(found, TrueSamples(time[touched], circle[touched]), tolerance)
    rows = np.flatnonzero((match >= 0) & found.answered)
    if not len(rows):
        hint = "Use one clock for both, or widen the match with --tolerance."
        raise InputError("no contact matches the truth.", where=str(known.path), hint=hint)
    true = {name: values[touched][match[rows]] for name, values in truth.items()}
    errors = {name: values - true[name] for name, values in _found(found[rows]).items() if name in true}
    errors["angle_deg"] = (errors["angle_deg"] + 180.0) % 360.0 - 180.0
    title(f"{path} against {known.path}")
    missed = int(touched.sum()) - len(np.unique(match[rows]))
    lines([("contacts", f"{len(rows):,} of {int(found.answered.sum()):,} have a truth of their own")])
    summaries = {name: ErrorSummary.of(np.abs(off)) for name, off in errors.items()}
    table(("", *HEADER), [(_TITLES[name], *each.row(1.0)) for name, each in summaries.items() if each is not None])
    lines(_intervals(found[rows], errors))
    outside = int(np.count_nonzero(near & found.answered))
    counted = ((missed, "truths have no contact"), (outside, "contacts are before or after a stretch of truths"))
    note([f"{count:,} {what}" for count, what in counted if count])


def _times(found: Contacts, known: TextTable) -> Float[np.ndarray, " k"]:
    """Return the time [s] of each row of the truth: its own, or that of the frame with its number."""
    if "time" in known.names:
        return known.numbers(["time"])[0][:, 0].copy()
    first = np.unique(found.sample, return_index=True)[1]
    if len(first) != len(known):
        what = f"has {len(known):,} rows without times for {len(first):,} frames."
        raise InputError(what, where=str(known.path), hint="Write a row a frame, or a column time [s].")
    return found.time[first]


def _found(contacts: Contacts) -> dict[str, Float[np.ndarray, " n"]]:
    """Return what was estimated, by the names and in the units of the truth; the force is along the normal."""
    values = {"angle_deg": contacts.features["angle"], "depth_mm": contacts.features["depth"]}
    values["force_n"] = -np.sum(contacts.force * contacts.normal, axis=1)
    if "shear" in contacts.features:
        values["shear_n"] = contacts.features["shear"]
    return {name: scale * values[name] for name, scale, _ in _QUANTITIES if name in values}


def _intervals(contacts: Contacts, errors: dict[str, Float[np.ndarray, " n"]]) -> list[tuple[str, str]]:
    held: list[tuple[str, str]] = []
    for name, scale, deviation in _QUANTITIES:
        if name in errors and deviation in contacts.features:
            spread = scale * contacts.features[deviation]
            known: Bool[np.ndarray, " n"] = np.isfinite(spread) & np.isfinite(errors[name])
            inside = np.abs(errors[name][known]) <= _WITHIN * spread[known]
            if len(inside):
                text = f"holds the truth in {percent(float(inside.mean()))} of {len(inside):,} (should be 95)"
                held.append((f"95 % of {name.partition('_')[0]}", text))
    return held
