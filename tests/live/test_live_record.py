"""The recorder of `palpate live`: what it writes is read again to the last bit, and outlives its writers."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from palpate.errors import InputError
from palpate.files.atomic import part
from palpate.files.contacts import read_contacts
from palpate.files.logs import ArrayChannel, ImageChannel, LogLayout, read_recording
from palpate.files.mcap.regain import regained
from palpate.live.record import Recorder, only_one, record, require_record, ring_of
from palpate.live.recover import cut_short, recover
from palpate.live.source import Batch
from palpate.live.stream_buffer import READERS, SlotForm, StreamBuffer
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION
from tests.support.kill_recorder import BEGIN, FORM, RATE, answers, batch, numbers

parsed = cache(get_types_from_msg)
ROOT = Path(__file__).resolve().parents[2]
FOREVER = float("inf")


@pytest.fixture
def output(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def _ring(output: Path, form: SlotForm = FORM, size: int = 1 << 22) -> StreamBuffer:
    return StreamBuffer.make(ring_of(output), form, size)


def _feed(ring: StreamBuffer, count: int, *, answered: bool = True, made: Batch | None = None) -> None:
    """So many more samples, with a contact each."""
    first = ring["received"]
    ring.take_in(made or batch(first, count, ring.form.shape), count, np.zeros(count))
    if answered:
        ring.answer(answers(first, count), np.ones(count, dtype=np.int64))


def _written(output: Path, made: Batch, form: SlotForm = FORM) -> None:
    """A whole record of a batch; of an array or of images in the form of its samples."""
    ring = _ring(output, form)
    _feed(ring, len(made), made=made)
    Recorder(ring, output, FOREVER).finish()


def _recorded(ring: StreamBuffer, output: Path, blocks: Iterator[int] | list[int], split: float = FOREVER) -> Recorder:
    """A recorder that was fed, not ended."""
    recorder = Recorder(ring, output, split)
    for count in blocks:
        _feed(ring, count)
        recorder.step()
    return recorder


def _decoded(path: Path, *topics: str) -> dict[str, list[Any]]:
    """Messages of these topics, or of all, as rosbags reads them, by the definitions in the file alone."""
    store = get_typestore(Stores.EMPTY)
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(topics or None):
            assert schema is not None
            if schema.name not in store.fielddefs:
                store.register(parsed(schema.data.decode(), schema.name))
            found.setdefault(channel.topic, []).append(store.deserialize_cdr(message.data, schema.name))
    return found


def _events(path: Path) -> list[str]:
    return [each.msg for each in _decoded(path, "/palpate/live/events").get("/palpate/live/events", [])]


def _known(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and values of the first samples."""
    made = batch(0, count)
    return made.stamp, made.values


def test_a_log_of_the_same_rig_reads_readings_times_and_contacts_again(output: Path) -> None:
    ring = _ring(output)
    ring.say("the sensor was found")
    _recorded(ring, output, [300] * 10).finish()
    stamps, values = _known(3000)
    found = read_recording(output)
    np.testing.assert_array_equal(found.wrenches(), values)
    np.testing.assert_array_equal(found.time, [stamp // 10**9 + stamp % 10**9 / 1e9 for stamp in stamps.tolist()])
    assert not any("no stamps" in note for note in found.notes)
    contacts = read_contacts(output)
    np.testing.assert_array_equal(contacts.sample, np.arange(3000))
    np.testing.assert_array_equal(contacts.point[:, 0], np.arange(3000))
    np.testing.assert_array_equal(contacts.time, found.time)
    assert _events(output) == ["the sensor was found"]
    assert (ring["recorded"], ring["bytes"]) == (3000, output.stat().st_size)
    assert not part(output).exists()


def test_the_readings_are_under_the_name_that_the_rig_says(output: Path) -> None:
    """And the wrenches of the contacts are never taken for readings."""
    _written(output, batch(0, 50), replace(FORM, topic="/ft/wrench"))
    found = read_recording(output, LogLayout(wrench_topic="/ft/wrench"))
    np.testing.assert_array_equal(found.wrenches(), _known(50)[1])


@pytest.mark.parametrize("shape", [(12,), (6, 22)])
def test_arrays(output: Path, shape: tuple[int, ...]) -> None:
    ring = _ring(output, replace(FORM, sensor="skin", shape=shape, wrenches=False))
    _recorded(ring, output, [50]).finish()
    layout = LogLayout(wrench=None, arrays=(ArrayChannel("cells", shape, table="skin"),))
    found = read_recording(output, layout)
    np.testing.assert_array_equal(found.channels["cells"], batch(0, 50, shape).values)
    assert found.time[1] == (BEGIN + 10**9 // RATE) // 10**9 + (BEGIN + 10**9 // RATE) % 10**9 / 1e9


def test_poses_and_accelerations_stand_where_they_were_known_and_nowhere_between(output: Path) -> None:
    made, rng = batch(0, 400), np.random.default_rng(2)
    quaternion = rng.normal(size=(400, 4))
    made.orientation[:] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    made.position[:], made.acceleration[:] = rng.normal(size=(2, 400, 3))
    made.orientation[100:110] = made.acceleration[300:320] = np.nan
    _written(output, made, replace(FORM, poses=True))
    made.position[100:110] = np.nan
    found = read_recording(output, LogLayout(frames=("base", "tool"), offset=0.5))  # of /tf in other logs of this rig
    np.testing.assert_array_equal(found.channels[ORIENTATION], made.orientation)
    np.testing.assert_array_equal(found.channels[POSITION], made.position)
    np.testing.assert_array_equal(found.channels[ACCELERATION], made.acceleration)


def test_messages_are_what_their_definitions_say(output: Path) -> None:
    """As Foxglove reads them: it knows nothing but the file."""
    made = batch(0, 3, (2, 5))
    made.lost[1] = 4
    made.orientation[:], made.position[:], made.acceleration[:] = (0.0, 0.0, 0.6, 0.8), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
    ring = _ring(output, replace(FORM, sensor="skin", shape=(2, 5), wrenches=False))
    ring.say("über all")
    _feed(ring, 3, made=made)
    Recorder(ring, output, FOREVER).finish()
    there = _decoded(output)
    array = there["/palpate/live/readings"][2]
    np.testing.assert_array_equal(array.data, made.values[2].ravel())
    labels = [(each.label, each.size, each.stride) for each in array.layout.dim]
    assert labels == [("row", 2, 10), ("column", 5, 5)]
    pose, acceleration = there["/palpate/live/pose"][0], there["/palpate/live/acceleration"][1]
    assert (pose.pose.position.z, pose.pose.orientation.w, pose.header.frame_id) == (3.0, 0.8, "base")
    assert (acceleration.vector.x, acceleration.vector.z) == (4.0, 6.0)
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == divmod(BEGIN, 10**9)
    lost, said = sorted(there["/palpate/live/events"], key=lambda each: each.level, reverse=True)
    assert (lost.level, lost.msg) == (30, "4 samples are missing before sample 1")
    assert (said.level, said.msg, said.name, said.line) == (20, "über all", "palpate live", 0)
    assert [contact.sample for contact in there["/palpate/contact/estimate"]] == [0, 1, 2]


def test_images(output: Path) -> None:
    """As they were, for a log's reader and for one that knows nothing but the file."""
    pytest.importorskip("cv2", reason="OpenCV reads images (pip install 'palpate[camera]')")
    form = replace(FORM, sensor="marker_ring", shape=(5, 7, 3), images=True, wrenches=False)
    made = Batch(form.shape, 20, np.uint8)
    made.values[:] = np.random.default_rng(1).integers(0, 256, made.values.shape, dtype=np.uint8)
    made.stamp[:] = batch(0, 20).stamp
    _written(output, made, form)
    found = read_recording(output, LogLayout(wrench=None, images=ImageChannel()))
    np.testing.assert_array_equal(found.channels["image"], made.values)
    image = _decoded(output)["/palpate/live/image"][1]
    assert (image.height, image.width, image.encoding, image.step, image.is_bigendian) == (5, 7, "bgr8", 21, 0)
    np.testing.assert_array_equal(image.data, made.values[1].ravel())


def test_a_file_that_is_large_enough_gives_way_to_the_next_and_each_opens_on_its_own(output: Path) -> None:
    ring = _ring(output)
    recorder = _recorded(ring, output, [1024] * 12, split=4e5)
    recorder.finish()
    files = [output, *(output.with_name(f"run.{k}.mcap") for k in range(1, ring["file"]))]
    assert len(files) > 2
    assert sorted(files) == sorted(output.parent.glob("*.mcap"))
    found = [read_recording(file).wrenches()[:, 0] for file in files]
    np.testing.assert_array_equal(np.concatenate(found), np.arange(12 * 1024))
    np.testing.assert_array_equal(np.concatenate([read_contacts(file).sample for file in files]), np.arange(12 * 1024))
    assert ring["bytes"] == sum(file.stat().st_size for file in files)
    ring_of(output).unlink()
    with pytest.raises(InputError, match=r"an earlier record of several files.*Remove"):
        require_record(output)


def test_a_recorder_that_is_started_again_goes_on_where_the_file_ends(output: Path) -> None:
    ring = _ring(output)
    ring.say("first")
    _recorded(ring, output, [2048, 100])  # of which the second waits for more, and the process is killed
    with part(output).open("ab") as file:
        file.write(b"\x06" + bytes(50))  # a chunk that was not written to its end
    ring.say("second")
    _feed(ring, 30)
    _recorded(ring, output, [200]).finish()
    np.testing.assert_array_equal(read_recording(output).wrenches(), _known(2378)[1])
    assert _events(output) == ["first", "second"]


def test_before_its_end_the_file_is_read_by_others_too(output: Path) -> None:
    _recorded(_ring(output), output, [2048, 2048])
    with part(output).open("rb") as file:
        streamed = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
        topics = list[str]()
        with pytest.raises(McapError):  # at its end, where no footer is yet
            topics.extend(channel.topic for _, channel, _ in streamed)
    assert topics.count("/palpate/live/wrench") == 4096


def test_a_reader_that_was_lapped_says_how_many_are_not_recorded(output: Path) -> None:
    ring = _ring(output, size=1)  # as few slots as there may be
    recorder = _recorded(ring, output, [100])
    for _ in range(20):
        _feed(ring, 100)
    recorder.finish()
    found = read_recording(output).wrenches()[:, 0]
    assert ring["missed"] == 2100 - len(found) > 0
    assert found[-1] == 2099
    assert np.all(np.diff(found) > 0)
    assert _events(output)[0].startswith(f"{ring['missed']} samples from sample")


def test_readings_are_recorded_even_if_answers_do_not_come(output: Path) -> None:
    """Before the ring goes over them."""
    ring = _ring(output)
    recorder, count = Recorder(ring, output, FOREVER), 0
    while count < 3 * len(ring.slots):
        _feed(ring, 500, answered=False)
        recorder.step()
        count += 500
    recorder.finish()
    np.testing.assert_array_equal(read_recording(output).wrenches()[:, 0], np.arange(count))
    assert ring["missed"] == 0


def test_recover_puts_file_and_ring_together_twice(output: Path) -> None:
    ring = _ring(output)
    _recorded(ring, output, [2048, 700])
    _feed(ring, 30, answered=False)
    output.with_name(f".{output.name}.lock").write_text("1 on a machine", encoding="utf-8")  # of a killed process
    ring.close()
    assert "2,048 samples in run.mcap.part, 730 more in run.mcap.ring" in cut_short(output)
    said = recover(output)
    assert (
        "2,048 samples were recorded, 730 more were in the ring (30 of them without contacts); none is missing" in said
    )
    np.testing.assert_array_equal(read_recording(output).wrenches(), _known(2778)[1])
    assert len(read_contacts(output)) == 2748
    assert numbers([output]) == (list(range(2778)), list(range(2748)))
    raw = output.read_bytes()
    assert "nothing to recover" in recover(output)
    assert output.read_bytes() == raw
    assert [file.name for file in output.parent.iterdir()] == [output.name]
    assert not cut_short(output)


def test_recover_goes_on_wherever_another_was_killed(output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = _ring(output)
    _recorded(ring, output, [2048, 700])
    ring.close()
    for name in ("ftruncate", "pwrite", "fdatasync", "fsync", "unlink"):

        def killed(*_: object) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr(os, name, killed)
            with pytest.raises(KeyboardInterrupt):
                recover(output)
    recover(output)
    np.testing.assert_array_equal(read_recording(output).wrenches(), _known(2748)[1])


def test_recover_is_refused_while_it_is_written(output: Path) -> None:
    ring = _ring(output)
    _recorded(ring, output, [2048])
    ring["alive"] = time.time_ns()
    with pytest.raises(InputError, match=r"is still being written\..*wait two seconds"):
        recover(output)
    ring["alive"] = 0
    with only_one(ring.path), pytest.raises(InputError, match=r"another process.*Stop"):
        recover(output)
    recover(output)
    with pytest.raises(InputError, match=r"nothing to recover.*Name"):
        recover(output.with_name("other.mcap"))


def test_a_part_cut_anywhere_is_made_whole_from_the_ring(output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.record.CHUNK", 100)
    ring = _ring(output)
    ring.say("begun")
    _recorded(ring, output, [100] * 6)
    raw, head = part(output).read_bytes(), ring_of(output).read_bytes()
    cuts = np.random.default_rng(4).integers(0, len(raw), 30)
    for cut in [0, len(raw), *cuts.tolist()]:
        part(output).write_bytes(raw[:cut])
        ring_of(output).write_bytes(head)
        recover(output)
        np.testing.assert_array_equal(read_recording(output).wrenches(), _known(600)[1])
        np.testing.assert_array_equal(read_contacts(output).sample, np.arange(600))
        assert _events(output) == ["begun"]
        output.unlink()


def test_samples_that_waited_for_several_spans_become_as_many_chunks(output: Path) -> None:
    recorder = _recorded(_ring(output), output, [])
    recorder._span, recorder._written = 1e4, time.monotonic() - 4e4  # long, or a busy machine could add one
    _feed(recorder._ring, 90)
    recorder.step()
    found = regained(part(output))
    assert found is not None
    assert [sum(chunk.counts) for chunk in found.writer.chunks] == [92, 92, 88, 88]  # of four channels


def test_a_part_without_a_ring_keeps_every_whole_chunk(output: Path) -> None:
    _recorded(_ring(output), output, [2048, 2048])
    ring_of(output).unlink()
    raw = part(output).read_bytes()
    part(output).write_bytes(raw[: len(raw) - 100])
    assert "2,048 samples were recorded" in recover(output)
    assert numbers([output])[0] == list(range(2048))


def test_slots_that_never_reached_the_disk_are_left_out(output: Path) -> None:
    """As when the power is cut: the head of the ring is on the disk, a page of it is not."""
    ring = _ring(output)
    _recorded(ring, output, [1024, 500])
    ring.slots["number"][1200:1210] = 0
    said = recover(output)
    assert "324 in the ring were damaged" in said
    assert numbers([output])[0] == list(range(1200))


def test_a_full_disk_ends_the_record_and_keeps_what_was_written(output: Path) -> None:
    """As a limit on the size of files, which neither all chunks nor, behind three of them, the summary have room in."""
    _recorded(_ring(output), output, [1024] * 4).finish()
    limit = output.stat().st_size - 4000
    output.unlink()
    ring, usual = _ring(output), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max(limit, ring_of(output).stat().st_size // 64), usual[1]))
    try:
        recorder = _recorded(ring, output, [1024] * 12)
        assert recorder.full
        count = len(numbers([output])[0])  # it is whole at once
        recorder.step()
        recorder.finish()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert len(numbers([output])[0]) == count == ring["recorded"]
    assert count % 1024 == 0
    assert count >= 1024
    said = [text for _, text in ring.events(0)[0]]
    assert len(said) == 1
    assert f"recording has stopped: run.mcap cannot be written (File too large); the {count:,} samples" in said[0]


def test_the_process_ends_when_the_ring_says_stop_or_the_parent_is_gone(output: Path) -> None:
    ring = _ring(output)
    _feed(ring, 500)
    ring["stop"] = READERS
    record([ring.path], output, FOREVER, os.getppid())
    assert numbers([output])[0] == list(range(500))
    other = output.with_name("other.mcap")
    ring = _ring(other)
    _feed(ring, 500)
    record([ring.path], other, FOREVER, -1)
    assert numbers([other])[0] == list(range(500))


def test_nothing_that_was_received_is_lost_by_kills(tmp_path: Path) -> None:
    """Of the writer, of the recorder, of both; `kill_recorder 200` is the same for longer."""
    run = [sys.executable, "-m", "tests.support.kill_recorder", "6"]
    done = subprocess.run(run, cwd=ROOT, env={**os.environ, "TMPDIR": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "2 records put together: all of" in done.stdout


def test_memory_of_a_chunk_is_small(output: Path) -> None:
    """What the index keeps of a chunk until the file is split: a few hundred bytes."""
    _recorded(_ring(output), output, [2048])
    found = regained(part(output))
    assert found is not None
    assert sys.getsizeof(found.writer.chunks[-1].entry) < 300


def test_a_record_that_cannot_begin_is_refused(output: Path) -> None:
    require_record(output)
    with pytest.raises(InputError, match=r"a record cannot end in '\.csv'.*Use"):
        require_record(output.with_suffix(".csv"))
    part(output).write_bytes(b"")
    with pytest.raises(InputError, match=r"was interrupted.*Run"):
        require_record(output)
    part(output).write_bytes(bytes(1 << 15))
    ring = _ring(output)
    with pytest.raises(InputError, match=r"part: .*not a file of `palpate live`"):
        Recorder(ring, output, FOREVER)
    with pytest.raises(SystemExit):
        record([ring.path], output, FOREVER, -1)
    assert "recording has stopped" in ring.events(0)[0][0][1]


def test_inspect_says_what_was_cut_short_and_changes_nothing(output: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from palpate.cli.inspect import inspect
    from palpate.cli.recover import recover as command

    ring = _ring(output)
    recorder = _recorded(ring, output, [1024] * 4, split=2e5)
    recorder.step()
    ring.close()
    before = {file.name: file.read_bytes() for file in output.parent.iterdir()}
    assert {"run.mcap", "run.mcap.ring"} < set(before)
    inspect(output)
    assert "writing was interrupted" in (said := "".join(capsys.readouterr()))
    assert f"palpate recover {output}" in said.replace("\n", " ").replace("  ", " ")
    with pytest.raises(InputError, match=r"ring: writing was interrupted"):
        inspect(ring_of(output))
    assert {file.name: file.read_bytes() for file in output.parent.iterdir()} == before
    command(output)
    assert "none is missing" in "".join(capsys.readouterr())
    inspect(output)
    said = "".join(capsys.readouterr())
    assert "cut short" not in said
    assert "/palpate/live/wrench" in said
