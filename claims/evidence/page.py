"""The page: how soon there is a picture, and how quickly a million samples can be scrubbed.

It depends on the machine and on what else runs there. A browser without a graphics card draws in software: an empty
page of viser, opened in turn with ours, shows how much of the time is not ours.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from time import monotonic, perf_counter, sleep, time
from typing import Any

import numpy as np

from claims.evidence.bodies import BODIES, R, mesh_of, path
from claims.row import Row
from palpate import Locator
from palpate.contact.contacts import Contacts
from palpate.surfaces import Mesh
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.server import Page

BODY = "ellipsoid 1 : 0.7 : 0.5"
RATE = 1000.0  # Hz
NOISE = np.array([0.02] * 3 + [0.001] * 3)  # N, N m
CHROMIUM = shutil.which("chromium")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking")
REPEATS = 5
PATIENCE = 120.0  # s
LARGE = 10_000  # indices of one drawing: the body
WATCH = """
const gl = WebGL2RenderingContext.prototype, clear = gl.clear, draw = gl.drawElements;
const now = () => performance.timeOrigin + performance.now();
gl.clear = function (...rest) { window.frame ??= now(); return clear.apply(this, rest); };
gl.drawElements = function (mode, count, ...rest) {
    if (count > LARGE) window.body ??= now();
    return draw.call(this, mode, count, ...rest);
};
""".replace("LARGE", str(LARGE))
PAINTED = "performance.timeOrigin + performance.getEntriesByName('first-contentful-paint')[0].startTime"


def rows(small: bool) -> Iterator[Row]:
    """Preparing, scrubbing, and in full the first picture; small is not judged, as it would be timed."""
    count = 20_000 if small else 1_000_000
    mesh, found = _contacts(count)
    begin = perf_counter()
    scene = prepare(mesh, found, "evidence")
    took = perf_counter() - begin
    with Page(scene, port=0, together=True) as page:  # drawn where no browser is, too
        up = perf_counter() - begin - took
        got = f"{took:.2f} s, then {up:.2f} s until the server is up"
        yield Row(f"preparing {count:,} samples, a body of 20k facets", "", got)
        yield _scrubbed(page, "no browser", 0.5 if small else 5.0, None if small else 10.0)
        if not small:
            yield from _with_browser(page)
    if not small:
        yield from _first_paint(scene)


def _contacts(count: int) -> tuple[Mesh, Contacts]:
    """A finger that slides over the body, and lets go every second."""
    body, times = BODIES[BODY], np.arange(count) / RATE
    _, wrenches = path(body, count, 1e-5, 0.1 * R)
    mesh = mesh_of(body, 20_000)
    press = np.maximum(0.0, np.sin(np.pi * times))
    return mesh, Contacts.single(times, Locator(mesh, noise=NOISE).run(press[:, None] * wrenches))


def _scrubbed(page: Page, what: str, seconds: float, least: float | None) -> Row:
    """A slider that is thrown about: wishes at some 200 Hz, of which the page draws the latest."""
    rng, end, shown, last = np.random.default_rng(79), monotonic() + seconds, 0, page.session.index
    while monotonic() < end:
        page.session.seek(float(rng.uniform(0.0, page.scene.timeline.duration)))
        sleep(0.005)
        shown, last = shown + (page.session.index != last), page.session.index
    rate, target = shown / seconds, "" if least is None else f"> {least:g} a second"
    got = f"{rate:.1f} updates a second (20 are the most that it makes)"
    return Row(f"scrubbing {len(page.scene):,} samples, {what}", target, got, None if least is None else rate > least)


def _with_browser(page: Page) -> Iterator[Row]:
    """The same while Debian's chromium draws it on the same machine."""
    if CHROMIUM is None:
        yield Row("scrubbing with a browser", "> 10 a second", "skipped: no chromium")
        return
    with browser() as view:
        view.goto(page.address)
        view.wait_for_function("window.body")
        yield _scrubbed(page, "chromium drawing it in software beside it", 5.0, 10.0)


def _first_paint(scene: Scene) -> Iterator[Row]:
    """In a browser that is open already, with nothing of the page in its cache."""
    what, target = "first paint after the server says that it is up", "<= 2 s"
    if CHROMIUM is None:
        yield Row(what, target, "skipped: no chromium")
        return
    pairs = np.array([[_painted(scene), _painted(None)] for _ in range(REPEATS)])
    (first, frame, body), (bare, bare_frame, _) = np.median(pairs, axis=0)
    of = f"medians of {REPEATS}, chromium drawing in software"
    got = f"{first:.2f} s; an empty viser page {bare:.2f} s ({of})"
    yield Row(f"{what}, by the browser (first contentful paint)", target, got, first <= 2.0)
    got = f"{frame:.2f} s, {body:.2f} s; an empty viser page's first frame {bare_frame:.2f} s ({of})"
    yield Row("from when it is up to the first frame in 3D, and to the body of 20k facets in it", "", got)


def _painted(scene: Scene | None) -> tuple[float, float, float]:
    """Seconds from when the server is up to the browser's first paint, the first frame, and the body in it."""
    with browser() as view, _server(scene) as address:
        up = time()
        view.goto(address)
        view.wait_for_function("window.frame" if scene is None else "window.body")
        moments = [view.evaluate(each) for each in (PAINTED, "window.frame", "window.body ?? NaN")]
    return tuple(float("nan") if moment is None else moment / 1e3 - up for moment in moments)


@contextmanager
def _server(scene: Scene | None) -> Iterator[str]:
    if scene is not None:
        with Page(scene, port=0) as page:
            yield page.address
        return
    from viser import ViserServer

    with redirect_stdout(StringIO()):  # it announces itself
        server = ViserServer("127.0.0.1", 0, verbose=False)
        try:
            yield f"http://127.0.0.1:{server.get_port()}"
        finally:
            server.stop()


@contextmanager
def browser() -> Iterator[Any]:
    """An empty page of a browser with a profile of its own."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        view = launched.new_page(viewport={"width": 1280, "height": 800})
        view.set_default_timeout(1e3 * PATIENCE)
        view.add_init_script(WATCH)
        try:
            yield view
        finally:
            launched.close()
