"""Start the receivers of `palpate live`: one for a rig of one sensor, or one for each sensor of a robot."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path

from palpate.console.console import note
from palpate.console.keys import Came
from palpate.errors import InputError
from palpate.live.joints import NAME, joint_source
from palpate.live.receiver import receive, receive_joints, receive_together
from palpate.live.stream_buffer import StreamBuffer
from palpate.live.supervisor import Worker
from palpate.setup.load import load_rig, robot_of
from palpate.setup.rig import Rig

START = 180.0  # s in which a receiver must have its ring: the first time kernels are compiled


@dataclass(frozen=True)
class Sensors:
    """The sensors that are received: the one of a rig, or some of a robot.

    Attributes:
        rig: file of the rig.
        rigs: name -> rig of each; of a rig of one sensor, the name is that of its table or "".
        several: whether they are several of a robot.
        faulty: name of a sensor that the rig does not state well -> what is wrong.
        joints: whether joint states are received too.
    """

    rig: Path
    rigs: dict[str, Rig]
    several: bool
    faulty: dict[str, InputError]
    joints: bool

    @classmethod
    def of(cls, rig: Path, stated: str | None) -> Sensors:
        """Return the sensors of a rig, or those `stated`, with commas between the names.

        Raises:
            InputError: the rig cannot be used, or has no such sensor.
        """
        robot = robot_of(rig)
        names = None if stated is None else tuple(stated.split(","))
        if robot is None or (names is not None and len(names) == 1):
            return cls(rig, {stated or "": load_rig(rig, stated)}, False, {}, False)
        rigs = {each.name: each.rig for each in robot.picked(names)}
        faulty = {} if names is not None else dict(robot.faulty)
        return cls(rig, rigs, True, faulty, joint_source(robot, names) is not None)

    def receivers(self, ring: Callable[[str], Path], *, realtime: bool, recorded: bool) -> list[LiveStream]:
        """Return the receivers, not started yet; `ring`: returns the path of a ring by the sensor's name or ""."""
        together = get_context("spawn").Event() if self.several else None

        def stream(name: str, path: Path, target: Callable[..., None], of: object, *more: bool) -> LiveStream:
            problems, sender = Pipe(duplex=False)
            arguments = (self.rig, path, of, os.getpid(), sender, *more, recorded, together)
            called = f"receiver of {name}" if self.several else "receiver"
            return LiveStream(name, path, Worker(called, target, arguments), problems, together)

        def shared(names: list[str]) -> list[LiveStream]:
            paths, pipes = list(map(ring, names)), [Pipe(duplex=False) for _ in names]
            senders = [sender for _, sender in pipes]
            arguments = (self.rig, paths, names, os.getpid(), senders, realtime, recorded, together)
            worker = Worker(f"receiver of {', '.join(names)}", receive_together, arguments)
            each = zip(names, paths, [pipe for pipe, _ in pipes], strict=True)
            return [LiveStream(name, path, worker, pipe, together) for name, path, pipe in each]

        own = list[LiveStream]()
        for names in self._logs():
            alone, path = names[0], ring(names[0] if self.several else "")
            own += shared(names) if len(names) > 1 else [stream(alone, path, receive, alone or None, realtime)]
        own.sort(key=lambda each: list(self.rigs).index(each.name))
        if self.joints:  # its ring is called as no sensor can be
            own.append(stream(NAME, ring(f"_{NAME}"), receive_joints, tuple(self.rigs)))
        return own

    def _logs(self) -> list[list[str]]:
        """Return the names of sensors that one process receives: those in a log that is replayed at most at its speed.

        Each other sensor is alone.
        """
        found = dict[tuple[str, str], list[str]]()
        for name, rig in self.rigs.items():
            source = rig.stream()
            slow = self.several and source.kind == "replay" and 0.0 < source.speed <= 1.0
            found.setdefault((source.address, "") if slow else ("", name), []).append(name)
        return list(found.values())


@dataclass
class LiveStream:
    """A receiver, and the ring that it makes.

    Attributes:
        name: of the sensor; `joints.NAME` for joint states.
        path: file of the ring.
        worker: the receiver.
        problems: pipe in which it states the error that ended it, or that it is prepared.
        together: what it waits for then; None: it does not.
        prepared: whether it waits.
        ring: the ring, once it is there.
        failed: whether the receiver has left it out.
    """

    name: str
    path: Path
    worker: Worker
    problems: Connection
    together: Event | None = None
    prepared: bool = False
    ring: StreamBuffer | None = None
    failed: bool = False

    @property
    def over(self) -> bool:
        """True once nothing more is received."""
        return self.failed or self.worker.given_up

    def problem(self, timeout: float = 0.0) -> str:
        """Return the message of the error that ended the receiver; "" if there is none within `timeout` [s]."""
        with suppress(EOFError):
            if self.problems.poll(timeout):
                text = self.problems.recv_bytes().decode(errors="replace")
                self.prepared |= not text
                return text
        return ""

    def lacking(self, end: float) -> str:
        """Open the ring if it is there; else return why it will not be, or "" while it may come until `end` [s]."""
        if self.path.exists():
            self.ring = StreamBuffer(self.path)
            self.worker.rings.append(self.ring)
            return ""
        if problem := self.problem():
            return problem
        if not self.worker.alive:
            ended = "palpate live: the process that receives samples ended before it was ready, without a message."
            return self.problem(1.0) or f"{ended} Free memory, and start again."
        if time.monotonic() > end:
            late = f"palpate live: the process that receives samples is not ready after {START:g} s."
            return f"{late} Check that the device answers, and start again."
        return ""


def ready(streams: Sequence[LiveStream], came: Came) -> list[LiveStream]:
    """Return the receivers that have their rings, once all others have failed, which are named in warnings.

    Raises:
        InputError: no sensor's has.
        KeyboardInterrupt: Ctrl-C before.
    """
    end, waiting, failed = time.monotonic() + START, list(streams), dict[str, str]()
    while waiting:
        if came.stop:
            raise KeyboardInterrupt
        for each in list(waiting):
            if problem := each.lacking(end):
                failed[each.name] = problem
            if problem or each.ring is not None:
                waiting.remove(each)
        if (together := streams[0].together) is not None and all(each.prepared for each in waiting):
            together.set()
        time.sleep(0.02)
    found = [each for each in streams if each.ring is not None]
    if all(each.name == NAME for each in found):
        raise InputError(" ".join(failed.values() if len(streams) == 1 else _left_out(failed)))
    note(_left_out(failed), kind="warning")
    return found


def left_out(streams: Sequence[LiveStream]) -> None:
    """Give up receivers that have ended with an error, and report these; the others run on.

    Raises:
        InputError: it is the last one.
    """
    for each in streams:
        if not each.over and (problem := each.problem()):
            each.failed = True
            each.worker.given_up = all(other.over for other in streams if other.worker is each.worker)
            if each.ring is not None:
                each.ring.say(problem if len(streams) == 1 else f"left out from here on: {problem}")
            if all(other.over for other in streams if other.name != NAME):
                raise InputError(problem)


def _left_out(failed: dict[str, str]) -> list[str]:
    return [f"{name} is left out: {problem}" for name, problem in failed.items()]
