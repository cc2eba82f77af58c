"""Processes of `palpate live`: started, watched, started again when they died, and ended in order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any

from palpate.errors import InputError
from palpate.live.stream_buffer import READERS, StreamBuffer

__all__ = ["Worker", "WorkerSupervisor"]

AGAIN, WITHIN = 5, 30.0  # times that a process may die within so many seconds before it is given up
PATIENCE = 20.0  # s that a process may take to end


@dataclass
class Worker:
    """A process.

    Args:
        name: for sentences.
        target: what it runs, importable.
        arguments: of it.
    """

    name: str
    target: Callable[..., None]
    arguments: tuple[Any, ...]
    process: BaseProcess | None = None
    given_up: bool = False
    died: list[float] = field(default_factory=list[float])

    def start(self) -> None:
        """As a process of its own that has nothing of this one but the arguments."""
        made = get_context("spawn").Process(target=self.target, args=self.arguments, name=f"palpate {self.name}")
        made.start()
        self.process = made

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process is not None and self.process.is_alive()


class WorkerSupervisor:
    """Watches workers; what it does is said in the ring.

    Args:
        workers: who writes the ring first, which is ended first, then those who read it.
    """

    def __init__(self, workers: list[Worker]) -> None:
        self.workers = workers

    def watch(self, ring: StreamBuffer) -> None:
        """Start again what died; to be called a few times a second.

        Raises:
            InputError: the writer died again and again; without it nothing comes any more.
        """
        now = time.monotonic()
        for worker in [each for each in self.workers if not (each.alive or each.given_up)]:
            code = None if worker.process is None else worker.process.exitcode
            worker.died = [at for at in worker.died if now - at < WITHIN] + [now]
            why = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"
            if len(worker.died) > AGAIN:
                worker.given_up = True
                said = f"the {worker.name} {why} again and again, and is given up"
                ring.say(said)
                if worker is self.workers[0]:
                    raise InputError(f"{said}.", where="palpate live")
                continue
            worker.start()
            ring.say(f"the {worker.name} {why}, and was started again")

    def stop(self, ring: StreamBuffer | None) -> list[str]:
        """Let all end in order, the writer first; which of them had to be killed, one sentence each.

        Without a ring nothing was begun, and there is nothing to wait for, or to be said.
        """
        said: list[str] = []
        for level, workers in ((1, self.workers[:1]), (READERS, self.workers[1:])):
            if ring is not None:
                ring["stop"] = level
            end = time.monotonic() + (PATIENCE if ring is not None else 0.1)
            said += [each for worker in workers if (each := _ended(worker, end))]
        return said if ring is not None else []


def _ended(worker: Worker, end: float) -> str:
    """Waits until a process has ended, or ends it; the sentence on that."""
    process = worker.process
    if process is None:
        return ""
    process.join(max(0.1, end - time.monotonic()))
    if not process.is_alive():
        return ""
    process.terminate()
    process.join(2.0)
    if process.is_alive():
        process.kill()
        process.join()
    return f"the {worker.name} did not end by itself and was killed"
