"""What takes long is announced once, and not where nobody wants it; blocks wait for what they test."""

import logging
import threading

import pytest

from palpate import waiting
from palpate.console.console import spoken


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> threading.Event:
    """Set when an announcement was made, or kept back by the logger's level."""
    done, announce = threading.Event(), waiting._announce

    def announced(what: str) -> None:
        announce(what)
        done.set()

    monkeypatch.setattr(waiting, "PATIENCE", 0.001)
    monkeypatch.setattr(waiting, "_ANNOUNCED", set())
    monkeypatch.setattr(waiting, "_announce", announced)
    return done


def test_what_takes_long_is_announced_once(heard: threading.Event, caplog: pytest.LogCaptureFixture) -> None:
    with waiting.waiting("something is done"):
        assert heard.wait(60)
    with waiting.waiting("something is done"):
        assert {"something is done"} == waiting._ANNOUNCED
    assert [record.getMessage() for record in caplog.records] == ["palpate: something is done"]


def test_what_is_done_soon_is_not(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(waiting, "PATIENCE", 1e6)
    before = threading.active_count()
    with waiting.waiting("something is done"):
        timers = [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]
    for timer in timers:
        timer.join(60)  # it ends with the block
    assert threading.active_count() <= before
    assert caplog.records == []


def test_commands_announce_by_their_own_lines(heard: threading.Event, capfd: pytest.CaptureFixture[str]) -> None:
    with spoken(quiet=False, json=False), waiting.waiting("something is done"):
        assert heard.wait(60)
    assert logging.getLogger("palpate").level == logging.NOTSET
    assert capfd.readouterr().err == ""
