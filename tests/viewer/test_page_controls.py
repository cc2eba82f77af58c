"""The page's keys, clicks, list of touches, comparison and pictures: laws of what is shown, and Debian's chromium."""

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.events import Events
from palpate.contact.touch_finder import find_touches
from palpate.errors import InputError
from palpate.surfaces.mesh import plane
from palpate.viewer.captions import LISTED, comparison, touch_list
from palpate.viewer.marker import Marker, fade
from palpate.viewer.scene import LARGE, SMALL, Scene, prepare, rim
from palpate.viewer.server import Page
from palpate.viewer.timeline import Timeline, next_of
from palpate_lab.viewer.live_arena import LiveArena
from tests.support.arena_scenes import arena
from tests.support.arena_scenes import scene as arena_scene
from tests.support.browser import opened, until
from tests.support.pages import ellipsoid, session


def _two_touches() -> Contacts:
    """The session with a pause of 0.4 s amid its touch, and a blip of one sample in that."""
    found = session()
    free = np.zeros(len(found), dtype=bool)
    free[180:220] = True
    free[200] = False
    estimate = replace(
        found.estimate,
        point=np.where(free[:, None], np.nan, found.point),
        status=np.where(free, Status.NO_CONTACT, found.status).astype(np.int8),
    )
    return found.with_estimate(estimate)


def _other() -> Contacts:
    """Twice as strong, and 1 s later."""
    found = session()
    return replace(found.with_estimate(replace(found.estimate, force=2.0 * found.force)), time=found.time + 1.0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return prepare(ellipsoid(500), _two_touches(), title="ours").compared(_other(), "theirs")


def test_steps_go_to_samples_of_touches_only() -> None:
    """A blip of 10 ms is none, nor is what lies between."""
    touched = np.zeros(100, dtype=bool)
    touched[10:20] = touched[40] = touched[60:70] = True
    timeline = Timeline.of(np.arange(100) / 100.0, touched)
    assert timeline.in_touch.tolist() == [*range(10, 20), *range(60, 70)]
    assert [next_of(timeline.in_touch, k, 1) for k in (0, 10, 19, 40, 69)] == [10, 11, 60, 60, 69]
    assert [next_of(timeline.in_touch, k, -1) for k in (99, 60, 40, 10)] == [69, 19, 19, 10]


def test_an_ellipse_lies_on_the_body_however_large(scene: Scene) -> None:
    """Its rim hovers as the contact does and by the lift, where a flat one would hang in the air."""
    contact = scene.at(150).contacts[0]
    above = float(np.linalg.norm(contact.point - scene.surface.project(contact.point[None])[0][0]))
    for times in (1, 100):
        points = scene.ellipse_on_body(contact, times)
        nearest = scene.surface.project(points)[0]
        assert np.linalg.norm(points - nearest, axis=1).max() <= above + 5.1e-3 * scene.size
    small = scene.ellipse_on_body(contact, 1)[-SMALL[1] :] - contact.point
    small -= np.outer(small @ contact.normal, contact.normal)
    assert np.linalg.norm(small, axis=1).max() == pytest.approx(contact.axes[0], rel=0.05)


def test_a_large_ellipse_has_more_rings_and_every_facet_its_points(scene: Scene) -> None:
    """Drawn small, large and small again: the middle and the rim are where they were."""
    contact = scene.at(150).contacts[0]
    counts = [len(scene.ellipse_on_body(contact, times)) for times in (1, 100)]
    assert counts == [1 + rings * around for rings, around in (SMALL, LARGE)]
    with Page(scene, port=0) as page:
        marker = Marker(page._server.scene, 0)
        for times, count in zip((1, 100, 1), (*counts, counts[0]), strict=True):
            marker.show(scene, contact, times)
            points = scene.placed(scene.ellipse_on_body(contact, times))
            np.testing.assert_allclose(marker._disc.vertices, points, atol=1e-6)
            assert np.array_equal(np.unique(marker._disc.faces), np.arange(count))
            around = points[-rim(count) :]
            np.testing.assert_allclose(marker._rim.points[:, 0], around, atol=1e-6)
            np.testing.assert_allclose(marker._rim.points[:, 1], np.roll(around, -1, axis=0), atol=1e-6)
            assert len(marker._rim.colors) == len(around)


def test_a_label_does_not_tremble_with_noise(scene: Scene) -> None:
    contact = scene.at(150).contacts[0]
    with Page(scene, port=0) as page:
        marker = Marker(page._server.scene, 0)
        marker.show(scene, contact, 1)
        before = marker._label.position.copy()
        for share, moved in ((0.005, 0.0), (0.02, 0.02)):  # sizes of the body
            aside = contact.point + share * scene.size * np.array([0.0, 0.0, 1.0])
            marker.show(scene, replace(contact, point=aside), 1)
            np.testing.assert_allclose(marker._label.position - before, [0.0, 0.0, moved], atol=1e-9)
            np.testing.assert_allclose(marker._arrow.points[0, 1], scene.placed(aside), atol=1e-6)


def test_an_ellipse_ends_where_the_body_ends() -> None:
    sheet = plane([0, 0, 0], [0, 0, 1], 0.01)
    found = session()[150:151]
    flat = replace(found.estimate, point=np.array([[0.009, 0.0, 0.0]]), normal=np.array([[0.0, 0.0, 1.0]]))
    scene = prepare(sheet, found.with_estimate(flat))
    points = scene.ellipse_on_body(scene.at(0).contacts[0], 20)
    assert np.abs(points[:, :2]).max() <= 0.01 + 1e-9


def test_an_ellipse_larger_than_the_body_is_faint() -> None:
    assert fade(0.1, 1.0) == 1.0
    assert fade(1.0, 1.0) == pytest.approx(0.25)
    assert fade(1e9, 1.0) == pytest.approx(0.15)


def test_the_other_result_is_that_of_the_same_time(scene: Scene) -> None:
    """Its clock begins 1 s later: its sample 150 is of 2.5 s, and has twice the force of ours 1 s before."""
    other = scene.meanwhile(2.5)
    assert other.index == 150
    assert np.array_equal(other.contacts[0].force, 2.0 * session().force[150])
    ((title, said),) = comparison(scene, scene.at(250))
    assert title == "theirs"
    assert said.startswith("contact, ")
    late = session()
    with pytest.raises(InputError, match=r"late: .*no time in common"):
        scene.compared(replace(late, time=late.time + 100.0), "late")


@pytest.fixture(scope="module")
def page(scene: Scene) -> Iterator[Page]:
    with Page(scene, port=0) as served:
        yield served


@pytest.fixture(scope="module")
def view(browser: object, page: Page) -> Iterator[object]:
    shown = _known(browser, page, 700, 500)
    yield shown
    shown.close()


def _known(browser: object, page: Page, width: int, height: int) -> object:
    there = len(page._sessions)
    shown = opened(browser, page.address, width, height)
    shown.locator(".palpate-legend").wait_for()
    shown.get_by_text("palpate asks").wait_for(state="hidden")
    until(lambda: len(page._sessions) > there, "the server does not know the browser")
    return shown


def test_keys_play_and_step(view: object, page: Page, scene: Scene) -> None:
    shown, (first, second) = page.session, scene.timeline.touches.tolist()
    shown.seek(0.0)
    until(lambda: shown.index == 0, "no seeking")
    for key, there in (("ArrowRight", first), ("ArrowRight", second), ("ArrowLeft", first)):
        view.keyboard.press(key)
        until(lambda there=there: shown.index == there, f"{key} does not lead to the touch")
    view.keyboard.press("Shift+ArrowRight")
    until(lambda: shown.index == first + 1, "no step to the next sample")
    view.keyboard.press(" ")
    until(lambda: shown.playing, "space does not play")
    view.keyboard.press(" ")
    until(lambda: not shown.playing, "space does not pause")
    view.get_by_role("button", name="Play").click()
    until(lambda: shown.playing, "the button does not play")
    view.keyboard.press(" ")  # not a second click on the button that was clicked
    until(lambda: not shown.playing, "space does not pause after a click")


def test_a_click_in_the_list_or_on_a_plot_goes_there(view: object, page: Page, scene: Scene) -> None:
    shown, found = page.session, scene.touches
    assert len(found) == 2  # the blip is none
    row = view.locator("[data-asks]").nth(1)
    assert row.inner_text().split()[:3] == ["2", f"{found.peak_time[1] - 100:.2f}", f"{found.peak_force[1]:.2f}"]
    row.click()
    peak = scene.timeline.at(float(found.peak_time[1]) - 100.0)
    until(lambda: abs(shown.index - peak) <= 1, "the list does not seek")
    plot = view.locator(".u-over").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    plot.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    until(lambda: abs(shown.index - 200) <= 5, "the plot does not seek")  # the middle of 4 s


def test_what_is_compared_is_said(view: object, page: Page) -> None:
    page.session.seek(2.5)
    view.locator(".palpate-card").get_by_text("theirs", exact=True).wait_for()
    legend = view.locator(".palpate-legend").inner_text()
    named = "force on the body", "95 % ellipse", "torque about the normal", "time touched per area 0", "theirs", "grid"
    assert [words for words in named if words not in legend] == []


def test_a_picture_is_saved(view: object, tmp_path: Path) -> None:
    import imageio.v3

    with view.expect_download() as saved:
        view.get_by_role("button", name="save").click()
    assert saved.value.suggested_filename.startswith("ours_")
    saved.value.save_as(tmp_path / "picture.png")
    picture = imageio.v3.imread(BytesIO((tmp_path / "picture.png").read_bytes()))
    assert picture.shape[2] == 3
    grey = (picture.max(axis=-1) < 235) & (np.ptp(picture.astype(int), axis=-1) < 60)
    assert np.count_nonzero(grey) > 1_000  # the body


def test_each_browser_has_its_time_and_the_sheet_of_a_phone_folds(view: object, browser: object, page: Page) -> None:
    first, before = page.session, page.session.index
    phone = _known(browser, page, 390, 844)
    assert page.session is not first
    phone.keyboard.press("ArrowLeft")
    phone.keyboard.press("ArrowLeft")
    until(lambda: page.session.index == page.scene.timeline.touches[0], "the phone does not step")
    assert first.index == before
    panel = phone.get_by_role("button", name="Play")
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    assert panel.bounding_box()["width"] > 300  # as wide as the phone
    phone.get_by_text("Palpate · ours").click()
    until(lambda: not panel.is_visible() or panel.bounding_box()["y"] >= 780, "the sheet does not fold")
    phone.close()
    until(lambda: page.session is first, "a browser that left is not forgotten")


def test_the_page_of_an_arena_says_what_robots_feel_and_pauses(browser: object) -> None:
    """In the same browser: its robots stand on a canvas, their words in the panel, and its button stops the run."""
    pytest.importorskip("cv2")
    with LiveArena(arena(), port=0) as fed:
        fed.show(arena_scene(10.0, force=3.0, blind=True), now=True)
        phone = opened(browser, fed.address, 390, 844)
        phone.wait_for_selector("canvas")
        phone.get_by_text("blind").first.wait_for()
        phone.get_by_role("button", name="Pause").click()
        until(lambda: fed.paused, "the button does not pause")
        assert phone.evaluate("document.documentElement.scrollWidth") <= 390
        phone.close()


@pytest.mark.parametrize("count", [0, 1, 2, LISTED, LISTED + 1, LISTED + 1234])
def test_a_list_has_a_line_for_each_touch_and_says_how_many_more_there_are(count: int) -> None:
    one = find_touches(session())
    touches = Events.joined([one] * count) if count else find_touches(session()[:0])
    scene = prepare(ellipsoid(), session())
    vars(scene)["touches"] = touches
    text = touch_list(scene, float(one.start[0]))
    assert text.count("<tr data-asks") == min(count, LISTED)
    assert text.count("font-weight:600") == min(count, 1)
    assert ("no touches" in text) == (count == 0)
    more = f"and {count - LISTED:,} more" if count > LISTED else None
    assert ("more</div>" in text) == (more is not None)
    assert more is None or more in text
