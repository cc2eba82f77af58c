"""The live page: it shows what passes through the ring, asks for a tare, and does not grow where a browser stalls."""

import multiprocessing
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from palpate.cli.live_line import summary
from palpate.cli.live_page import show
from palpate.cli.live_page_stream import Stream as Reading
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.live.source import Batch
from palpate.live.stream_buffer import StreamBuffer
from palpate.surfaces import Sphere
from palpate.viewer.live import SECONDS, LivePage, StreamFigures, recent
from tests.support.browser import PATIENCE, chromium, until
from tests.support.live_rings import RADIUS, answered, rows, sphere_rig, sphere_ring, touches

pytest.importorskip("viser")

RATE, TOKEN = 200.0, "of_this_test"  # Hz


@dataclass
class Stream:
    """A ring that is filled, and the process of its page; the next sample comes after `lose` that are lost."""

    ring: StreamBuffer
    process: multiprocessing.process.BaseProcess
    running: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    lose: int = 0

    def fill(self) -> None:
        """The work of a thread."""
        begun, done = time.monotonic(), 0
        while not self.over.wait(0.01):
            due = int((time.monotonic() - begun) * RATE) - done
            if self.running.is_set() and due:
                lost, self.lose = self.lose, 0  # at once: a test sets it meanwhile
                answered(self.ring, min(due, 100), lost=lost)
            done += due

    def said(self) -> str:
        """All sentences."""
        return "\n".join(sentence for _, sentence in self.ring.events(0)[0])

    def memory(self) -> float:
        """MB that the page's process holds."""
        pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stream]:
    """The page is to begin at a port that is taken."""
    folder = tmp_path_factory.mktemp("live")
    ring, rig = sphere_ring(folder / "ring"), sphere_rig(folder)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        context = multiprocessing.get_context("spawn")
        arguments = ((ring.path,), rig, None, "127.0.0.1", taken.getsockname()[1], TOKEN, os.getpid())
        process = context.Process(target=show, args=arguments, daemon=True)
        process.start()
        made = Stream(ring, process)
        made.running.set()
        filler = threading.Thread(target=made.fill, daemon=True)
        filler.start()
        until(lambda: "the page is at" in made.said() or not process.is_alive(), "no page")
    yield made
    made.over.set()
    filler.join()
    ring["stop"] = 1
    process.join(20.0)
    assert process.exitcode == 0


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as launched:
        yield launched


@pytest.fixture(scope="module")
def view(browser: object, stream: Stream) -> Iterator[object]:
    opened = browser.new_page(viewport={"width": 1280, "height": 800}, device_scale_factor=0.5)  # fewer pixels to draw
    opened.set_default_timeout(1e3 * PATIENCE)
    opened.goto(_address(stream))
    opened.wait_for_selector("canvas")
    yield opened
    opened.close()


def _address(stream: Stream) -> str:
    found = re.search(r"the page is at (http://127\.0\.0\.1:\d+)", stream.said())
    assert found is not None
    return f"{found[1]}/?token={TOKEN}"


def test_the_next_free_port_is_taken_and_said(stream: Stream) -> None:
    assert re.search(r"http://127\.0\.0\.1:\d+ \(port \d+ is taken\)", stream.said())


def test_rate_contact_latency_and_drops_are_on_the_page(view: object, stream: Stream) -> None:
    """200 Hz, more or less where the machine is busy, 2 to 6 N; three samples are lost."""
    stream.lose = 3

    def text() -> str:
        return view.inner_text("body")

    until(lambda: re.search(r"rate\s+1\d\d Hz|rate\s+2\d\d Hz", text()), "no rate")
    until(lambda: re.search(r"[2-6]\.\d\d N", text()), "no contact")
    until(lambda: re.search(r"samples\s+[\d,]+, 3 lost", text()), "no drops")
    assert re.search(r"median [\d,]+, 99\s% [\d,]+, worst [\d,]+ µs", text())
    assert "the page is at" in text()
    assert TOKEN not in text()  # which somebody may look at, or record


def test_the_button_asks_for_a_tare_and_shows_what_came_of_it(view: object, stream: Stream) -> None:
    view.get_by_role("button", name="Tare").click()
    until(lambda: stream.ring["asked"] == 1, "nobody asked")
    assert stream.said().endswith("tare requested by the page (127.0.0.1)")
    view.get_by_role("button", name="Taring", disabled=True).wait_for()
    stream.ring.say("tare over 200 samples: <b>nothing</b> moved")
    stream.ring["done"] = 1
    view.get_by_role("button", name="Tare", exact=True).wait_for()
    assert "<b>nothing</b>" in view.inner_text("body")  # as text


def test_what_does_not_come_is_said(view: object, stream: Stream) -> None:
    stream.running.clear()
    alarm = view.get_by_text(re.compile(r"no samples for \d+ s: the values shown are old"))
    alarm.wait_for()
    stream.running.set()
    alarm.wait_for(state="detached")


def test_on_a_phone_nothing_sticks_out(view: object) -> None:
    view.set_viewport_size({"width": 390, "height": 844})
    until(lambda: view.evaluate("document.documentElement.scrollWidth") <= 390, "it sticks out")


def test_a_browser_that_stalls_costs_no_memory(view: object, stream: Stream) -> None:
    """All processes of the browser stand still, and the page goes on without growing."""
    view.get_by_text("latency").first.wait_for()
    stopped = _descendants(os.getpid(), "chrom")
    assert stopped
    try:
        for process in stopped:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGSTOP)
        time.sleep(1.0)
        before, first = stream.memory(), stream.ring["answered"]
        time.sleep(4.0)
        assert stream.memory() - before < 20.0
        assert stream.ring["answered"] > first + 100
    finally:
        for process in stopped:
            with suppress(ProcessLookupError):  # the browser ends what does not answer
                os.kill(process, signal.SIGCONT)


def _descendants(parent: int, name: str) -> list[int]:
    """Processes below one, whose name begins so."""
    parents, names = dict[int, int](), dict[int, str]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            head, _, rest = stat.read_text().rpartition(") ")
        except (FileNotFoundError, ProcessLookupError):  # it has just ended
            continue
        parents[int(stat.parent.name)], names[int(stat.parent.name)] = int(rest.split()[1]), head.partition("(")[2]
    below, more = set[int](), {parent}
    while more:
        more = {child for child, over in parents.items() if over in more} - below
        below |= more
    return sorted(process for process in below if names[process].startswith(name))


def test_what_was_not_fetched_is_replaced_by_what_comes_after_it() -> None:
    """However many pictures are drawn, as many messages wait for a browser as after the first turn of the contact."""
    with LivePage(Sphere(RADIUS), (), "sphere", lambda browser: None, port=0) as page:
        waiting = page._server._websock_server._broadcast_buffer.message_from_id
        sizes = list[int]()
        for turn in range(3):
            window = None
            for k in range(40):
                window = recent(window, touches(400 * turn + 10 * k, 10))
                page.show(window[-1:])
                page.tell(window, StreamFigures(samples=k, events=((10**18, f"sentence {k}"),)))
            sizes.append(len(waiting))
        assert sizes[0] == sizes[1] == sizes[2]


def test_the_end_states_how_many_had_no_pose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ring, lost = sphere_ring(tmp_path / "a.ring"), rows(90, 10)
    lost[:, ROW.status] = Status.NO_POSE
    for found, said in ((rows(0, 90), ""), (lost, "of the last 100 samples, 10 no pose: they have no contacts")):
        ring.take_in(Batch((6,), len(found)), len(found), np.zeros(len(found)))
        ring.answer(found, np.ones(len(found), dtype=np.int64))
        summary(ring)
        assert ("no pose" in (shown := capsys.readouterr().out)) == bool(said)
        assert said in " ".join(shown.split())


def test_who_comes_when_the_stream_stands_still_sees_its_last_sample(tmp_path: Path) -> None:
    """Nobody watched while it came; what the layers show of it is fed once, not with every look."""
    ring, fed = sphere_ring(tmp_path / "ring"), list[tuple[int, bool]]()
    reading = Reading(ring, lambda slots, watched: fed.append((len(slots), watched)))
    assert reading.newest is None
    reading.look(True)
    answered(ring, 30)
    reading.look(False)
    reading.gather()
    for _ in range(3):
        reading.look(True)
        reading.gather()
    assert reading.newest.sample.tolist() == [29]
    assert fed == [(30, False), (1, True)]
    ring.close()


def test_no_arrow_is_longer_than_the_body_however_old_the_scale_is() -> None:
    """Fifty times as hard as the contact that the page was scaled to a moment ago; and a usual one is no dot."""
    with LivePage(Sphere(RADIUS), (), "sphere", lambda browser: None, port=0) as page:

        def shown(found: Contacts) -> float:
            page.show(found)
            tail, tip = page._scene3d._markers[0]._arrow.points[0]
            return float(np.linalg.norm(tip - tail))

        usual = recent(None, touches(0, 40))
        assert 0.1 < shown(usual[-1:]) < 1.0  # nothing has scaled it yet
        page.tell(usual, StreamFigures())
        assert 0.1 < shown(usual[-1:]) < 1.0
        hard = rows(40, 1)
        hard[:, ROW.force] *= 50.0
        assert 0.1 < shown(Contacts.of_rows(np.array([40]), np.array([0.2]), hard, ())) < 1.0
        hard[:, ROW.force] = np.nan
        page.show(Contacts.of_rows(np.array([41]), np.array([0.205]), hard, ()))  # of a reading that is no number
        assert np.isfinite(page.scene.newton)


def test_a_window_keeps_the_last_seconds_and_the_strongest_of_what_it_leaves_out() -> None:
    window = None
    for k in range(0, 4000, 50):
        window = recent(window, touches(k, 50))
    assert window.sample[-1] == 3999
    assert 0.0 < window.time[-1] - window.time[0] <= SECONDS
    assert len(window) < 4000 / 4
    whole = np.linalg.norm(touches(2000, 2000).force, axis=1)
    assert np.linalg.norm(window.force, axis=1).max() == whole.max()
    assert len(recent(window, touches(0, 5))) <= 5  # the clock was set back
