"""Start the processes of `palpate live`, restart those that die, and end them in order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any

from palpate.errors import InputError
from palpate.live.stream_buffer import READERS, StreamBuffer

AGAIN, WITHIN = 5, 30.0  # a process is given up if it dies more than AGAIN times within WITHIN [s]
PATIENCE = 20.0  # s that a process may take to end


@dataclass
class Worker:
    """A function that runs in a process, which can be started again.

    Args:
        name: name in sentences.
        target: the function, importable.
        arguments: its arguments.
        process: the process; None before the first start.
        given_up: whether it is not started again.
        died: times [s] of its last deaths, by `time.monotonic`.
        rings: rings that it writes, where there are several; none: the first worker writes the only one.
    """

    name: str
    target: Callable[..., None]
    arguments: tuple[Any, ...]
    process: BaseProcess | None = None
    given_up: bool = False
    died: list[float] = field(default_factory=list[float])
    rings: list[StreamBuffer] = field(default_factory=list[StreamBuffer])

    def start(self) -> None:
        """Start the function in a new process."""
        made = get_context("spawn").Process(target=self.target, args=self.arguments, name=f"palpate {self.name}")
        made.start()
        self.process = made

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.process is not None and self.process.is_alive()


class WorkerSupervisor:
    """A supervisor that restarts workers and reports each restart in the ring.

    Args:
        workers: the writer of the ring, and then its readers; or writers of rings of their own, in any order.
    """

    def __init__(self, workers: list[Worker]) -> None:
        self.workers = workers

    @property
    def writers(self) -> list[Worker]:
        """Workers that write rings."""
        return [each for each in self.workers if each.rings] or self.workers[:1]

    def watch(self, ring: StreamBuffer) -> None:
        """Restart workers that have died, up to 5 times within 30 s; call this a few times a second.

        Raises:
            InputError: the writer died more often, or each of several.
        """
        now = time.monotonic()
        for worker in [each for each in self.workers if not (each.alive or each.given_up)]:
            own = worker.rings[0] if worker.rings else ring
            code = None if worker.process is None else worker.process.exitcode
            worker.died = [at for at in worker.died if now - at < WITHIN] + [now]
            why = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"
            if len(worker.died) > AGAIN:
                worker.given_up = True
                said = f"the {worker.name} {why} too often, and is not started again"
                own.say(said)
                if all(each.given_up for each in self.writers):
                    hint = "Free memory, check the device, and start again; `palpate recover` completes a record."
                    raise InputError(f"{said}.", where="palpate live", hint=hint)
                continue
            worker.start()
            own.say(f"the {worker.name} {why}, and was started again")

    def stop(self, ring: StreamBuffer | None) -> list[str]:
        """End all workers, the writer first, and return a sentence on each that had to be killed.

        Without a ring, when nothing has begun, end them at once and return [].
        """
        said, writers = list[str](), self.writers
        rings = [own for each in writers for own in each.rings] or [ring]
        readers = [each for each in self.workers if each not in writers]
        for level, workers in ((1, writers), (READERS, readers)):
            for own in (each for each in rings if each is not None):
                own["stop"] = level
            end = time.monotonic() + (PATIENCE if ring is not None else 0.1)
            said += [each for worker in workers if (each := _ended(worker, end))]
        return said if ring is not None else []


def _ended(worker: Worker, end: float) -> str:
    """Wait for a process until `end` [s], then kill it, and return a sentence on that; else ""."""
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
