"""A moment in words and numbers with their units, as HTML for the page's panel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from palpate.contact.estimate import Status
from palpate.viewer._style import STATUS
from palpate.viewer.heat import PALETTE
from palpate.viewer.scene import Moment, Scene, ShownContact
from palpate.viewer.widgets import table

__all__ = ["MEANING", "beside", "caption", "feature", "legend"]

NONE = "&ndash;"
MEANING = {
    Status.CONTACT: "Located.",
    Status.AMBIGUOUS: "Located, but another point explains the reading too and lies outside the 95 % ellipse.",
    Status.NO_CONTACT: "Nothing touches: the force is below the lower threshold.",
    Status.TOO_LIGHT: "Something touches, but too lightly to be located.",
    Status.OFF_SURFACE: "No point of the surface can make this wrench; the nearest is given.",
    Status.IMPLAUSIBLE: "Located, but with more friction or torsion than is allowed: do not believe the point.",
    Status.SATURATED: "A channel of the sensor is at its range, so that the force is not known.",
    Status.INVALID: "A reading is missing, or is no number.",
    Status.NO_POSE: "The orientation of the sensor, without which its payload cannot be taken off, is missing.",
}
_SHOWN_IN = {  # features in SI -> how many of which unit
    "area": (1e4, "cm²"),
    "pressure": (1e-3, "kPa"),
    "peak": (1e-3, "kPa"),
    "load": (1.0, "N"),
    "angle": (180 / np.pi, "°"),
    "width": (1e3, "mm"),
    "depth": (1e3, "mm"),
    "depth_sd": (1e3, "mm"),
    "angle_sd": (180.0 / np.pi, "°"),
    "force_sd": (1.0, "N"),
    "shear": (1.0, "N"),
}


def feature(name: str) -> tuple[float, str]:
    """By how much a feature is multiplied to be shown, and in which unit; "" where it has none."""
    return _SHOWN_IN.get(name, (1.0, ""))


def caption(moment: Moment, magnification: int, lines: Sequence[str] = ()) -> str:
    """A moment as a person reads it, in HTML.

    Args:
        moment: of the scene.
        magnification: of the ellipses.
        lines: that the layers add, plain text.
    """
    contacts = moment.contacts
    force = float(np.sum([np.linalg.norm(contact.force) for contact in contacts]))
    single = len(contacts) == 1
    words, status = _status(contacts[0]) if single else f"{len(contacts)} contacts", contacts[0].status
    rows = [row for contact in contacts for row in _contact(contact, magnification, single)]
    rows.append(("time", f"{moment.time:.3f} s, sample {moment.sample:,}"))
    more = "".join(f"<div>{escape(line)}</div>" for line in lines)
    return (
        '<div style="padding:.3em .7em 0;font-size:.8em;line-height:1.45;'
        'font-variant-numeric:tabular-nums"><div style="display:flex;align-items:center;gap:.7em">'
        f'<span style="font-size:2.2em;font-weight:600">{_newton(force)}</span><span style="padding:.05em .7em;'
        f'border-radius:1em;border:2px solid {STATUS[status]}" title="{escape(MEANING[status])}">{words}</span></div>'
        f"{table(rows)}{more}</div>"
    )


def _contact(contact: ShownContact, magnification: int, single: bool) -> Iterator[tuple[str, str]]:
    """Names and values of one contact; with a headline where there are several."""
    if not single:
        size = _newton(float(np.linalg.norm(contact.force)))
        yield f"<b>contact {contact.identity}</b>", f"<b>{size}</b>, {_status(contact)}"
    yield "point", _place(contact)
    yield "95 %", _ellipse(contact, magnification)
    if single or np.isfinite(contact.torque):
        yield "torque", f"{1e3 * contact.torque:.1f} mN m about the normal" if np.isfinite(contact.torque) else NONE
    if contact.features:
        yield "features", ", ".join(_feature(name, value) for name, value in contact.features.items())


def _status(contact: ShownContact) -> str:
    return contact.status.label.replace("_", " ")


def _newton(force: float) -> str:
    return f"{force:.2f} N" if np.isfinite(force) else NONE


def _feature(name: str, value: float) -> str:
    scale, unit = feature(name)
    return f"{escape(name)}&nbsp;{scale * value:.3g}" + (f"&nbsp;{unit}" if unit else "")


def _place(contact: ShownContact) -> str:
    if not contact.located:
        return NONE
    pairs = zip("xyz", 1e3 * contact.point, 1e3 * contact.deviation, strict=True)
    return "&ensp;".join(f"{name}&nbsp;{_measured(value, error)}" for name, value, error in pairs) + "&nbsp;mm"


def _ellipse(contact: ShownContact, magnification: int) -> str:
    if not np.isfinite(contact.axes).all():
        return NONE if not contact.located else "no noise is known"
    long, short = 1e3 * contact.axes
    drawn = f", drawn {magnification} times as large" if magnification > 1 else ", drawn to scale"
    return f"within {long:.2f} &times; {short:.2f} mm{drawn}"


def _measured(value: float, deviation: float) -> str:
    return f"{value:.2f}&nbsp;&plusmn;&nbsp;{deviation:.2f}" if np.isfinite(deviation) else f"{value:.2f}"


def beside(scene: Scene, moment: Moment) -> list[str]:
    """What is compared, at the same time: how hard, where, and how far from the strongest contact."""
    other = scene.meanwhile(moment.seconds)
    if other is None or scene.beside is None:
        return []
    theirs, ours = other.contacts[0], moment.contacts[0]
    said = f"{scene.beside.title}: {theirs.status.label.replace('_', ' ')}"
    if theirs.located:
        place = " ".join(f"{name} {value:.2f}" for name, value in zip("xyz", 1e3 * theirs.point, strict=True))
        said += f", {float(np.linalg.norm(theirs.force)):.2f} N at {place} mm"
    if theirs.located and ours.located:
        apart = 1e3 * float(np.linalg.norm(theirs.point - ours.point))
        said += f"; {apart:.2f} mm and {float(np.linalg.norm(theirs.force - ours.force)):.2f} N apart"
    return [said]


_GLYPHS = {  # 28 x 18 each
    "arrow": '<path d="M2 15 L20 5" stroke="rgb(0,48,120)" stroke-width="3"/><path d="M26 2 L16.5 3.5 L20.5 10 Z" '
    'fill="rgb(0,48,120)"/>',
    "ring": '<ellipse cx="14" cy="9" rx="11" ry="6" fill="rgba(0,48,120,.25)" '
    'stroke="rgb(0,48,120)" stroke-width="2"/>',
    "curl": '<path d="M9 15 A7 7 0 1 1 20 13" fill="none" stroke="rgb(130,40,120)" stroke-width="3"/>'
    '<path d="M24 9 L15 12 L22 18 Z" fill="rgb(130,40,120)"/>',
    "dot": '<circle cx="14" cy="9" r="5" fill="{0}"/>',
}
_KEYS = (
    ("space", "play, pause"),
    ("&larr; &rarr;", "touch before, touch after"),
    ("shift &larr; &rarr;", "touched sample before, after"),
    ("click", "in a plot or a line of the list: go there"),
)

_CORNER = """<style>@media (min-width: 601px) { .palpate-legend {
  position: fixed; left: 1em; bottom: 1em; max-width: 27em; border-radius: .4em; pointer-events: none;
  background: color-mix(in srgb, var(--mantine-color-body) 80%, transparent);
} }</style>"""  # on a phone it stays in the sheet


def legend(scene: Scene) -> str:
    """What is drawn, what the colours of heat stand for, and which keys there are."""
    drawn = [
        (_GLYPHS["arrow"], "force on the body: the tip pushes"),
        (_GLYPHS["ring"], "95 % ellipse of the point; faint: larger than it can tell"),
        (_GLYPHS["curl"], "torque about the normal"),
    ]
    if scene.beside is not None:
        drawn.append((_GLYPHS["dot"].format("rgb(0,48,120)"), escape(scene.title)))
        drawn.append((_GLYPHS["dot"].format("rgb(0,120,80)"), escape(scene.beside.title)))
    rows = "".join(
        f'<div style="display:flex;align-items:center;gap:.7em"><svg width="28" height="18" aria-hidden="true">{glyph}'
        f"</svg><span>{words}</span></div>"
        for glyph, words in drawn
    )
    keys = "".join(f'<div><kbd style="opacity:.75">{key}</kbd>&ensp;{words}</div>' for key, words in _KEYS)
    return (
        f'{_CORNER}<div class="palpate-legend" style="padding:.2em .8em .8em;font-size:.8em;line-height:1.5">{rows}'
        f'{_heat(scene)}<div style="margin-top:.5em">{keys}</div></div>'
    )


def _heat(scene: Scene) -> str:
    if scene.body is None:
        return ""
    stops = ",".join("rgb({:.0f},{:.0f},{:.0f})".format(*colour) for colour in PALETTE)
    longest = 1e-4 * float(scene.heat.max())  # s/cm^2
    return (
        f'<div style="margin-top:.4em;height:.6em;border-radius:.3em;background:linear-gradient(90deg,{stops})"></div>'
        '<div style="display:flex;justify-content:space-between"><span>heat: not touched</span>'
        f"<span>{longest:.3g} s/cm²</span></div>"
    )
