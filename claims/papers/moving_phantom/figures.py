"""Figure 10, ours: the phantom, the probe and the force over time, with the paper's law and with ours."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from claims.papers.moving_phantom.study import Found
from palpate.viewer._style import AXES, INK, MUTED, figure, save, styled

FOLDER = Path(__file__).parent
EVERY = 4  # samples


def figure_10(found: Mapping[str, Found]) -> None:
    """Draw a column a motion, with the paper's law and with ours: surface and probe above, force below."""
    panels = {
        "vertical": ("paper vertical 10", "ours vertical"),
        "in-plane": ("paper in-plane 10", "ours in-plane 10"),
        "out-of-plane": ("paper out-of-plane 10", "ours out-of-plane 10"),
    }
    with styled():
        drawn = figure(3.4)
        axes: Any = drawn.subplots(2, len(panels), sharex=True, sharey="row", height_ratios=(3, 2))
        for (above, below), (title, names) in zip(axes.T, panels.items(), strict=True):
            traces = [found[name].traces[0] for name in names]
            for colour, name, trace in zip((AXES[0], AXES[2]), ("the paper's law", "ours"), traces, strict=True):
                time = trace.since[::EVERY]
                vertical = trace.condition.direction == "vertical"
                surface, probe = (trace.column(each)[::EVERY] for each in ("surface", "probe"))
                scale = 1e3 if vertical else np.degrees(1.0)
                if vertical:  # the tip stands in the tissue: from where it was at the beginning
                    probe = probe - probe[np.searchsorted(time, 0.0)]
                if colour == AXES[0]:
                    above.plot(time, scale * surface, color=INK, linewidth=0.8, label="phantom")
                above.plot(time, scale * probe, color=colour, linewidth=0.8, label=name)
                below.plot(time, trace.column("press")[::EVERY], color=colour, linewidth=0.7)
            above.set_title(title, color=MUTED)
            below.set_xlabel("time [s]")
            below.set_xlim(-0.5, float(traces[0].since[-1]))
            below.set_ylim(4.5, 9.5)
        axes[0, 0].set_ylabel("[mm], [deg]")
        axes[1, 0].set_ylabel("force [N]")
        handles, names = axes[0, 0].get_legend_handles_labels()
        drawn.legend(handles, names, loc="outside upper center", ncols=3)
        drawn.align_ylabels()
        save(drawn, FOLDER / "figure_10.png", "png")
