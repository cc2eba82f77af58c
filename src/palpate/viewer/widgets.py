"""Provide the parts of all pages' panels: their look, curves over time, tables of figures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from viser import GuiApi, GuiUplotHandle

ELLIPSE = "magnification of the 95 % ellipse of a point"
TARGET = "#5d6975"
_TITLE = """<style onload="document.title='Palpate'"></style>"""  # viser names its page after itself
_SHEET = """<style>@media (max-width: 600px) {
.mantine-Paper-root[style*="position: fixed"][style*="bottom: 0px"] {
  width: 100% !important; max-height: 46% !important;
}
.mantine-Paper-root[style*="position: fixed"] div[style="width: 20em;"] { width: 100% !important; }
}
.mantine-Slider-markLabel { translate: 0 .25em; }
.mantine-Paper-root .mantine-ScrollArea-root::after {
  content: ""; position: absolute; inset: auto 11px 0 0; height: 3em; z-index: 9; pointer-events: none;
  background: linear-gradient(transparent, var(--mantine-color-body) 80%);
}
.mantine-Paper-root .mantine-ScrollArea-content { padding: 0 .4em 3em 0; }</style>"""
# viser's sheet covers three fifths of a phone, and not its whole width; its sliders' knobs cover their end labels,
# its bar what is at the right; what goes on below the edge fades there, so that no line looks as if it were cut


def theme(gui: GuiApi, dark: bool) -> None:
    """Set the page's theme, dark or light, without viser's logo and share button."""
    gui.configure_theme(
        control_width="large", dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(0, 114, 178)
    )


def name(gui: GuiApi, title: str) -> None:
    """Dock the panel at the right under the page's title; on a phone it is a sheet below."""
    theme(gui, dark=False)
    gui.set_panel_label(f"Palpate \u00b7 {title}" if title else "Palpate")
    gui.main_panel.dock_right()


def dock(gui: GuiApi, title: str) -> None:
    """Dock the panel as `name` does, and add the page's title and the style of the sheet."""
    name(gui, title)
    gui.add_html(_TITLE + _SHEET)


def card(number: str, status: str, ink: str, meaning: str, rows: Sequence[tuple[str, str]], more: str = "") -> str:
    """Return a card with the current state as HTML.

    Args:
        number: main value with its unit.
        status: word, shown in a ring.
        ink: CSS colour of the ring.
        meaning: tooltip of the status.
        rows: (name, value) of the table below, HTML.
        more: HTML after the table.
    """
    ring = f"padding:.05em .7em;border-radius:1em;border:2px solid {ink}"
    return (
        '<div class="palpate-card" style="padding:.3em .7em 0;font-size:.8em;line-height:1.45;'
        'font-variant-numeric:tabular-nums"><div style="display:flex;align-items:center;gap:.7em">'
        f'<span style="font-size:2.2em;font-weight:600;white-space:nowrap">{number}</span>'
        f'<span style="{ring}" title="{escape(meaning)}">{status}</span></div>{table(rows)}{more}</div>'
    )


def table(rows: Sequence[tuple[str, str]]) -> str:
    """Return a table of (name, value) rows as HTML."""
    made = "".join(
        f'<tr><td style="opacity:.6;padding-right:.8em;white-space:nowrap;vertical-align:top">{name}</td>'
        f"<td>{value}</td></tr>"
        for name, value in rows
    )
    return f"<table>{made}</table>"


def add_curves(
    gui: GuiApi,
    names: Sequence[str],
    inks: Sequence[str],
    span: tuple[float, float] | None = None,
    target: str = "",
) -> GuiUplotHandle:
    """Add a plot of lines over time [s]; return its handle, whose `data` is set later: times, and each line.

    Args:
        gui: panel to add it to.
        names: names of the lines, with their units.
        inks: their colours.
        span: [s] that is shown; None: all data.
        target: name of a dashed line behind the others; "": none.
    """
    from viser import uplot

    curves: list[Any] = [
        uplot.Series(label=name, stroke=ink, width=1.25) for name, ink in zip(names, inks, strict=True)
    ]
    if target:
        curves.append(uplot.Series(label=target, stroke=TARGET, width=1.25, dash=(6.0, 4.0)))
    across = uplot.Scale(time=False) if span is None else uplot.Scale(time=False, range=span)
    return gui.add_uplot(
        tuple(np.zeros(1) for _ in range(1 + len(curves))),
        (uplot.Series(label="time [s]"), *curves),
        scales={"x": across},
        **along_time(),
    )


def along_time() -> dict[str, Any]:
    """Return the options of `add_uplot` for a plot over time."""
    from viser import uplot

    bare = uplot.Axis_Ticks(show=False)
    return {
        "axes": (uplot.Axis(label="time [s]", labelSize=18, size=28, ticks=bare), uplot.Axis(space=18, ticks=bare)),
        "legend": uplot.Legend(show=True, live=False),
        "height": 165,
        "padding": (8, 16, 0, 0),
    }
