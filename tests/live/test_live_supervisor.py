"""What dies is started again, so many times; processes here are stand-ins that never live."""

from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.live.supervisor import AGAIN, Worker, WorkerSupervisor


class _Dying(Worker):
    """Dies as soon as it is started."""

    starts = 0

    def start(self) -> None:
        self.starts += 1


@pytest.fixture
def ring(tmp_path: Path) -> StreamBuffer:
    return StreamBuffer.make(
        tmp_path / "ring", SlotForm("force_torque", (6,), False, (), 22, 1, wrenches=True), 1 << 18
    )


class _Living(_Dying):
    alive = property(lambda self: True)


def test_a_reader_that_dies_again_and_again_is_given_up_once_and_said(ring: StreamBuffer) -> None:
    writer, reader = _Living("receiver", print, ()), _Dying("page", print, ())
    supervisor = WorkerSupervisor([writer, reader])
    for _ in range(AGAIN + 5):
        supervisor.watch(ring)
    said = [sentence for _, sentence in ring.events(0)[0]]
    assert reader.starts == AGAIN
    assert writer.starts == 0
    assert len([each for each in said if "not started again" in each]) == 1
    assert said[-1].startswith("the page")


def test_without_the_writer_there_is_nothing_to_wait_for(ring: StreamBuffer) -> None:
    supervisor = WorkerSupervisor([_Dying("receiver", print, ()), _Living("recorder", print, ())])
    for _ in range(AGAIN):
        supervisor.watch(ring)
    with pytest.raises(InputError, match=r"receiver ended with code None too often.*Free"):
        supervisor.watch(ring)
    assert [worker.name for worker in supervisor.workers] == ["receiver", "recorder"]  # ended in this order
