"""Describe a moment, and list the touches, in words and numbers with units: HTML for the page's panel."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from html import escape

import numpy as np

from palpate.contact.estimate import Status
from palpate.spatial.shown import rounded, three_digits, uncertain
from palpate.viewer._style import STATUS
from palpate.viewer.scene import Scene, SceneMoment, ShownContact
from palpate.viewer.widgets import card

NONE = "&ndash;"
FLAT = 0.05  # of the largest deviation: less is none
FINEST = 3  # digits behind the point of a place [mm]
MEANING = {
    Status.CONTACT: "Located.",
    Status.AMBIGUOUS: "Located, but another point explains the reading too and lies outside the 95 % ellipse.",
    Status.NO_CONTACT: "Nothing touches: the force is below the lower threshold.",
    Status.TOO_LIGHT: "Something touches, but too lightly to be located.",
    Status.OFF_SURFACE: "No point of the surface can make this wrench; the nearest is given.",
    Status.IMPLAUSIBLE: "Located, but with more friction or torsion than is allowed: do not believe the point.",
    Status.SATURATED: "A channel of the sensor is at its range, so that the force is not known.",
    Status.INVALID: "A reading is missing, or is not a number.",
    Status.NO_POSE: "The orientation of the sensor is missing, so that its payload cannot be subtracted.",
}
_FEATURES = {  # as files name them, in SI -> name, how many of which unit; without a unit it is a count
    "area": ("contact area", 1e4, "cm²"),
    "load": ("its cells, sum", 1.0, "N"),
    "peak": ("peak pressure", 1e-3, "kPa"),
    "pressure": ("mean pressure", 1e-3, "kPa"),
    "axis_long": ("spread, long axis", 1e3, "mm"),
    "axis_short": ("spread, short axis", 1e3, "mm"),
    "angle": ("angle about the axis", 180 / np.pi, "°"),
    "axis_angle": ("spread, angle", 180 / np.pi, "°"),
    "cells": ("cells pressed", 1.0, ""),
    "row": ("sheet row, from 0", 1.0, "cells"),
    "column": ("sheet column, from 0", 1.0, "cells"),
    "width": ("half width of the dent", 1e3, "mm"),
    "depth": ("depth of the dent", 1e3, "mm"),
    "shear": ("shear", 1.0, "N"),
    "markers": ("markers seen", 1.0, ""),
    "share": ("shear sd / prior", 1e2, "%"),
    "unexplained": ("p-value of wrench", 1e2, "%"),
    "belief": ("place, probability", 1e2, "%"),
    "angle_sd": ("angle, sd", 180 / np.pi, "°"),
    "depth_sd": ("depth, sd", 1e3, "mm"),
    "force_sd": ("force, sd", 1.0, "N"),
}
_INWARD = (
    "bound",
    "force_sd",
    *(f"force_{pair}" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")),
)  # no rows of their own
_SEEN = """const list = this.previousElementSibling;
list.scrollTop = {} * list.querySelector('tr').getBoundingClientRect().height"""
LISTED = 500  # touches: a longer list is slow to send, and nobody reads it


def feature(name: str, among: Collection[str]) -> tuple[str, float, str]:
    """Return a feature's name in words, the factor from SI to the displayed unit, and that unit ("" for none)."""
    if name == "angle" and "axis_long" in among:  # files call two things so
        name = "axis_angle"
    return _FEATURES.get(name, (name.replace("_", " "), 1.0, ""))


def caption(moment: SceneMoment, magnification: int, more: Sequence[tuple[str, str]] = ()) -> str:
    """Return a moment as HTML: force, status, place, and the sensor's features, each with its unit.

    Args:
        moment: of the scene.
        magnification: factor by which the ellipses are drawn larger.
        more: names and values that the layers add, plain text.
    """
    contacts = moment.contacts
    single = len(contacts) == 1
    words, status = contacts[0].status.words if single else f"{len(contacts)} contacts", contacts[0].status
    number = _force(contacts[0]) if single else _newton(float(np.sum([_size(contact) for contact in contacts])))
    rows = [row for contact in contacts for row in _contact(contact, magnification, single)]
    rows += [(escape(name), escape(value)) for name, value in more]
    rows.append(("time", f"{moment.time:.3f} s, sample {moment.sample:,}"))
    return card(number, words, STATUS[status], MEANING[status], rows)


def _contact(contact: ShownContact, magnification: int, single: bool) -> Iterator[tuple[str, str]]:
    """Yield names and values of one contact; of several, its features are on one line."""
    if contact.origin.sensor and contact.located:
        yield f"<b>{escape(contact.origin.link)}</b>", f"<b>{_force(contact)}</b>, {escape(contact.origin.sensor)}"
        if not single:  # a line each: a robot has many
            return
    elif not single:
        yield f"<b>contact {contact.identity}</b>", f"<b>{_force(contact)}</b>, {contact.status.words}"
    yield "place [mm]", _place(contact)
    yield "95 % half-axes", _ellipse(contact, magnification)
    if np.isfinite(contact.torque):
        yield "torque", f"{1e3 * contact.torque:z.1f} mN m about the normal"
    features = [_feature(name, contact) for name in contact.features if is_shown(name, contact.features)]
    if single:
        yield from features
    elif features:
        yield "features", ", ".join(f"{name}&nbsp;{value}" for name, value in features)


def is_shown(name: str, features: Collection[str]) -> bool:
    """Return whether a feature has a row in the caption.

    "bound", "force_sd", "force_xx" to "force_zz", and "NAME_sd" if `features` contains NAME have none.
    """
    return name not in _INWARD and not (name.endswith("_sd") and name[:-3] in features)


def _size(contact: ShownContact) -> float:
    return float(np.linalg.norm(contact.force))


def _force(contact: ShownContact) -> str:
    size, deviation = _size(contact), contact.force_deviation
    return f"{uncertain(size, deviation)} N" if np.isfinite(deviation) else _newton(size)


def _newton(force: float) -> str:
    return f"{force:.2f} N" if np.isfinite(force) else NONE


def _feature(name: str, contact: ShownContact) -> tuple[str, str]:
    words, scale, unit = feature(name, contact.features)
    deviation = scale * contact.features.get(f"{name}_sd", np.nan)
    value = scale * contact.features[name]
    if np.isfinite(deviation):
        shown = uncertain(value, deviation)
    else:
        shown = three_digits(value) if unit else f"{float(f'{value:.3g}'):,g}"
    return escape(words), f"{shown}&nbsp;{unit}" if unit else shown


def _place(contact: ShownContact) -> str:
    if not contact.located:
        return NONE
    most = 1e3 * float(np.nan_to_num(contact.deviation).max())
    shown = list[str]()
    for name, value, error in zip("xyz", 1e3 * contact.point, 1e3 * contact.deviation, strict=True):
        across = error > FLAT * most  # along the normal the point lies on the surface, which has no deviation
        said = uncertain(value, max(error, 10.0**-FINEST), FINEST) if across else rounded(value, most, FINEST)
        shown.append(f"{name} {said}".replace(" ", "&nbsp;"))
    return "&ensp;".join(shown)


def _ellipse(contact: ShownContact, magnification: int) -> str:
    if not np.isfinite(contact.axes).all():
        return NONE if not contact.located else "the noise is not known"
    long, short = 1e3 * contact.axes
    drawn = f"drawn &times;&nbsp;{magnification}" if magnification > 1 else "drawn to scale"
    return f"{long:.2g} &times; {short:.2g} mm, {drawn}"


def comparison(scene: Scene, moment: SceneMoment) -> list[tuple[str, str]]:
    """Return one pair: the comparison's title, and status, force [N], place [mm] and distance of its contact in words.

    Without a comparison return [].
    """
    other = scene.meanwhile(moment.seconds)
    if other is None or scene.other is None:
        return []
    theirs, ours = other.contacts[0], moment.contacts[0]
    said = theirs.status.words
    if theirs.located:
        place = " ".join(f"{name} {value:z.2f}" for name, value in zip("xyz", 1e3 * theirs.point, strict=True))
        said += f", {_size(theirs):.2f} N at {place} mm"
    if theirs.located and ours.located:
        apart = 1e3 * float(np.linalg.norm(theirs.point - ours.point))
        said += f"; differs by {apart:.2f} mm and {float(np.linalg.norm(theirs.force - ours.force)):.2f} N"
    return [(scene.other.title, said)]


def touch_list(scene: Scene, time: float) -> str:
    """Return the list as HTML; the touch at a recorded time [s] is marked, and a click on a line goes to its peak."""
    found = scene.touches
    if not len(found):
        return '<p style="opacity:.75;margin:.2em 1em;font-size:.8em">no touches</p>'
    now = np.flatnonzero((found.start <= time) & (time <= found.end))
    marked = int(now[0]) if len(now) else -1
    lines: list[str] = []
    for k in range(min(len(found), LISTED)):
        place = "&ensp;".join(f"{value:z.1f}" for value in 1e3 * found.point[k])
        seconds = scene.seconds_at(float(found.peak_time[k]))
        look = "background:rgba(0,114,178,.18);font-weight:600" if k == marked else ""
        lines.append(
            f'<tr data-asks="seek {seconds:.6f}" style="cursor:pointer;{look}"><td>{k + 1}</td>'
            f"<td>{seconds:.2f}</td><td>{found.peak_force[k]:.2f}</td><td>{escape(found.link[k]) or place}</td></tr>"
        )
    more = f"<div>and {len(found) - LISTED:,} more</div>" if len(found) > LISTED else ""
    last = "x y z [mm]" if found.origins is None else "link"
    head = "".join(f"<th>{name}</th>" for name in ("touch", "at [s]", "peak [N]", last))
    return (
        "<style>.palpate-touches { margin: .2em .8em .6em; max-height: 10.5em; overflow-y: auto; font-size: .8em; }"
        ".palpate-touches table { width: calc(100% - .8em); text-align: right; border-collapse: collapse; }"
        ".palpate-touches td, .palpate-touches th { padding: 0; line-height: 1.5em; height: 1.5em; }"
        ".palpate-touches th { position: sticky; top: 0; background: var(--mantine-color-body); }</style>"
        '<div class="palpate-touches" style="font-variant-numeric:tabular-nums"><table>'
        f"<thead>{head}</thead><tbody>{''.join(lines)}</tbody></table>{more}</div>"
        f'<style onload="{_SEEN.format(max(marked - 2, 0))}"></style>'
    )
