"""What a test waits for: so many samples of a live source, words that it says, or anything that holds at last."""

import time
from collections.abc import Callable
from typing import Any

from palpate.live.source import Batch, Source

PATIENCE = 60.0  # s for what takes milliseconds on an idle machine


def until(holds: Callable[[], Any]) -> None:
    """Wait for it."""
    deadline = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < deadline, "it never came"
        time.sleep(0.005)


def received(source: Source, count: int, size: int = 64) -> Batch:
    """That many samples and no more, which came in batches of `size` at most."""
    whole, part = (Batch(source.shape, each, source.dtype) for each in (count, size))
    at, end = 0, time.monotonic() + PATIENCE
    while at < count and time.monotonic() < end:
        found = source.receive(part, 0.1)
        for name in ("stamp", "lost", "values", "orientation", "position"):
            getattr(whole, name)[at : at + found] = getattr(part, name)[:found]
        at += found
    assert at == count
    return whole


def said_until(source: Source, *words: str) -> list[str]:
    """What is said, until it holds all of these words."""
    batch, said, end = Batch(source.shape, dtype=source.dtype), list[str](), time.monotonic() + PATIENCE
    while not all(word in "\n".join(said) for word in words) and time.monotonic() < end:
        source.receive(batch, 0.02)
        said += source.events()
    assert all(word in "\n".join(said) for word in words), said
    return said
