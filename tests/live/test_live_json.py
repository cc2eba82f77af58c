"""Contacts as JSON lines: what a listener reads is what was found, and nobody is waited for."""

import json
import multiprocessing
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.errors import InputError
from palpate.live.json_lines import JsonLines
from palpate.live.publish import Publisher, Throttle, open_publisher, publish, require_address
from palpate.live.stream_buffer import SlotForm
from tests.support.live_rings import answered, slots, sphere_rig, sphere_ring, touches

FORM = SlotForm("taxels", (5,), False, ("area",), ROW.length + 2, 3)


@pytest.fixture
def opened() -> Iterator[Callable[[str], JsonLines]]:
    """What makes senders, which are closed in the end."""
    with ExitStack() as stack:
        yield lambda to: stack.enter_context(closing(JsonLines(to, FORM)))


def _to(listener: socket.socket) -> str:
    return f"udp:127.0.0.1:{listener.getsockname()[1]}"


def _lines(listener: socket.socket) -> list[dict[str, Any]]:
    """All that waits; each datagram is one line."""
    listener.setblocking(False)
    read = list[dict[str, Any]]()
    while True:
        try:
            line = listener.recv(1 << 16)
        except BlockingIOError:
            return read
        assert line.endswith(b"\n")
        assert line.count(b"\n") == 1
        read.append(json.loads(line, parse_constant=pytest.fail))  # NaN is no JSON


def _same(made: list[float | None], values: np.ndarray) -> None:
    """To the last bit, with null for NaN."""
    assert [np.nan if value is None else value for value in made] == pytest.approx(values.ravel(), rel=0, nan_ok=True)


def _at(times: list[float], statuses: list[Status]) -> Contacts:
    """One contact a sample, with a place where it is one."""
    found = touches(0, len(times))
    located = np.array([status <= Status.AMBIGUOUS for status in statuses])
    estimate = found.estimate
    point = np.where(located[:, None], estimate.point, np.nan)
    made = {**vars(estimate), "point": point, "status": np.array(statuses, dtype=np.int8)}
    return Contacts(found.sample, np.array(times), found.identity, ContactEstimate(**made), {"area": point[:, 0] ** 2})


@pytest.mark.parametrize("kind", ["udp", "unix"])
def test_a_line_holds_the_contact_to_the_last_bit(
    opened: Callable[[str], JsonLines], kind: str, tmp_path: Path
) -> None:
    family = socket.AF_INET if kind == "udp" else socket.AF_UNIX
    found = _at([1.7e9 + 0.1234567], [Status.CONTACT])
    with socket.socket(family, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0) if kind == "udp" else str(tmp_path / "contacts"))
        sender = opened(_to(listener) if kind == "udp" else f"unix:{tmp_path / 'contacts'}")
        sender.publish(slots(found, FORM))
        (line,) = _lines(listener)
    assert (line["sample"], line["time"], line["status"]) == (0, found.time[0], "contact")
    (contact,) = line["contacts"]
    assert (contact["identity"], contact["status"], contact["area"]) == (0, "contact", found.features["area"][0])
    for name in ("point", "normal", "force", "covariance"):
        _same(contact[name], getattr(found, name)[0])
    assert contact["torque"] is None  # NaN
    assert sender.sent == 1


def test_a_sample_without_a_contact_says_so(opened: Callable[[str], JsonLines], udp: socket.socket) -> None:
    sender = opened(_to(udp))
    sender.publish(slots(_at([0.0], [Status.SATURATED]), FORM))
    assert _lines(udp) == [{"sample": 0, "time": 0.0, "status": "saturated", "contacts": []}]


def test_several_contacts_are_one_line_the_strongest_first(
    opened: Callable[[str], JsonLines], udp: socket.socket
) -> None:
    found = touches(0, 2)
    both = Contacts(np.array([7, 7]), np.array([1.0, 1.0]), np.array([3, 4]), found.estimate)
    strong = int(np.linalg.norm(found.force, axis=1).argmax())
    sender = opened(_to(udp))
    sender.publish(slots(both, FORM))
    (line,) = _lines(udp)
    assert [each["identity"] for each in line["contacts"]] == [3 + strong, 4 - strong]
    form = replace(FORM, origin=("palm", "hand"), place=(1, 5), expected=True)
    with closing(JsonLines(_to(udp), form)) as robots:
        robots.publish(slots(both, form))
    (named,) = _lines(udp)
    found = form.contacts(slots(both, form))
    assert (named["sensor"], named["link"]) == ("palm", "hand")
    assert sorted(each["identity"] for each in named["contacts"]) == found.identity.tolist() == [16, 21]
    assert [each["expected"] for each in named["contacts"]] == found.features["expected"].tolist()


def test_the_newest_goes_out_at_the_rate_and_a_change_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 kHz, in blocks of 5 ms, 10 ms a line; samples 23 and 24 alone are no contact, the last of a block waits."""
    now = [0.0]
    monkeypatch.setattr("palpate.live.publish.monotonic", lambda: now[0])
    throttle, sent = Throttle(FORM, 100.0), list[int]()
    statuses = [Status.NO_CONTACT if k in (23, 24) else Status.CONTACT for k in range(40)]
    whole = slots(_at([1e-3 * k for k in range(40)], statuses), FORM)
    for begin in range(0, 40, 5):
        now[0] = 1e-3 * (begin + 4)
        sent += throttle.choose(whole[begin : begin + 5])["number"].tolist()
    assert [number - 1 for number in sent] == [0, 14, 23, 25, 39]  # the first; 10 ms on; change; back; 10 ms on
    now[0] = 0.042
    assert throttle.wait() == np.inf
    assert not len(throttle.choose(whole[:0]))  # nothing had to wait
    now[0] = 0.045
    assert not len(throttle.choose(whole[39:]))
    assert throttle.wait() == pytest.approx(0.004)
    now[0] = 0.06
    assert throttle.choose(whole[:0])["number"].tolist() == [40]  # what waited goes when it is due
    other = whole[39:].copy()
    other["contacts"][:, 0, -1] += 1.0
    assert len(throttle.choose(other)) == 1  # another contact
    other["rows"] = 2
    assert len(throttle.choose(other)) == 1  # a second one
    other["rows"], other["ready"] = 0, 0
    assert not len(throttle.choose(other))  # not known


def test_where_nobody_listens_nothing_happens_and_who_comes_late_is_served(
    opened: Callable[[str], JsonLines], tmp_path: Path
) -> None:
    path = tmp_path / "contacts"
    sender = opened(f"unix:{path}")
    sender.publish(slots(touches(0, 20), FORM))
    assert (sender.sent, sender.dropped, sender.events()) == (0, 0, [])
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(path))
        sender.publish(slots(touches(20, 2), FORM))
        assert [line["sample"] for line in _lines(listener)] == [20, 21]
    sender.publish(slots(touches(22, 5), FORM))
    assert (sender.sent, sender.dropped) == (2, 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind(("127.0.0.1", 0))
        nobody = opened(_to(gone))
    nobody.publish(slots(touches(0, 20), FORM))
    assert nobody.dropped == 0


def test_a_listener_that_does_not_read_is_not_waited_for(
    opened: Callable[[str], JsonLines], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("palpate.live.json_lines.monotonic", lambda: now[0])
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "contacts"))
        sender = opened(f"unix:{tmp_path / 'contacts'}")
        sender.publish(slots(touches(0, 2000), FORM))
        assert sender.sent + sender.dropped == 2000
        assert sender.dropped > 0
        assert [str(sender.dropped) in sentence for sentence in sender.events()] == [True]
        sender.publish(slots(touches(0, 10), FORM))
        assert sender.events() == []  # not again so soon
        now[0] = 11.0
        assert len(sender.events()) == 1


@pytest.mark.parametrize(
    ("to", "said"),
    [
        ("mqtt:host", "not a destination to which contacts can be published.*Write"),
        ("udp:5005", "not an address for datagrams"),
        ("udp:127.0.0.1:99999", "not an address for datagrams"),
        ("udp:no host:5005", ": .*host that cannot be found"),
        ("unix:", "needs a path"),
        (f"unix:{'x' * 200}", "needs a path"),
        ("unix:nowhere/at/all", "folder that does not exist.*Make"),
        ("ros2:300", "from 0 to 232"),
        ("ros2:", "from 0 to 232"),
    ],
)
def test_a_wrong_address_is_one_sentence_before_anything_starts(to: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        require_address(to)


def test_good_addresses_are_taken(tmp_path: Path) -> None:
    form = sphere_ring(tmp_path / "ring").form
    for to in ("udp:127.0.0.1:5005", "udp:[::1]:5005", f"unix:{tmp_path / 'contacts'}"):
        made = open_publisher(to, form)
        assert isinstance(made, Publisher)
        made.close()
        made.close()
    require_address("ros2")
    require_address("ros2:7")


def test_a_process_publishes_what_passes_through_the_ring_until_it_is_stopped(
    tmp_path: Path, udp: socket.socket
) -> None:
    ring, rig = sphere_ring(tmp_path / "ring"), sphere_rig(tmp_path)
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=publish, args=([ring.path], _to(udp), rig, None, os.getpid(), 0.0), daemon=True)
    process.start()
    end, heard = time.monotonic() + 120.0, list[dict[str, Any]]()
    # it begins with what comes after it is there, which may be the part of a turn in which nothing touches
    while not any(line["contacts"] for line in heard) and time.monotonic() < end:
        answered(ring, 5)
        time.sleep(0.02)
        heard += _lines(udp)
    ring["stop"] = 1
    process.join(20.0)
    assert process.exitcode == 0
    samples = [line["sample"] for line in heard]
    assert samples == list(range(samples[0], samples[0] + len(samples)))
    found = touches(samples[0], len(samples))
    assert [bool(line["contacts"]) for line in heard] == found.located.tolist()
    for line, point in zip(heard, found.point, strict=True):
        for contact in line["contacts"]:
            _same(contact["point"], point)
