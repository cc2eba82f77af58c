"""The page in Debian's chromium: it is drawn, its slider works, and the picture shows what it should."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from palpate.viewer.camera import SHEET, STRIP
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.server import Page
from tests.support.browser import PATIENCE, opened, until
from tests.support.pages import ellipsoid, session


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Of 20 s, 10 of them touched: on a busy machine a shorter one is over before anybody could stop its play."""
    return prepare(ellipsoid(2_000), session(rate=20.0), title="session")


@pytest.fixture(scope="module")
def page(scene: Scene) -> Iterator[Page]:
    with Page(scene, port=0) as served:
        yield served


@pytest.fixture(scope="module")
def view(browser: object, page: Page) -> Iterator[object]:
    shown = browser.new_page(viewport={"width": 1280, "height": 800})
    shown.set_default_timeout(1e3 * PATIENCE)
    shown.asked = []
    shown.on("request", lambda request: shown.asked.append(request.url))
    shown.goto(page.address)
    shown.wait_for_selector("canvas")
    shown.get_by_text("contact", exact=True).wait_for()
    yield shown
    shown.close()


def _picture(view: object) -> np.ndarray:
    import imageio.v3

    return imageio.v3.imread(BytesIO(view.screenshot()))[..., :3].astype(int)


def _warm(picture: np.ndarray) -> int:
    """Pixels of yellow and orange in the space, below what the browser says of graphics cards and above the legend."""
    red, green, blue = np.moveaxis(picture[200:560, :860], -1, 0)
    return int(
        np.count_nonzero((red - blue > 60) & (green - blue > 25))
    )  # the x axis is red, even where it fades to white


def _shaded(picture: np.ndarray) -> int:
    """Pixels of the space that are grey: the body, and a few lines of the grid."""
    space = picture[200:560, :860]
    return int(np.count_nonzero((space.max(axis=-1) < 235) & (np.ptp(space, axis=-1) < 40)))


def test_the_page_is_drawn(view: object, tmp_path: Path) -> None:
    """A body of 60 x 40 x 30 mm in 860 x 800 pixels, with the traces of a touch of 10 s."""
    until(lambda: _warm(_picture(view)) > 100 and _shaded(_picture(view)) > 20_000, "no warm body is to be seen")
    view.screenshot(path=str(tmp_path / "page.png"))
    assert view.title() == "Palpate"


def test_the_slider_moves_everything(view: object, page: Page) -> None:
    """Through the page's own elements: keys on the slider's thumb."""
    before, shown = page.session.index, view.inner_text("table")
    thumb = view.get_by_role("slider").first
    thumb.focus()
    for _ in range(5):
        thumb.press("ArrowRight")
    until(lambda: page.session.index == before + 5, "the server does not hear the slider")
    until(lambda: f"sample {before + 5}" in view.inner_text("table"), "the panel does not follow")
    assert view.inner_text("table") != shown
    thumb.press("Home")
    until(lambda: page.session.index == 0, "the server does not hear the slider")
    view.get_by_text("no contact", exact=True).first.wait_for()


def test_next_leads_to_the_touch_and_play_runs(view: object, page: Page, scene: Scene) -> None:
    page.session.seek(0.0)
    view.get_by_role("button", name="next").click()
    until(lambda: page.session.index == scene.timeline.touches[0], "no step to the touch")
    view.get_by_role("button", name="Play").click()
    until(lambda: page.session.index > scene.timeline.touches[0] + 5, "it does not play")
    view.get_by_role("button", name="Pause").click()
    until(lambda: not page.session.playing, "it does not pause")


def test_the_camera_turns_to_the_side_that_is_touched(view: object, page: Page, scene: Scene) -> None:
    """Seen against the normal, whatever side it was seen from before; the browser says where its camera is."""

    def there() -> bool:  # a click of the test before may come late on a busy machine, and play on
        page.session.play(False)
        page.session.seek(10.0)
        return page.session.index == 200

    until(there, "no seeking")
    view.get_by_role("button", name="focus contact").click()
    client = next(iter(page._server.get_clients().values()))
    normal = scene.at(200).contacts[0].normal
    until(lambda: client.camera.position @ normal > 0.7 * np.linalg.norm(client.camera.position), "it does not turn")


def test_heat_can_be_hidden(view: object) -> None:
    view.get_by_role("checkbox").first.uncheck()
    until(lambda: _warm(_picture(view)) < 20, "the heat stays")
    view.get_by_role("checkbox").first.check()
    until(lambda: _warm(_picture(view)) > 100, "the heat does not come back")


def test_the_page_asks_nobody_else(view: object, page: Page) -> None:
    """Neither fonts nor textures nor scripts come from elsewhere: it works, and tells nothing, without a network."""
    own = page.address.partition("?")[0]
    foreign = [url for url in view.asked if not url.startswith((own, f"blob:{own}", "data:"))]
    assert foreign == []


def test_nothing_of_the_page_is_cut_or_lies_on_something_else(view: object) -> None:
    """The legend is a strip left of the panel, as high as the camera leaves free at most; the panel cuts no line."""
    legend = view.locator(".palpate-legend").bounding_box()
    assert legend["x"] >= 0
    assert legend["x"] + legend["width"] <= view.locator(".palpate-card").bounding_box()["x"]
    assert legend["y"] + legend["height"] == pytest.approx(800, abs=1)
    assert legend["height"] <= STRIP * 800
    parts = view.locator(".palpate-card, .palpate-touches")
    assert parts.evaluate_all("parts => parts.every(part => part.scrollWidth <= part.clientWidth)")


def test_a_touch_on_a_phone_is_readable(browser: object, page: Page) -> None:
    for context in browser.contexts:  # what the tests above looked at: it is drawn on and on, without a graphics card
        context.close()
    phone = opened(browser, page.address, 390, 844, has_touch=True)
    phone.get_by_text("session").first.wait_for()
    phone.locator(".palpate-card").wait_for()
    wide = phone.evaluate("document.documentElement.scrollWidth")
    sheet = phone.get_by_text("session").first.bounding_box()["y"]
    phone.close()
    assert wide <= 390
    assert sheet >= (1 - SHEET) * 844 - 1  # the camera counts on it
