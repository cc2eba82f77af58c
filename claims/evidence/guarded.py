"""The pages behind their guard: what others ask of them has no effect, and their owner does not notice.

Every page that Palpate serves, over real sockets: requests as a foreign page makes a browser send them, or without the
token, malformed and hostile messages of a client that has it, slow connections, many clients. An effect is a request
that is answered, a hostile connection that stays, another value of any widget, a tare, an owner who is cut off, a
sample that the live page missed, or anything at all on stderr.
"""

import os
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, redirect_stderr, suppress
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
from msgspec import msgpack
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from claims.evidence.page_client import CAMERA, Owner, closed, fetched, opened, owner, refused, until
from claims.row import Row
from palpate.cli.live_page import show
from palpate.contact.estimate import ROW, Status
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.places_page import TaxelPage
from palpate.surfaces import Sphere
from palpate.viewer.guard import LARGEST
from palpate.viewer.scene import no_contacts, prepare
from palpate.viewer.server import Page, Served
from palpate.viewer.viser_door import CLIENTS
from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.shapes import EllipsoidBody
from palpate_lab.viewer.live_arena import LiveArena
from palpate_lab.viewer.live_probe import LiveProbe

TOKEN = "of_this_claim"
MORE, SLOW = 20, 300  # clients; connections that send a byte now and then
OPEN = 10.0  # s
RIG = '[surface]\nkind = "sphere"\nradius = 0.05\n[force_torque]\n[source]\nkind = "replay"\naddress = "log.csv"\n'
BOMB = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + struct.pack(">II", 60_000, 60_000)


class Target(NamedTuple):
    """A page that is attacked.

    Attributes:
        address: of it.
        state: of all that a client could change.
        missed: samples that it did not show; None: it has none.
        said: what it has written to stderr.
    """

    address: str
    state: Callable[[], object]
    missed: Callable[[Owner], int] | None
    said: Callable[[], str]


def rows(small: bool) -> Iterator[Row]:
    """Each page and each attack; in small three pages and fewer slow connections."""
    for name, serving in list(PAGES.items())[: 3 if small else None]:
        yield from [
            Row(f"{name}: {what}", target, got, met)
            for what, target, got, met in _attacked(serving(), 80 if small else SLOW)
        ]  # at once: what is told meanwhile would be taken for the page's


def _attacked(serving: AbstractContextManager[Target], slow: int) -> Iterator[tuple[str, str, str, bool]]:
    """What was tried, what should come of it, what did, and whether that is as it should be."""
    with serving as page, owner(page.address) as present:
        until(lambda: present.words, "the page says nothing")
        state = page.state()
        asked, answered = _outsiders(page.address)
        what = "foreign Origin, foreign Host, no token, by HTTP and sockets: answered"
        yield what, "0", f"{answered} of {asked}", not answered
        kinds, stayed = _hostile(page.address, present)
        what = "malformed and hostile messages of a client with the token: not cut off"
        yield what, "0", f"{stayed} of {kinds} kinds", not stayed
        seconds = _slow(page.address, slow)
        yield f"the owner beside {slow} slow connections", "let in", f"in {seconds:.2f} s", seconds < OPEN
        served, least = _many(page.address), CLIENTS - 1
        what = f"{MORE} more clients at once: served beside the owner"
        yield what, f"at most {least}", f"{served}", 0 < served <= least
        missed = 0 if page.missed is None else page.missed(present)
        changed, cut, said = page.state() != state, not present.here, page.said()
        got = f"{int(changed)} changed, {int(cut)} cut off, {missed} missed, {len(said.splitlines())} lines on stderr"
        what = "widgets and tares, the owner's connection, samples, stderr, after all of it"
        yield what, "0 effects", got, not (changed or cut or missed or said)


def _outsiders(address: str) -> tuple[int, int]:
    """Requests that nobody may make, and how many of them were answered."""
    parts, bare, token = urlsplit(address), address.partition("?")[0], address.rpartition("=")[2]
    port, own = parts.port, f"http://{parts.netloc}"
    cookie = {"Cookie": f"palpate_{port}={token}"}
    origins = ("http://evil.example", f"http://127.0.0.1:{port + 1 if port else 1}", "null", f"https://{parts.netloc}")
    hosts = (f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", "127.0.0.1", f"192.168.77.77:{port}", "")
    wrong = [{}, {"Cookie": f"palpate_{port}=x"}, {"Cookie": f"palpate_1={token}"}, {"Cookie": f"palpate_{port}="}]
    results = [fetched(address, Origin=each)[0] == 200 for each in origins]
    results += [fetched(bare, Origin=each, **cookie)[0] == 200 for each in origins]
    results += [fetched(address, (each,))[0] == 200 for each in hosts]
    results += [fetched(address, (parts.netloc, "evil.example"))[0] == 200]
    results += [fetched(bare, **each)[0] == 200 for each in wrong]
    results += [fetched(f"{bare}?token={each}")[0] == 200 for each in ("", "x", token[:-1], f"{token}a")]
    results += [token in fetched(bare)[1]]
    results += [not refused(address, origin=each) for each in origins]
    results += [not refused(bare, origin=each, **cookie) for each in origins]
    results += [not refused(address, host=each) for each in hosts if each]
    results += [not refused(bare, origin=own, **each) for each in wrong]
    return len(results), sum(results)


def _hostile(address: str, present: Owner) -> tuple[int, int]:
    """Messages that end their connection, and how many did not."""
    button = present.widgets.get("GuiButtonMessage", next(iter(present.widgets.values()), "none"))
    update = {"type": "GuiUpdateMessage", "uuid": button}
    messages: list[object] = [
        "text", b"", b"\xc1\xff\x00", os.urandom(200), b"\x91" * 100_000, msgpack.encode([1, 2]), {}, {"type": 3},
        {"type": "Nope"}, {"type": "ShareUrlRequest"}, {"type": "GuiRemoveMessage", "uuid": button},
        {"type": "GuiFormSubmitMessage", "uuid": button}, {"type": "RunJavascriptMessage", "source": "alert(1)"},
        {"type": "FileTransferStartUpload", "source_component_uuid": button, "transfer_uuid": "a", "filename": "x",
         "mime_type": "x", "part_count": 1 << 30, "size_bytes": 1 << 40},
        update, {**update, "updates": {"update_cb": []}}, {**update, "updates": {"value": True, "update_cb": []}},
        {**update, "updates": {"disabled": True}}, {**update, "updates": {"__class__": "x"}},
        {**update, "updates": {"value": [1.0]}}, {**update, "updates": {"value": float("nan")}},
        {**update, "updates": {"value": "x" * 100_000}}, {**update, "updates": {"value": "none of the options"}},
        {**update, "uuid": "of no widget", "updates": {"value": True}},
        {**CAMERA, "position": (float("nan"), 0.0, 0.0)}, {**CAMERA, "wxyz": (1.0, 0.0)}, {**CAMERA, "more": 1},
        {**CAMERA, "image_height": 1 << 40}, {"type": "GetRenderResponseMessage", "payload": BOMB, "render_uuid": "a"},
        bytes(LARGEST + 1),
    ]  # fmt: skip
    stayed = 0
    for message in messages:
        with opened(address) as attacker, suppress(ConnectionClosed):  # a large one may not even be sent to its end
            attacker.send(msgpack.encode(CAMERA))
            attacker.send(message if isinstance(message, bytes | str) else msgpack.encode(message))
            stayed += not closed(attacker)
    return len(messages), stayed


def _slow(address: str, count: int) -> float:
    """Seconds until the owner has the page, while others send a byte now and then."""
    parts, over = urlsplit(address), threading.Event()
    with ExitStack() as stack:
        held = [stack.enter_context(socket.create_connection((parts.hostname, parts.port))) for _ in range(count)]

        def drip() -> None:
            for byte in b"GET /?" + b"a" * 10_000:
                for each in held:
                    with suppress(OSError):
                        each.send(bytes([byte]))
                if over.wait(0.1):
                    return

        dripping = threading.Thread(target=drip)
        dripping.start()
        begin = time.monotonic()
        with owner(address) as another:
            until(lambda: another.here, "the owner is not let in")
            status, _ = fetched(address)
        took = time.monotonic() - begin
        over.set()
        dripping.join()
    return took if status == 200 else float("inf")


def _many(address: str) -> int:
    """How many of so many more clients are served at once."""
    with ExitStack() as stack:
        served = 0
        for _ in range(MORE):
            with suppress(InvalidHandshake):
                stack.enter_context(opened(address)).send(msgpack.encode(CAMERA))
                served += 1
        return served


@contextmanager
def _here(made: Served) -> Generator[Target]:
    said = StringIO()

    def state() -> object:
        inside: Any = made
        guis = [inside._server.gui, *(each.gui for each in list(inside._server.get_clients().values())[:1])]
        handles = [each for gui in guis for each in gui._gui_input_handle_from_uuid.values()]
        return [(each.value, each.disabled, each.visible, list(map(id, each._impl.update_cb))) for each in handles]

    with redirect_stderr(said), made:
        yield Target(made.address, state, None, said.getvalue)


def _view() -> AbstractContextManager[Target]:
    return _here(Page(prepare(Sphere(0.05), no_contacts(), "view"), port=0))


def _arena() -> AbstractContextManager[Target]:
    block, start, goal = Block(1.0, 1.0, 0.0, (0.1, 0.1), mass=1.0), np.array([[0.5, 1.0, 0.0]]), np.array([[2.5, 1.0]])
    return _here(LiveArena(ArenaLayout((3.0, 2.0), (block,), start, goal), port=0))


def _phantom() -> AbstractContextManager[Target]:
    return _here(LiveProbe(*EllipsoidBody((0.03, 0.02, 0.015)).mesh(200), (0.2, 0.1, 0.05), 7.0, port=0))


def _taxels() -> AbstractContextManager[Target]:
    normals = np.random.default_rng(3).normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return _here(TaxelPage(TaxelPlaces(0.05 * normals, normals), Sphere(0.05), "taxels", port=0))


@contextmanager
def _live() -> Generator[Target]:
    """The page of `palpate live`, in its process, while samples come."""
    with tempfile.TemporaryDirectory() as scratch:
        rig, errors = Path(scratch) / "rig.toml", Path(scratch) / "errors"
        rig.write_text(RIG)
        ring = StreamBuffer.make(
            Path(scratch) / "ring", SlotForm("force_torque", (6,), False, (), ROW.length, 1), 1 << 22
        )
        process = get_context("spawn").Process(target=_shown, args=(errors, ring.path, rig, os.getpid()), daemon=True)
        process.start()
        over, filler = threading.Event(), threading.Thread()

        def missed(present: Owner) -> int:
            over.set()
            filler.join()
            until(lambda: f"{ring['received']:,}, 0 lost<" in "".join(present.words.values()), "samples are missing")
            return int("not shown" in "".join(present.words.values()))

        try:
            until(lambda: ring["said"] or not process.is_alive(), "no page")
            address = f"{ring.events(0)[0][0][1].split(' ')[4]}/?token={TOKEN}"
            filler = threading.Thread(target=_fill, args=(ring, over), daemon=True)
            filler.start()
            yield Target(address, lambda: (ring["asked"], ring["said"]), missed, errors.read_text)
        finally:
            over.set()
            filler.join()
            ring["stop"] = 1
            process.join(20.0)
            ring.close()


def _fill(ring: StreamBuffer, over: threading.Event) -> None:
    row = np.full((10, ROW.length), np.nan)
    row[:, ROW.force], row[:, ROW.residual], row[:, ROW.candidates] = 0.01, 0.0, 0
    row[:, ROW.status] = Status.NO_CONTACT
    while not over.wait(0.05):
        batch = Batch((6,), 10)
        batch.stamp[:], batch.lost[:] = time.time_ns(), 0
        ring.take_in(batch, 10, np.zeros(10))
        ring.answer(row, np.ones(10, dtype=np.int64))


def _shown(errors: Path, ring: Path, rig: Path, parent: int) -> None:
    """The page's process; what it writes to stderr is kept."""
    os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT), sys.stderr.fileno())
    show((ring,), rig, None, "127.0.0.1", 0, TOKEN, parent)


PAGES: dict[str, Callable[[], AbstractContextManager[Target]]] = {
    "view": _view, "live": _live, "arena": _arena, "phantom": _phantom, "taxels": _taxels
}  # fmt: skip
