"""Describe what is drawn and its colours, as HTML: a strip below the scene, on a phone above it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from palpate.viewer.camera import PANEL, PHONE
from palpate.viewer.heat import PALETTE
from palpate.viewer.marker import FORCE, OTHER, POINT, TORQUE, TRACE
from palpate.viewer.scene import Scene, rounded_up

_ARROW = "rgb(40,140,205)"  # of what the page's lights make of a force
AXES = ((200, 40, 40), (40, 150, 40), (40, 70, 200))  # x, y, z
_GLYPHS = {  # 28 x 18 each
    "arrow": '<path d="M2 15 L20 5" stroke="{0}" stroke-width="3"/><path d="M26 2 L16.5 3.5 L20.5 10 Z" fill="{0}"/>',
    "ring": '<ellipse cx="14" cy="9" rx="11" ry="6" fill="rgba(0,48,120,.25)" stroke="{0}" stroke-width="2"/>',
    "curl": '<path d="M9 15 A7 7 0 1 1 20 13" fill="none" stroke="{0}" stroke-width="3"/>'
    '<path d="M24 9 L15 12 L22 18 Z" fill="{0}"/>',
    "dot": '<circle cx="14" cy="9" r="5" fill="{0}"/>',
    "line": '<path d="M2 9 L26 9" stroke="{0}" stroke-width="3"/>',
}
_KEYS = (
    ("space", "play, pause"),
    ("&larr; &rarr;", "touch before, touch after"),
    ("shift &larr; &rarr;", "touched sample before, after"),
    ("click", "in a plot or a line of the list: go there"),
)
_LOOK = """<style>@media (max-width: PHONEpx), (min-width: 1000px) { .palpate-legend {
  position: fixed; left: 0; box-sizing: border-box; padding: .5em 1em !important;
  pointer-events: none; background: color-mix(in srgb, var(--mantine-color-body) 80%, transparent);
} }
@media (max-width: PHONEpx) { .palpate-legend { top: 0; right: 0; font-size: .7em !important; gap: 0 1em !important } }
@media (min-width: 1000px) { .palpate-legend { bottom: 0; max-width: calc(100vw - PANELpx) } }
</style>""".replace("PANEL", str(PANEL)).replace("PHONE", str(PHONE))  # between them, it stays in the panel


def item(glyph: str, ink: str, words: str) -> str:
    """Return a glyph in a CSS colour with its meaning, as HTML.

    Raises:
        KeyError: there is no such glyph.
    """
    drawn = _GLYPHS[glyph].format(ink)
    return f'<svg width="28" height="18" style="flex:none" aria-hidden="true">{drawn}</svg><span>{words}</span>'


def dot(ink: tuple[int, int, int], words: str) -> str:
    """Return a dot of a colour with its meaning, as HTML."""
    return item("dot", _css(ink), escape(words))


def bar(words: str, most: float, unit: str) -> str:
    """Return the bar of colours from 0 to the largest value, as HTML."""
    stops = ",".join(_css(colour) for colour in PALETTE.tolist())
    ramp = f'<span style="width:6em;height:.6em;border-radius:.3em;background:linear-gradient(90deg,{stops})"></span>'
    return f"<span>{escape(words)} 0</span>{ramp}<span>{most:.3g} {escape(unit)}</span>"


def strip(items: list[str]) -> str:
    """Return the strip of all items, as HTML."""
    rows = "".join(f'<span style="display:flex;align-items:center;gap:.5em">{each}</span>' for each in items)
    return (
        f'{_LOOK}<div class="palpate-legend" style="display:flex;flex-wrap:wrap;gap:.2em 1.3em;padding:.2em .8em .8em;'
        f'font-size:.8em;line-height:1.4">{rows}</div>'
    )


def legend(scene: Scene, heat: bool, trail: float) -> str:
    """Return the legend of a scene as HTML, with or without heat, and with a trail of `trail` seconds."""
    items = [
        item("arrow", _ARROW, "force on the body"),
        item("ring", _lit(FORCE), "95 % ellipse"),
        item("arrow", _lit(POINT), "normal"),
    ]
    if trail:
        items.append(item("line", _lit(TRACE.mean(axis=0)), f"places of the last {trail:g} s"))
    if scene.turns:
        items.append(item("curl", _lit(TORQUE), "torque about the normal"))
    if scene.other is not None:
        items += [dot(FORCE, scene.title), dot(OTHER, scene.other.title)]
    if heat and scene.body is not None:
        items.append(bar("time touched per area", 1e-4 * float(scene.heat.max()), "s/cm²"))
    items += [each for layer in scene.layers for each in layer.legend()]
    axes = "".join(f'<b style="color:{_css(ink)}">{name}</b>&thinsp;' for name, ink in zip("xyz", AXES, strict=True))
    items.append(f"<span>axes {axes}, grid {1e3 * rounded_up(scene.size / 12):g} mm</span>")
    return strip(items)


def _css(ink: Sequence[int] | Sequence[float]) -> str:
    return "rgb({:.0f},{:.0f},{:.0f})".format(*ink)


def _lit(ink: ArrayLike) -> str:
    """Return the colour in which the page shows a line, as it takes the line's colour as linear."""
    return _css((255 * (np.asarray(ink) / 255) ** (1 / 2.2)).tolist())


def keys() -> str:
    """Return the list of keys and what they do, as HTML."""
    rows = "".join(f'<div><kbd style="opacity:.75">{key}</kbd>&ensp;{words}</div>' for key, words in _KEYS)
    return f'<div style="padding:.2em .8em .8em;font-size:.8em;line-height:1.5">{rows}</div>'
