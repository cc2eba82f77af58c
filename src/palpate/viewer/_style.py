"""Style of the figures and their conversion to SVG: text stays text, colours follow the page, ids do not clash."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from palpate.errors import importing_extra
from palpate.spatial.arguments import takes_arrays

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Made = TypeVar("_Made", bound=Callable[..., Any])
INK, MUTED, RULE = "#1b2530", "#5d6975", "#d5dbe1"  # text, what comes second, lines of the grid
AXES = ("#d55e00", "#009e73", "#0072b2")  # x, y, z: Okabe and Ito's colours, told apart by the colour-blind
STATUS = ("#009e73", "#56b4e9", "#d5dbe1", "#9aa5b0", "#d55e00", "#e69f00", "#cc79a7", "#5d6975", "#f0e442")
_THEME = {INK: "currentColor", MUTED: "var(--muted)", RULE: "var(--rule)"}  # a page in the dark has others
_WIDTH = 4.6  # inches of 72 units: on a phone of 360 px a unit is a pixel, and letters keep their size
_IDS = re.compile(r' id="(?:figure|axes|patch|line2d|matplotlib|text|legend|\w*Collection|xtick|ytick)\.?\w*_\d+"')


def mixed(code: str | tuple[int, int, int], white: float) -> tuple[int, int, int]:
    """Return (red, green, blue), 0 to 255 each, of a colour ("#rrggbb" or such a tuple) mixed with a share of white."""
    one = tuple(int(code[at : at + 2], 16) for at in (1, 3, 5)) if isinstance(code, str) else code
    red, green, blue = (round(part + white * (255 - part)) for part in one)
    return red, green, blue


DARK = mixed(INK, 0.0)


def figure(height: float = 2.6) -> Figure:
    """Return an empty figure of the common width and this height [inches]; draw in it within `styled`."""
    from matplotlib.figure import Figure  # not pyplot: no windows, no global state

    return Figure(figsize=(_WIDTH, height), layout="constrained")


def panels(height: float, rows: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a `figure` of this height [inches] and its axes, one below the other; see `Figure.subplots`."""
    drawn = figure(height)
    return drawn, drawn.subplots(rows, **options)


def inline(drawn: Figure) -> str:
    """Return the figure as an SVG element for a page, in the page's colours.

    Raises:
        InputError: matplotlib is not installed.
    """
    page = StringIO()
    with styled():
        if (layout := drawn.get_layout_engine()) is not None:  # once, or all is drawn twice
            layout.execute(drawn)
            drawn.set_layout_engine("none")
        drawn.savefig(page, format="svg", transparent=True, dpi=180, metadata={"Date": None, "Creator": None})
    text = page.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'^<svg[^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" role="img">', text, count=1)
    for colour, name in _THEME.items():
        text = text.replace(colour, name)
    return _IDS.sub("", text).strip()


def save(drawn: Figure, path: Path, kind: str) -> None:
    """Write the figure to a file on a white background; `kind` is svg or png.

    Raises:
        InputError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    with styled():
        drawn.savefig(path, format=kind, dpi=200, metadata={"Date": None} if kind == "svg" else None)


@contextmanager
def styled() -> Generator[None]:
    """Apply the style of all figures within a block or a decorated function.

    Raises:
        InputError: matplotlib is not installed.
    """
    logger = logging.getLogger("matplotlib")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it has two lines to say where nothing can be kept in the home
    try:
        with importing_extra("drawing needs matplotlib", "report"):
            import matplotlib

            matplotlib.get_cachedir()
    finally:
        logger.setLevel(level)
    with matplotlib.rc_context(_RC):
        yield


def plotted(made: _Made) -> _Made:
    """Decorate a function that returns a `Figure`: it takes arrays, and draws in the common style.

    Raises:
        InputError: by the decorated call: matplotlib is not installed, or arrays have other shapes.
    """
    return takes_arrays(styled()(made))


_RC: dict[Any, Any] = {  # matplotlib's own type of the keys has no name
    "svg.fonttype": "none",  # letters stay letters: small, sharp, and to be searched for
    "svg.hashsalt": "palpate",  # the same figure gives the same bytes
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 1.2,
    "legend.columnspacing": 1.2,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.0,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": False,
}
