"""Build the page's panel: caption of the moment, controls of the layers, timeline, plots and settings."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.spatial.shown import three_digits
from palpate.viewer._style import AXES
from palpate.viewer.captions import caption, comparison, touch_list
from palpate.viewer.legend import keys, legend
from palpate.viewer.scene import MAGNIFICATIONS, Scene, SceneMoment
from palpate.viewer.scene3d import DrawSettings
from palpate.viewer.widgets import ELLIPSE, along_time, dock, theme

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, GuiUplotHandle

NUMBERED = 60  # touches whose numbers are drawn: more would hide the body
SPEEDS = {"x 0.1": 0.1, "x 0.5": 0.5, "x 1": 1.0, "x 2": 2.0, "x 5": 5.0, "x 20": 20.0}
WINDOWS = {"all": 0.0, "20 s": 20.0, "5 s": 5.0, "1 s": 1.0}
NOW = "#cc3311"
DIGIT = 1e-4  # s: more are not written; as many fit
_ASKED = {  # by a button
    "previous": "touch -1", "next": "touch 1", "focus contact": "face", "reset view": "frame", "save": "save",
}  # fmt: skip
FORCES, PLACES = slice(0, 2), slice(2, 5)  # columns of the curves


class Panel:
    """Handles of the panel; `show` writes a moment into them.

    Args:
        gui: of one browser, or of the server.
        scene: scene whose moments are shown.
        ask: receives a request (see `BrowserSession.ask`) and the browser that made it.
    """

    def __init__(self, gui: GuiApi, scene: Scene, ask: Callable[[str, ClientHandle | None], None]) -> None:
        self._scene, self._ask, self._gui = scene, ask, gui
        dock(self._gui, scene.title)
        self._now = self._gui.add_html("")
        for layer in scene.layers:
            layer.panel(self._gui)
        self._add_timeline()
        self._touches = self._gui.add_html("")  # content that has not changed is not sent again
        self._add_plots()
        self._add_settings()
        self._legend = self._gui.add_html("")
        self._gui.add_html(keys())
        self._add_controls()

    def settings(self) -> DrawSettings:
        """Return the settings in the panel's controls as a `DrawSettings`."""
        magnification = MAGNIFICATIONS[self._ellipse.options.index(self._ellipse.value)]
        return DrawSettings(self._heat.value, float(self._trail.value), magnification, self._numbers.value)

    @property
    def speed(self) -> float:
        """Playing speed, times real time."""
        return SPEEDS[self._speed.value]

    def show(self, moment: SceneMoment, seconds: float, playing: bool) -> None:
        """Describe a moment in the panel, and mark it in the plots."""
        from viser import Icon

        rows = [row for layer in self._scene.layers for row in layer.rows(self._scene, moment.index)]
        rows += comparison(self._scene, moment)
        self._now.content = caption(moment, self.settings().magnification, rows)
        self._legend.content = legend(self._scene, self._heat.value, float(self._trail.value))
        if self._slider.value != (shown := _short(seconds)):
            self._slider.value = shown
        self._play.label, self._play.icon = ("Pause", Icon.PLAYER_PAUSE) if playing else ("Play", Icon.PLAYER_PLAY)
        self._touches.content = touch_list(self._scene, moment.time)
        self._show_plots(moment)

    def _add_timeline(self) -> None:
        timeline = self._scene.timeline
        duration = max(_short(timeline.duration), DIGIT)
        step = min(max(_short(timeline.step or duration / 1000), DIGIT), duration)
        self._slider = self._gui.add_slider(
            "time [s]", 0.0, duration, step, 0.0, marks=((0.0, "0"), (duration, three_digits(duration)))
        )
        self._play = self._gui.add_button("Play")
        self._skip = self._gui.add_button_group("touch", ("previous", "next", "focus contact"))
        self._speed = self._gui.add_dropdown("speed", tuple(SPEEDS), initial_value="x 1")
        self._slider.on_update(lambda event: self._ask(f"seek {self._slider.value}", None) if event.client else None)
        self._play.on_click(lambda _: self._ask("play", None))
        self._skip.on_click(lambda event: self._ask(_ASKED[self._skip.value], event.client))
        picture = self._gui.add_button_group(
            "picture", ("reset view", "save"), hint="look at the complete body; save the view as a file"
        )
        picture.on_click(lambda event: self._ask(_ASKED[picture.value], event.client))

    def _add_controls(self) -> None:
        """Add keys and clicks: a script, and the field in which it leaves requests."""
        asked = self._gui.add_text("palpate asks", "")
        asked.on_update(lambda event: self._ask(asked.value.partition(" ")[2], None) if event.client else None)
        script = files("palpate.viewer").joinpath("controls.js").read_text(encoding="utf-8")
        self._gui.add_html(f'<style onload="{escape(script)}"></style>')  # viser runs no script element

    def _add_settings(self) -> None:
        with self._gui.add_folder("Show"):
            self._heat = self._gui.add_checkbox(
                "heat",
                not any(layer.covers for layer in self._scene.layers),
                visible=self._scene.body is not None,
                hint="show where the body was touched, and how long",
            )
            few = 0 < len(self._scene.touches) <= NUMBERED
            self._numbers = self._gui.add_checkbox(
                "numbers", False, visible=few, hint="show the numbers of the touches where they were"
            )
            past = 5.0 if self._scene.moving is None else 0.0
            self._trail = self._gui.add_slider("trail [s]", 0.0, 60.0, 0.5, past)
            options = tuple(f"x {times}" for times in MAGNIFICATIONS)
            first = options[MAGNIFICATIONS.index(self._scene.magnification)]
            self._ellipse = self._gui.add_dropdown("ellipse", options, initial_value=first, hint=ELLIPSE)
            dark = self._gui.add_checkbox("dark", False)
        for handle in (self._heat, self._numbers, self._trail, self._ellipse, self._window):
            handle.on_update(lambda event: self._ask("refresh", None))
        dark.on_update(lambda _: theme(self._gui, dark.value))

    def _add_plots(self) -> None:
        self._window = self._gui.add_dropdown("plots", tuple(WINDOWS), initial_value="all")
        self._whole = self._scene.curves()
        forces = ("total", "strongest") if self._scene.several else ("normal force", "force")
        inks = ("#9aa5b0", "#0072b2")
        if self._scene.other is not None:
            forces, inks = (self._scene.other.title, forces[1]), ("#007850", "#0072b2")
        self._force = self._plot(FORCES, forces, inks, "N")
        self._place = self._plot(PLACES, ("x", "y", "z"), AXES, "mm")

    def _plot(self, which: slice, names: tuple[str, ...], inks: tuple[str, ...], unit: str) -> GuiUplotHandle:
        """Add a plot: lines of forces, dots of places."""
        from viser import uplot

        dots = unit == "mm"
        lines = [
            uplot.Series(
                label=f"{name} [{unit}]",
                stroke=ink,
                width=0 if dots else 1.25,
                points=uplot.Series_Points(show=dots, size=2, width=1, stroke=ink, fill=ink),
            )
            for name, ink in zip(names, inks, strict=True)
        ]
        mark = uplot.Series(label="now", stroke=NOW, width=1.5, points=uplot.Series_Points(show=False))
        clock, values = self._whole
        bounds = _range(values[:, which], which == FORCES)
        return self._gui.add_uplot(
            _marked(clock, values[:, which], 0.0, bounds),
            (uplot.Series(label="time [s]"), *lines, mark),
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=bounds)},
            cursor=uplot.Cursor(sync=uplot.Cursor_Sync(key="palpate")),
            **along_time(),
        )

    def _show_plots(self, moment: SceneMoment) -> None:
        clock, values = self._whole
        if width := WINDOWS[self._window.value]:
            span = self._scene.timeline.span(moment.seconds - width / 2, moment.seconds + width / 2)
            clock, values = self._scene.curves(span)
        for plot, which in ((self._force, FORCES), (self._place, PLACES)):
            bounds = _range(self._whole[1][:, which], which == FORCES)
            plot.data = _marked(clock, values[:, which], moment.seconds, bounds)


def _short(seconds: float) -> float:
    """Round the time up to the next `DIGIT`, so that the sample at a time is not after it."""
    return round(float(np.ceil(round(seconds / DIGIT, 3))) * DIGIT, 4)


def _range(values: Float[np.ndarray, "m k"], zero: bool) -> tuple[float, float]:
    """Return the bounds of an axis with some air; with `zero`, 0 is among them."""
    known = values[np.isfinite(values)]
    known = np.append(known, 0.0) if zero or not len(known) else known
    low, high = float(known.min()), float(known.max())
    air = 0.05 * (high - low) or 1.0
    return low - air, high + air


def _marked(
    clock: Float[np.ndarray, " m"], values: Float[np.ndarray, "m k"], now: float, bounds: tuple[float, float]
) -> tuple[Float[np.ndarray, " r"], ...]:
    """Return the columns of a plot, and one that marks the current time; NaN is put far below."""
    below, above = bounds[0] - 10 * (bounds[1] - bounds[0]), bounds[1] + 1.0
    at = int(np.searchsorted(clock, now))
    rows = np.where(np.isfinite(values), values, below)
    rows = np.insert(rows, at, rows[[max(at - 1, 0)] * 3], axis=0)
    mark = np.full(len(rows), below)
    mark[at + 1] = above
    return (np.insert(clock, at, [now] * 3), *(np.ascontiguousarray(column) for column in rows.T), mark)
