"""Show a stream on a page: the body with the current contacts, the force over ten seconds, and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from html import escape
from time import monotonic

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.surfaces import Surface
from palpate.viewer.captions import caption
from palpate.viewer.legend import legend
from palpate.viewer.samples import sample_starts, totals
from palpate.viewer.scene import MAGNIFICATIONS, Layer, Scene, moment_of, no_contacts, prepare
from palpate.viewer.scene3d import DrawSettings, Scene3D, aim
from palpate.viewer.server import Served
from palpate.viewer.timeline import downsampled
from palpate.viewer.widgets import ELLIPSE, add_curves, dock, table, theme

SECONDS = 10.0  # of a window
ROWS = 600  # of the curve
FINE = 4  # parts of what is added to a window at once
SETTLED = 2.0  # s between two scales of arrows and ellipses
AUTO = "auto"
SILENT = 1.0  # s without a sample, after which the page says so
_RED, _GREY = "#cc3311", "#8a96a1"


@dataclass(frozen=True)
class StreamFigures:
    """Figures of a stream that a page shows.

    Attributes:
        rate: [Hz] of the last seconds.
        latency: [s] from a sample's arrival to its contacts: median, 99 %, largest of the last ten seconds; None: not
            known.
        lost: samples that the device sent and that never came.
        skipped: samples that this page was too slow to show; they are recorded all the same.
        silent: [s] since the last sample.
        samples: samples received so far.
        taring: True if a tare was requested and is not taken yet.
        tare: last sentence on a tare; "": none.
        events: times [ns since 1970] and the last sentences, the newest last.
    """

    rate: float = 0.0
    latency: tuple[float, float, float] | None = None
    lost: int = 0
    skipped: int = 0
    silent: float = 0.0
    samples: int = 0
    taring: bool = False
    tare: str = ""
    events: tuple[tuple[int, str], ...] = ()


class LivePage(Served):
    """A page that shows a stream, served as `Served` is.

    Unchanged values are not sent; data that a browser does not fetch is replaced by newer data.

    Args:
        surface: the body; None: the layers show it.
        layers: drawings that the sensor adds.
        title: heading of the page.
        tare: called with the browser's address when a person requests a tare.
        host: to listen at; only this machine reaches the default.
        port: first to try; 0: any.
        token: secret that opens the page; "": a new one.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """

    def __init__(
        self,
        surface: Surface | None,
        layers: Sequence[Layer],
        title: str,
        tare: Callable[[str], None],
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str = "",
    ) -> None:
        self.scene: Scene = prepare(surface, no_contacts(), title, layers)
        super().__init__(host, port, token)
        self.look(lambda aspect: aim(self.scene, aspect))
        from palpate.viewer.viser_door import browser_address  # here: it needs viser, which is there now

        self._scaled = -np.inf
        gui = self._server.gui
        with self._server.atomic():
            self._scene3d = Scene3D(self._server, self.scene)
            dock(gui, title)
            self._alarm = gui.add_html("")
            self._now = gui.add_html("")
            for layer in layers:
                layer.panel(gui)
            self._force = add_curves(gui, ("force [N]",), ("#0072b2",), (-SECONDS, 0.0))
            self._figures = gui.add_html("")
            self._tare = gui.add_button(
                "Tare", hint="use the present reading as that of no contact; nothing may touch the sensor"
            )
            self._add_settings()
            self._sentences = gui.add_html("")
            self._legend = gui.add_html("")
        self._tare.on_click(lambda event: tare(browser_address(self._server, event.client_id)))
        if surface is not None:
            surface.project(self.scene.bounds[:1])  # loads machine code before somebody watches
        self._scene3d.show(self.scene.at(0), DrawSettings(heat=False, trail=0.0, magnification=1))
        self.tell(None, StreamFigures())

    @property
    def watched(self) -> bool:
        """True while a browser is connected."""
        return bool(self._server.get_clients())

    def at_once(self) -> AbstractContextManager[None]:
        """Return a context within which all that is shown reaches a browser as one message."""
        return self._server.atomic()

    def show(self, found: Contacts) -> None:
        """Draw the contacts of one sample, in the surface's frame; meant for up to thirty calls a second."""
        hardest = float(np.fmax.reduce(np.linalg.norm(found.force, axis=1)))
        self.scene = self._scene3d.scene = self.scene.scaled_to(hardest)  # scales are some seconds old
        scene = self.scene.with_contacts(found) if self.scene.layers else self.scene
        with self._server.atomic():
            self._scene3d.move(scene, moment_of(found), self._magnification)

    def tell(self, window: Contacts | None, figures: StreamFigures) -> None:
        """Update the page's words, figures, curve and trail; meant for a few calls a second.

        Args:
            window: contacts of the last seconds, see `recent`; None: not known yet.
            figures: of the stream.
        """
        if window is not None:
            self.scene = self.scene.with_contacts(window)
            if monotonic() - self._scaled > SETTLED:  # not with every picture, or arrows would breathe
                self.scene, self._scaled = self.scene.scaled(), monotonic()
        scene = self._scene3d.scene = self.scene
        moment = scene.at(len(scene) - 1)
        rows = [row for layer in scene.layers for row in layer.rows(scene, moment.index)]
        with self._server.atomic():
            self._scene3d.show_trail(moment, float(self._trail.value))
            self._now.content = caption(moment, self._magnification, rows)
            self._legend.content = legend(scene, False, float(self._trail.value))
            self._force.data = self._curve(figures.silent)
            self._alarm.content = _alarm(figures)
            self._figures.content = _described(figures)
            self._sentences.content = _sentences(figures)
            self._tare.label = "Taring" if figures.taring else "Tare"
            self._tare.disabled = figures.taring

    def _curve(self, silent: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s], 0 being now, and forces [N], 0 for NaN, of the curve."""
        timeline = self.scene.timeline
        clock, force = downsampled(timeline.clock, self.scene.total[:, None], ROWS)
        return clock - timeline.duration - (silent if silent > SILENT else 0.0), np.nan_to_num(force[:, 0])

    @property
    def _magnification(self) -> int:
        chosen = self._ellipse.value
        return self.scene.magnification if chosen == AUTO else int(chosen.removeprefix("x "))

    def _add_settings(self) -> None:
        gui = self._server.gui
        with gui.add_folder("Show", expand_by_default=False):
            self._trail = gui.add_slider("trail [s]", 0.0, SECONDS, 0.5, 2.0)
            options = (AUTO, *(f"x {times}" for times in MAGNIFICATIONS))
            self._ellipse = gui.add_dropdown("ellipse", options, initial_value=AUTO, hint=ELLIPSE)
            dark = gui.add_checkbox("dark", False)
        dark.on_update(lambda _: theme(gui, dark.value))


def recent(window: Contacts | None, new: Contacts) -> Contacts:
    """Return the `Contacts` of the last ten seconds: of the new samples the last and some of extreme force."""
    starts = sample_starts(new)
    force = np.nan_to_num(totals(new, starts))
    wanted = np.zeros(len(starts), dtype=bool)
    parts = np.array_split(force, max(1, min(FINE, len(force))))
    first = np.cumsum([0, *(len(part) for part in parts[:-1])])
    for begin, part in zip(first.tolist(), parts, strict=True):
        wanted[[begin + int(part.argmin()), begin + int(part.argmax())]] = True
    wanted[-1] = True
    some = new[np.repeat(wanted, np.diff(starts, append=len(new)))]
    whole = some if window is None else Contacts.joined([window, some])
    newest = float(whole.time[-1])
    return whole[(whole.time > newest - SECONDS) & (whole.time <= newest)]  # a clock that was set back begins anew


def _alarm(figures: StreamFigures) -> str:
    """Return the alarm that no samples arrive, as HTML; "" while they do."""
    if figures.silent <= SILENT and figures.samples:
        return ""
    for_long = f"no samples for {figures.silent:.0f} s"
    text = f"{for_long}: the values shown are old" if figures.samples else f"{for_long}: none came yet"
    return (
        f'<div role="alert" style="margin:.5em .7em 0;padding:.35em .7em;border-radius:.4em;color:#fff;'
        f'background:{_RED};font-weight:600">{text}</div>'
    )


def _described(figures: StreamFigures) -> str:
    latency = "&ndash;"
    if figures.latency is not None:
        middle, most, worst = (f"{1e6 * value:,.0f}" for value in figures.latency)
        latency = f"median {middle}, 99&nbsp;% {most}, worst {worst} &micro;s"
    drops = f"{figures.lost:,} lost" + (f", {figures.skipped:,} not shown" if figures.skipped else "")
    if figures.lost:
        drops = f'<span style="color:{_RED};font-weight:600">{drops}</span>'
    rows = [
        ("rate", f"<b>{figures.rate:,.0f} Hz</b>"),
        ("latency", latency),
        ("samples", f"{figures.samples:,}, {drops}"),
        ("tare", escape(figures.tare) if figures.tare else "none yet"),
    ]
    return (
        '<div style="padding:.3em .7em 0;font-size:.8em;line-height:1.45;font-variant-numeric:tabular-nums">'
        f"{table(rows)}</div>"
    )


def _sentences(figures: StreamFigures) -> str:
    """Return the events as HTML, the newest first."""
    if not figures.events:
        return ""
    lines = "".join(
        f'<div><span style="color:{_GREY}">{datetime.fromtimestamp(1e-9 * stamp):%H:%M:%S}</span> {escape(said)}</div>'
        for stamp, said in reversed(figures.events)
    )
    return (
        '<div style="padding:.2em .7em .6em;font-size:.75em;line-height:1.4;overflow-wrap:anywhere;'
        f'font-variant-numeric:tabular-nums">{lines}</div>'
    )
