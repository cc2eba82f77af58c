"""Make the list of a scene's touches that can be clicked: number, time, peak, place."""

from __future__ import annotations

import numpy as np

from palpate.viewer.scene import Scene

__all__ = ["touch_list"]

_SEEN = """const list = this.previousElementSibling;
list.scrollTop = {} * list.querySelector('tr').getBoundingClientRect().height"""
LISTED = 500  # touches: a longer list is slow to send, and nobody reads it


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
            f"<td>{seconds:.2f}</td><td>{found.peak_force[k]:.2f}</td><td>{place}</td></tr>"
        )
    more = f"<div>and {len(found) - LISTED:,} more</div>" if len(found) > LISTED else ""
    head = "".join(f"<th>{name}</th>" for name in ("touch", "at [s]", "peak [N]", "mean x y z [mm]"))
    return (
        "<style>.palpate-touches { margin: .2em .8em .6em; max-height: 10.5em; overflow-y: auto; font-size: .8em; }"
        ".palpate-touches table { width: calc(100% - .8em); text-align: right; border-collapse: collapse; }"
        ".palpate-touches td, .palpate-touches th { padding: 0; line-height: 1.5em; height: 1.5em; }"
        ".palpate-touches th { position: sticky; top: 0; background: var(--mantine-color-body); }</style>"
        '<div class="palpate-touches" style="font-variant-numeric:tabular-nums"><table>'
        f"<thead>{head}</thead><tbody>{''.join(lines)}</tbody></table>{more}</div>"
        f'<style onload="{_SEEN.format(max(marked - 2, 0))}"></style>'
    )
