"""Images come as they were written: every frame once, in its order, at its time, whatever file they are in."""

import pickle
import re
import weakref
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.errors import InputError
from palpate.files.logs import (
    ArrayChannel,
    ImageChannel,
    LogLayout,
    contents,
    image_size,
    join,
    missing,
    open_log,
    read_recording,
)
from palpate.setup.built import BuiltEstimator
from palpate.setup.link import Link
from palpate.setup.pipeline import OpenedLog, SeenSamples
from palpate.setup.setup import SensorKind, Setup
from palpate.signals.recording import CELLS, IMAGE, Recording
from tests.support.image_files import (
    BAGS,
    CODECS,
    COLOUR,
    HEIGHT,
    RATE,
    ROS2,
    WIDTH,
    Message,
    colour,
    compressed,
    frame,
    numbers,
    raw,
    write_frames,
    write_images,
    write_messages,
    write_video,
)

LAYOUT = LogLayout(wrench=None, images=ImageChannel())
COUNT = 75


def images(recording: Recording) -> np.ndarray:
    """Of a recording of images, whose times are those of as many."""
    found = recording.channels[IMAGE]
    assert found.dtype == np.uint8
    assert not found.flags.writeable
    assert len(recording.time) == len(found)
    return found


def black(recording: Recording) -> list[int]:
    """Rows of zeros."""
    return np.flatnonzero(~images(recording).any(axis=(1, 2, 3))).tolist()


@pytest.mark.parametrize("name", CODECS)
def test_a_video_is_every_frame_once_in_its_order(tmp_path: Path, name: str) -> None:
    path = write_video(tmp_path / name, COUNT)
    recording = read_recording(path, LAYOUT)
    assert numbers(images(recording)) == list(range(COUNT))
    np.testing.assert_allclose(colour(images(recording)), COLOUR, atol=8)  # lossy; red and blue are 160 apart
    np.testing.assert_allclose(recording.time, np.arange(COUNT) / RATE, rtol=0, atol=1e-9)
    assert recording.notes == ()
    said = contents(path).images
    assert (said.size, said.count, said.rate) == ((HEIGHT, WIDTH, 3), COUNT, RATE)
    assert image_size(path) == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    ("limit", "value", "rows"),
    [("ROWS", 1, 1), ("ROWS", 7, 7), ("ROWS", 1000, 40), ("BYTES", 5 * 3 * HEIGHT * WIDTH, 5)],
)
def test_blocks_of_any_size_are_the_same_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, rows: int
) -> None:
    path = write_video(tmp_path / "log.avi", 40)
    whole = read_recording(path, LAYOUT)
    monkeypatch.setattr(f"palpate.files.logs.images.{limit}", value)
    log = open_log(path, LAYOUT)
    blocks = list(log.blocks())
    assert [len(block) for block in blocks[:-1]] == [rows] * (len(blocks) - 1)
    assert np.array_equal(images(join(blocks)), images(whole))
    assert np.array_equal(join(blocks).time, whole.time)
    assert log.position == log.size


def test_the_rate_of_the_rig_is_taken_before_that_of_the_video(tmp_path: Path) -> None:
    path = write_video(tmp_path / "log.mp4", 10)
    recording = read_recording(path, LogLayout(wrench=None, images=ImageChannel(), rate=200.0))
    np.testing.assert_allclose(recording.time, np.arange(10) / 200.0, atol=1e-12)


def test_stamps_that_vary_are_the_times(tmp_path: Path) -> None:
    """Those of Matroska are whole milliseconds, in 16 bits behind the number of the track."""
    path = write_video(tmp_path / "log.mkv", 20)
    content, shift = path.read_bytes(), [0, 3, 11, 2] * 5
    for k in range(20):
        stamp = b"\x81" + (40 * k).to_bytes(2, "big")
        assert len(re.findall(re.escape(stamp) + rb"[\x80\0]", content)) == 1
        content = re.sub(re.escape(stamp) + rb"(?=[\x80\0])", b"\x81" + (40 * k + shift[k]).to_bytes(2, "big"), content)
    path.write_bytes(content)
    recording = read_recording(path, LAYOUT)
    np.testing.assert_allclose(recording.time, 0.04 * np.arange(20) + 1e-3 * np.array(shift), atol=1e-9)
    assert numbers(images(recording)) == list(range(20))


def test_a_frame_that_cannot_be_decoded_keeps_its_row(tmp_path: Path) -> None:
    path = write_video(tmp_path / "log.avi", COUNT)
    content = bytearray(path.read_bytes())
    starts = [found.start() for found in re.finditer(rb"00dc(?=....\xff\xd8)", content, re.DOTALL)]
    assert len(starts) == COUNT
    for number in (0, 40, 41):
        content[starts[number] + 8 : starts[number] + 200] = bytes(192)
    path.write_bytes(content)
    recording = read_recording(path, LAYOUT)
    assert black(recording) == [0, 40, 41]
    found = numbers(images(recording))
    assert [found[k] for k in range(COUNT) if k not in (0, 40, 41)] == [k for k in range(COUNT) if k not in (0, 40, 41)]
    np.testing.assert_allclose(recording.time, np.arange(COUNT) / RATE, atol=1e-9)
    said = "3 of 75 frames could not be decoded and are replaced by black ones: frame 1, frame 41, frame 42"
    assert said in recording.notes


@pytest.mark.parametrize("name", ["log.avi", "log.mkv"])
def test_a_video_cut_short_is_read_up_to_the_cut(tmp_path: Path, name: str) -> None:
    path = write_video(tmp_path / name, COUNT)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * len(content))])
    log = open_log(path, LAYOUT)
    recording = join(list(log.blocks()))
    count = len(recording)
    assert 0.4 * COUNT < count < 0.8 * COUNT
    assert f"it announces {COUNT} frames and holds {count}" in log.torn
    assert black(recording) in ([], [count - 1])  # the one that was cut
    whole = count - len(black(recording))
    assert numbers(images(recording))[:whole] == list(range(whole))


@pytest.mark.parametrize("name", CODECS)
def test_a_video_with_changed_bytes_is_rows_or_a_sentence(tmp_path: Path, name: str) -> None:
    content, rng = write_video(tmp_path / name, 20).read_bytes(), np.random.default_rng(0)
    for _ in range(20):
        changed = bytearray(content[: rng.integers(16, len(content)) if rng.random() < 0.3 else None])
        for at in (*rng.integers(len(changed), size=5), *rng.integers(min(600, len(changed)), size=2)):
            changed[at] = rng.integers(256)
        (tmp_path / name).write_bytes(changed)
        try:
            recording = read_recording(tmp_path / name, LAYOUT)
        except InputError:
            continue
        images(recording)


def _damage(change: Callable[[bytes], bytes], name: str = "log.mp4") -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = write_video(folder / name, 30)
        path.write_bytes(change(path.read_bytes()))
        return path

    return make


def _empty_folder(folder: Path) -> Path:
    write_frames(folder / "frames", ["a.png"])
    (folder / "frames" / "a.png").write_bytes(b"nothing")
    return folder / "frames"


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (_damage(lambda content: content[: int(0.9 * len(content))]), "without its index.*Copy"),
        (_damage(lambda content: b""), ": is empty"),
        (_damage(lambda content: b"time,fx\n0,1\n"), ": does not begin as a video does"),
        (_damage(lambda content: content.replace(b"MJPG", b"XQZW"), "log.avi"), "no decoder for 'XQZW'.*Convert"),
        (_damage(lambda content: content[:300], "log.avi"), "cannot be opened|holds no frames"),
        (_empty_folder, "frames: none of its 1 frames can be decoded"),
    ],
)
def test_what_is_no_video_is_a_sentence(tmp_path: Path, make: Callable[[Path], Path], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        read_recording(make(tmp_path), LAYOUT)


def test_one_image_is_told_from_a_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is one image.*Name"):
        contents(write_frames(tmp_path / "frames", ["a.png"]) / "a.png")


def test_a_folder_is_its_frames_in_the_natural_order_of_their_names(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [f"frame_{k}.png" for k in range(12)])
    (folder / "readme.txt").write_text("no frame")
    recording = read_recording(folder, LAYOUT)
    assert np.array_equal(images(recording), np.stack([frame(k) for k in range(12)]))
    np.testing.assert_allclose(recording.time, np.arange(12) / 30.0, atol=1e-12)
    assert recording.notes == ("frames have no times: a rate of 30 Hz is assumed",)
    assert image_size(folder) == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("name", ["times.csv", "truth.csv"])
@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize("rows", [6, 5])
def test_the_times_of_a_folder_are_those_of_a_table_with_as_many_rows(
    tmp_path: Path, name: str, columns: int, rows: int
) -> None:
    folder, time = write_frames(tmp_path / "frames", [f"{k}.jpg" for k in range(6)]), np.cumsum(np.arange(rows)) + 7.5
    lines = ["time,depth", *(f"{each},{k}" for k, each in enumerate(time))]
    (folder / name).write_text("".join(",".join(line.split(",")[:columns]) + "\n" for line in lines))
    recording = read_recording(folder, LogLayout(wrench=None, images=ImageChannel(), rate=10.0))
    assert recording.time.tolist() == (time.tolist() if rows == 6 else pytest.approx(np.arange(6) / 10.0))
    assert any(f"{name} has 5 rows for 6 frames" in note for note in recording.notes) == (rows == 5)


def test_frames_that_cannot_be_read_or_are_of_another_size_keep_their_rows(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [f"{k}.png" for k in range(6)])
    (folder / "0.png").write_bytes(b"")
    (folder / "2.png").write_bytes((folder / "2.png").read_bytes()[:60])
    cv2.imwrite(str(folder / "3.png"), frame(3, 32, 32))
    cv2.imwrite(str(folder / "4.png"), frame(4)[:, :, 0].astype(np.uint16) * 256)
    cv2.imwrite(str(folder / "5.png"), frame(5)[:, :, 0])
    recording = read_recording(folder, LAYOUT)
    assert black(recording) == [0, 2, 3]
    for k in (4, 5):  # grey, of 16 bits and of 8
        assert np.array_equal(images(recording)[k], np.repeat(frame(k)[:, :, :1], 3, axis=2))
    assert any(
        "frames could not be decoded and are replaced by black ones: 0.png, 2.png" in each for each in recording.notes
    )
    assert any("1 of 6 frames are not 64 x 48 like the others" in each and "3.png" in each for each in recording.notes)


def _yuv(image: np.ndarray, way: str) -> np.ndarray:
    return cv2.cvtColor(image, getattr(cv2, f"COLOR_BGR2YUV_{way}"))


def _mosaic(image: np.ndarray, order: str) -> np.ndarray:
    """Of each pixel the colour that its place in squares of two by two stands for."""
    found = np.empty(image.shape[:2], dtype=image.dtype)
    for k, letter in enumerate(order):
        found[k // 2 :: 2, k % 2 :: 2] = image[k // 2 :: 2, k % 2 :: 2, "bgr".index(letter)]
    return found


ENCODINGS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], int]] = {  # -> pixels, and how far off they may come
    "bgr8": (lambda image: image, 0),
    "8UC3": (lambda image: image, 0),
    "rgb8": (lambda image: image[:, :, ::-1], 0),
    "bgra8": (lambda image: np.dstack([image, image[:, :, 0]]), 0),
    "rgba8": (lambda image: np.dstack([image[:, :, ::-1], image[:, :, 0]]), 0),
    "rgb16": (lambda image: image[:, :, ::-1].astype("<u2") * 256 + 77, 0),
    "yuv422": (lambda image: _yuv(image, "UYVY"), 3),  # eight bits of another space and back
    "yuv422_yuy2": (lambda image: _yuv(image, "YUY2"), 3),
    **{f"bayer_{order}8": (lambda image, order=order: _mosaic(image, order), 1) for order in ("rggb", "gbrg", "grbg")},
    "bayer_bggr16": (lambda image: _mosaic(image, "bggr").astype("<u2") * 256, 1),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_pixels_of_every_encoding_become_blue_green_red(tmp_path: Path, encoding: str) -> None:
    """In the lower half, one pixel away from its edge: a mosaic says little of where a colour ends."""
    pixels, off = ENCODINGS[encoding]
    messages = [raw(pixels(frame(k)), encoding, padding=5 * (k % 2)) for k in range(3)]
    recording = read_recording(write_images(tmp_path / "log.mcap", messages), LAYOUT)
    assert numbers(images(recording)) == [0, 1, 2]
    inner = images(recording)[:, HEIGHT // 2 + 2 : -2, 2:-2].astype(int)
    assert np.abs(inner - np.array(COLOUR)).max() <= off


@pytest.mark.parametrize("encoding", ["mono8", "mono16"])
@pytest.mark.parametrize("big", [False, True])
def test_grey_pixels_become_three_equal_channels(tmp_path: Path, encoding: str, big: bool) -> None:
    depth = np.dtype("u1" if encoding == "mono8" else "u2").newbyteorder(">" if big else "<")
    scale = 1 if encoding == "mono8" else 256
    messages = [raw((frame(k)[:, :, 0].astype(depth) * scale).astype(depth), encoding, big=big) for k in range(3)]
    path = write_images(tmp_path / "log.mcap", messages)
    recording = read_recording(path, LAYOUT)
    assert np.array_equal(images(recording), np.stack([np.repeat(frame(k)[:, :, :1], 3, axis=2) for k in range(3)]))
    assert image_size(path) == (HEIGHT, WIDTH, 1)
    sheet = LogLayout(wrench=None, arrays=(ArrayChannel(CELLS, (HEIGHT, WIDTH)),))  # as taxels they are read as before
    assert np.array_equal(read_recording(path, sheet).channels[CELLS][1] / scale, frame(1)[:, :, 0])


MESSAGES: dict[str, Callable[[int], Message]] = {
    "raw": lambda k: raw(frame(k), "bgr8"),
    "png": lambda k: compressed(frame(k), "png"),
    "jpeg": lambda k: compressed(frame(k), "jpeg"),
}


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("kind", MESSAGES)
def test_messages_of_every_file_are_the_same_images_at_their_stamps(tmp_path: Path, name: str, kind: str) -> None:
    path = write_images(tmp_path / name, [MESSAGES[kind](k) for k in range(40)])
    recording = read_recording(path, LAYOUT)
    assert numbers(images(recording)) == list(range(40))
    np.testing.assert_allclose(recording.time, 1.0 + 0.04 * np.arange(40), atol=1e-9)
    assert kind == "jpeg" or np.array_equal(images(recording)[7], frame(7))
    assert recording.notes == ()
    assert image_size(path) == (HEIGHT, WIDTH, 3)
    assert missing(contents(path), LAYOUT) == []


def test_messages_without_stamps_have_the_times_of_the_recorder(tmp_path: Path) -> None:
    path = write_images(tmp_path / "log.mcap", [raw(frame(k), "bgr8") for k in range(4)], stamps=[0] * 4)
    recording = read_recording(path, LAYOUT)
    assert recording.time.tolist() == [1.0] * 4
    assert any("have no stamps" in note for note in recording.notes)


def test_a_damaged_message_keeps_its_row(tmp_path: Path) -> None:
    """Cut, of an encoding that is not known, of another size, and a JPEG that is none."""
    odd: list[Message] = [raw(frame(k), "bgr8") for k in range(6)]
    odd[2], odd[3] = raw(frame(2), "32FC1"), raw(frame(3, 32, 32), "bgr8")
    kind, fields = odd[4]
    odd[4] = kind, (*fields[:-1], fields[-1][:-100])
    recording = read_recording(write_images(tmp_path / "raw.mcap", odd), LAYOUT)
    assert black(recording) == [2, 3, 4]
    np.testing.assert_allclose(recording.time, 1.0 + 0.04 * np.arange(6), atol=1e-9)
    assert any(
        "2 of 6 frames could not be decoded" in each and "message 3, message 5" in each for each in recording.notes
    )
    kind, fields = compressed(frame(1), "jpeg")
    packed = [compressed(frame(0), "jpeg"), (kind, ("jpeg", fields[1][:200])), (kind, ("jpeg", fields[1][:0]))]
    assert black(read_recording(write_images(tmp_path / "packed.mcap", packed), LAYOUT)) == [1, 2]


def test_a_message_cut_anywhere_keeps_its_row(tmp_path: Path) -> None:
    small = np.full((2, 2, 3), 200, dtype=np.uint8)
    whole = write_images(tmp_path / "whole.mcap", [raw(small, "bgr8")])
    kind, time = "sensor_msgs/msg/Image", ROS2.types["builtin_interfaces/msg/Time"]
    header = ROS2.types["std_msgs/msg/Header"](time(1, 5), "camera")
    content = bytes(ROS2.serialize_cdr(ROS2.types[kind](header, *raw(small, "bgr8")[1]), kind))
    raws = [content, *(content[:kept] for kept in range(len(content)))]
    write_messages(tmp_path / "cut.mcap", raws, kind, "/camera", list(range(len(raws))))
    recording = read_recording(tmp_path / "cut.mcap", LAYOUT)
    assert black(recording) == list(range(1, len(raws)))
    known = recording.time[np.isfinite(recording.time)]
    np.testing.assert_allclose(known, 1.000000005, atol=1e-12)
    assert 1 < len(known) < len(raws)
    assert image_size(whole) == (2, 2, 3)


@pytest.mark.parametrize("chunked", [True, False])
def test_images_of_megabytes_are_read(tmp_path: Path, chunked: bool) -> None:
    large = np.full((1000, 1500, 3), 90, dtype=np.uint8)
    recording = read_recording(write_images(tmp_path / "log.mcap", [raw(large, "bgr8")], chunked=chunked), LAYOUT)
    assert np.array_equal(images(recording), large[None])


def test_what_foxglove_writes_through_ros_is_read(tmp_path: Path) -> None:
    """timestamp, frame_id, data, format: each string and list behind its length, in multiples of four bytes."""
    packed = bytes(cv2.imencode(".png", frame(5))[1])
    head = b"\0\1\0\0" + (3).to_bytes(4, "little") + (500_000_000).to_bytes(4, "little") + b"\4\0\0\0cam\0"
    content = head + len(packed).to_bytes(4, "little") + packed + bytes(-len(packed) % 4) + b"\4\0\0\0png\0"
    write_messages(tmp_path / "log.mcap", [content], "foxglove_msgs/msg/CompressedImage", "/camera", [7])
    recording = read_recording(tmp_path / "log.mcap", LAYOUT)
    assert np.array_equal(images(recording), frame(5)[None])
    assert recording.time.tolist() == [3.5]


def test_a_topic_of_something_else_is_refused(tmp_path: Path) -> None:
    path = write_images(tmp_path / "log.mcap", [raw(frame(0), "bgr8")], topic="/left")
    there = contents(path)
    assert missing(there, LogLayout(wrench=None, images=ImageChannel("/left"))) == []
    assert "there is no topic '/right'" in missing(there, LogLayout(wrench=None, images=ImageChannel("/right")))[0]
    assert "no topic holds wrenches" in missing(there, LogLayout())[0]
    with pytest.raises(InputError, match=r"mcap: .*only images; requested is a wrench"):
        read_recording(path, LogLayout(images=ImageChannel()))


def test_other_logs_hold_no_images_and_images_nothing_else(tmp_path: Path) -> None:
    table = tmp_path / "log.csv"
    table.write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n")
    assert missing(contents(table), LAYOUT) == ["holds no images."]
    assert image_size(table) is None
    with pytest.raises(InputError, match=r"holds no images.*Name"):
        read_recording(table, LAYOUT)
    for path in (write_video(tmp_path / "log.avi", 3), write_frames(tmp_path / "frames", ["0.png"])):
        assert missing(contents(path), LAYOUT) == []
        assert "requested is a wrench" in missing(contents(path), LogLayout())[0]
        with pytest.raises(InputError, match=r": .*which holds only images"):
            read_recording(path)


def test_images_stay_what_they_are() -> None:
    values = np.stack([frame(k) for k in range(6)])
    recording = Recording(np.arange(6.0), {IMAGE: values, CELLS: values[:, 0, :, 0]})
    assert recording.channels[CELLS].dtype == np.float64
    for other in (
        recording,
        pickle.loads(pickle.dumps(recording)),
        join([recording.picked(slice(3)), recording.picked(slice(3, 6))]),
    ):
        assert np.array_equal(images(other), values)
    assert np.array_equal(images(recording.picked(np.arange(6) % 2 == 0)), values[::2])


@pytest.mark.parametrize(
    "values", [np.zeros((2, 4, 4, 3)), np.zeros((2, 4, 4), np.uint8), np.zeros((3, 4, 4, 3), np.uint8)]
)
def test_images_of_another_shape_or_type_are_refused(values: np.ndarray) -> None:
    with pytest.raises(InputError, match="channel 'image' has the shape"):
        Recording(np.arange(2.0), {IMAGE: values})


def _layout(_: object) -> LogLayout:
    return LAYOUT


def _no_estimator(*_: object) -> BuiltEstimator:
    raise NotImplementedError


def test_the_start_of_a_log_of_images_is_some_frames(tmp_path: Path) -> None:
    path = write_video(tmp_path / "log.avi", 200)
    kind = SensorKind("camera", "a camera", type(None), (IMAGE,), _layout, _no_estimator)
    with OpenedLog(path, Setup(kind, {}, Link(None, tmp_path))) as log:
        for seconds in (0.0, 5.0):
            assert 30 <= len(log.head(seconds)) < 100
        assert numbers(images(join(list(log)))) == list(range(200))


def test_what_no_doubt_is_raised_from_is_not_kept() -> None:
    block, seen = Recording(np.arange(2.0), {IMAGE: np.zeros((2, 4, 4, 3), np.uint8)}), SeenSamples()
    held = weakref.ref(block)
    seen.add(block, Contacts.single(block.time, ContactEstimate.from_rows(np.zeros((2, 22)))), np.inf, keep=False)
    del block
    assert held() is None
