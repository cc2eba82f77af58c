"""A moment in words and numbers with their units, as HTML for the page's panel."""

from __future__ import annotations

import numpy as np

from palpate.viewer._style import STATUS
from palpate.viewer.heat import PALETTE
from palpate.viewer.scene import Moment, Scene

__all__ = ["legend", "spoken"]

NONE = "&ndash;"


def spoken(moment: Moment, magnification: int) -> str:
    """A moment as a person reads it, in HTML; `magnification` is that of the ellipse."""
    force = float(np.linalg.norm(moment.force))
    size = f"{force:.2f} N" if np.isfinite(force) else "&ndash;"
    rows = "".join(
        f'<tr><td style="opacity:.6;padding-right:.8em">{name}</td><td>{value}</td></tr>'
        for name, value in (
            ("place", _place(moment)),
            ("95 %", _ellipse(moment, magnification)),
            ("torque", f"{1e3 * moment.torque:.1f} mN m about the normal" if np.isfinite(moment.torque) else NONE),
            ("time", f"{moment.time:.3f} s, sample {moment.index:,}"),
        )
    )
    return (
        '<div style="padding:.3em .7em 0;font-size:.8em;line-height:1.45;'
        'font-variant-numeric:tabular-nums"><div style="display:flex;align-items:center;gap:.7em">'
        f'<span style="font-size:2.2em;font-weight:600">{size}</span><span style="padding:.05em .7em;'
        f'border-radius:1em;border:2px solid {STATUS[moment.status]}">{moment.words}</span></div>'
        f"<table>{rows}</table></div>"
    )


def _place(moment: Moment) -> str:
    if not moment.located:
        return NONE
    pairs = zip("xyz", 1e3 * moment.point, 1e3 * moment.deviation, strict=True)
    return "&ensp;".join(f"{name}&nbsp;{_measured(value, spread)}" for name, value, spread in pairs) + "&nbsp;mm"


def _ellipse(moment: Moment, magnification: int) -> str:
    if not np.isfinite(moment.axes).all():
        return NONE if not moment.located else "no noise is known"
    long, short = 1e3 * moment.axes
    drawn = f", drawn {magnification} times as large" if magnification > 1 else ", drawn to scale"
    return f"within {long:.2f} &times; {short:.2f} mm{drawn}"


def _measured(value: float, spread: float) -> str:
    return f"{value:.2f}&nbsp;&plusmn;&nbsp;{spread:.2f}" if np.isfinite(spread) else f"{value:.2f}"


def legend(scene: Scene) -> str:
    """What the colours of heat stand for."""
    stops = ",".join("rgb({:.0f},{:.0f},{:.0f})".format(*colour) for colour in PALETTE)
    longest = 1e-4 * float(scene.heat.max())  # s/cm^2
    return (
        '<div style="padding:.2em .8em .8em;font-size:.8em">'
        f'<div style="height:.6em;border-radius:.3em;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between"><span>not touched</span><span>{longest:.3g} s/cm²'
        "</span></div></div>"
    )
