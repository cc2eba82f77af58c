"""Files of contacts in all formats: same numbers to the last bit, whole at the end, readable before; and truth.csv."""

import subprocess
import sys
import time as clock
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from palpate.contact import ContactEstimate, Contacts, Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.origins import Origins
from palpate.contact.table import COLUMNS
from palpate.errors import InputError
from palpate.files.atomic import part, replacing
from palpate.files.contacts import open_contacts, read_contacts, unfinished, write_contacts
from palpate.files.contacts.writing import _Appended
from palpate.files.ground_truth import read_ground_truth, read_touches

SUFFIXES = (".csv", ".parquet", ".mcap")
FIELDS = ("point", "normal", "force", "torque", "covariance", "candidates", "status")


def _contacts(count: int, seed: int = 1, powers: int = 5) -> Contacts:
    """Every status; a point where there is one, some without a covariance; times with gaps, steps back and NaN."""
    rng = np.random.default_rng(seed)
    status = rng.integers(0, len(Status), count).astype(np.int8)
    numbers = rng.normal(size=(count, 10)) * 10.0 ** rng.integers(-powers, powers, size=(count, 10))
    numbers[:, 3:6] = Rotation.random(count, rng=rng).apply([0.0, 0.0, 1.0])
    numbers[status >= Status.SATURATED] = np.nan
    numbers[np.isin(status, (Status.NO_CONTACT, Status.TOO_LIGHT))] *= [*[np.nan] * 6, 1, 1, 1, np.nan]
    root = rng.normal(size=(count, 3, 2))
    covariance = root @ np.swapaxes(root, 1, 2)
    covariance = (covariance + np.swapaxes(covariance, 1, 2)) / 2
    covariance[(status > Status.AMBIGUOUS) | (rng.random(count) < 0.1)] = np.nan
    time = 1.7e9 + np.cumsum(rng.normal(1e-3, 1e-3, count))
    time[rng.random(count) < 0.02] = np.nan
    estimate = ContactEstimate(
        numbers[:, 0:3].copy(),
        numbers[:, 3:6].copy(),
        numbers[:, 6:9].copy(),
        numbers[:, 9].copy(),
        covariance,
        np.full(count, np.nan),
        rng.integers(0, 5, count),
        status,
    )
    return Contacts(np.arange(count) // 2, time, np.arange(count) % 2, estimate)


def _write(path: Path, contacts: Contacts, block: int, **options: str) -> None:
    with open_contacts(path, **options) as writer:
        for start in range(0, len(contacts), block):
            rows = contacts[start : start + block]
            writer.write(rows)


def _assert_same(found: Contacts, known: Contacts) -> None:
    for name in ("sample", "time", "identity"):
        assert np.array_equal(getattr(found, name), getattr(known, name), equal_nan=True), name
    for name in FIELDS:
        assert np.array_equal(getattr(found.estimate, name), getattr(known.estimate, name), equal_nan=True), name


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("block", [1, 17, 4096])
def test_what_is_written_in_blocks_reads_back_to_the_last_bit(tmp_path: Path, suffix: str, block: int) -> None:
    known = _contacts({1: 40, 17: 1000, 4096: 10_000}[block], powers=300)  # the last: more than a chunk of MCAP
    path = tmp_path / f"contacts{suffix}"
    _write(path, known, block)
    found = read_contacts(path)
    _assert_same(found, known)
    assert found.notes == ()
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_contacts_of_a_robot_keep_their_sensors_and_their_order(tmp_path: Path, suffix: str) -> None:
    """That of time, the sensors in turn; in a file of messages each has a topic, and names of any length."""
    origins = Origins.of_names(["tip", "palm", "wrist"] * 100, ["l_3", "hand", "forearm"] * 100)
    known = replace(_contacts(300), time=0.01 * np.arange(300), origins=origins)
    write_contacts(tmp_path / f"contacts{suffix}", known)
    found = read_contacts(tmp_path / f"contacts{suffix}")
    _assert_same(found, known)
    assert (list(found.sensor), list(found.link)) == (list(known.sensor), list(known.link))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_output_is_untouched_until_the_end_and_part_is_readable_before(tmp_path: Path, suffix: str) -> None:
    path, known = tmp_path / f"contacts{suffix}", _contacts(300)
    path.write_text("old")
    with open_contacts(path) as writer:
        for end in (100, 200, 300):
            rows = known[end - 100 : end]
            writer.write(rows)
            _assert_same(read_contacts(part(path)), known[:end])
            assert path.read_text() == "old"
    _assert_same(read_contacts(path), known)
    assert not part(path).exists()


def test_a_row_that_was_edited_far_down_changes_nothing_else(tmp_path: Path) -> None:
    path, known = tmp_path / "contacts.csv", _contacts(60_000)  # more than a piece
    _write(path, known, 60_000)
    head, _, last = path.read_text().rstrip("\n").rpartition("\n")
    path.write_text(f"{head}\n {last}\n\n")
    _assert_same(read_contacts(path), known)


def _raise_after(path: Path, contacts: Contacts, problem: BaseException) -> None:
    with open_contacts(path) as writer:
        if len(contacts):
            writer.write(contacts)
        raise problem


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_interrupt_leaves_a_whole_file_of_what_was_done(tmp_path: Path, suffix: str) -> None:
    path, known = tmp_path / f"contacts{suffix}", _contacts(50)
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        _raise_after(path, known[:0], KeyboardInterrupt())
    assert path.read_text() == "old"  # nothing was done yet
    with pytest.raises(KeyboardInterrupt):
        _raise_after(path, known, KeyboardInterrupt())
    _assert_same(read_contacts(path), known)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_another_error_leaves_part_if_it_holds_a_row(tmp_path: Path, suffix: str) -> None:
    path, known = tmp_path / f"contacts{suffix}", _contacts(50)
    with pytest.raises(ZeroDivisionError):
        _raise_after(path, known[:0], ZeroDivisionError())
    assert not list(tmp_path.iterdir())
    with pytest.raises(ZeroDivisionError):
        _raise_after(path, known, ZeroDivisionError())
    assert unfinished(path) == part(path)
    _assert_same(read_contacts(part(path)), known)
    _write(path, known[:10], 10)  # the next run starts anew
    assert unfinished(path) is None
    _assert_same(read_contacts(path), known[:10])


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_an_interrupt_within_a_block_leaves_the_blocks_before(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, known, whole = tmp_path / f"contacts{suffix}", _contacts(300), _Appended.write

    def torn(file: _Appended, raw: bytes) -> None:
        if file.size > torn_beyond:
            monkeypatch.setattr(_Appended, "write", whole)
            file._file.write(raw[: len(raw) // 2])
            raise KeyboardInterrupt
        whole(file, raw)

    torn_beyond = 20_000
    monkeypatch.setattr(_Appended, "write", torn)
    with pytest.raises(KeyboardInterrupt):
        _write(path, known, 10)
    found = read_contacts(path)
    assert 0 < len(found) < 300
    assert found.notes == ()
    _assert_same(found, known[: len(found)])


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_part_cut_anywhere_gives_every_whole_block_before_the_cut(tmp_path: Path, suffix: str) -> None:
    path, known, block = tmp_path / f"contacts{suffix}", _contacts(100), 10
    ends = []
    with open_contacts(path) as writer:
        for start in range(0, 100, block):
            rows = known[start : start + block]
            writer.write(rows)
            ends.append(part(path).stat().st_size)
        raw = part(path).read_bytes()
    cuts = np.random.default_rng(2).integers(ends[0], ends[-1], 60)
    for cut in [*ends, *cuts]:
        part(path).write_bytes(raw[:cut])
        found = read_contacts(part(path))
        least = block * int(np.searchsorted(ends, cut, side="right"))
        assert least <= len(found) < least + block + 1
        _assert_same(found, known[: len(found)])
        assert bool(found.notes) == (cut not in ends or suffix == ".mcap")  # only MCAP says that it is at its end


WRITER = """
import sys
from contextlib import ExitStack
from pathlib import Path
import numpy as np
from palpate.contact import ContactEstimate, Contacts
from palpate.files.contacts import open_contacts
n = 200
three, one = np.arange(3.0 * n).reshape(n, 3) / 7, np.arange(n) / 7
with ExitStack() as stack:
    writers = [stack.enter_context(open_contacts(Path(name))) for name in sys.argv[1:]]
    for k in range(2000):  # many more than before the kill
        for writer in writers:
            estimate = ContactEstimate(three, three, three, one, np.full((n, 3, 3), np.nan), one, np.full(n, k),
                                       np.zeros(n, dtype=np.int8))
            writer.write(Contacts.single(one, estimate, k * n))
        if k == 3:
            print("go", flush=True)
    sys.stdin.read()
"""


def test_kill_leaves_what_was_written(tmp_path: Path) -> None:
    for run, pause in enumerate(np.random.default_rng(3).uniform(0, 0.2, 2)):
        paths = [tmp_path / f"{run}{suffix}" for suffix in SUFFIXES]
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, *map(str, paths)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as process:
            assert process.stdout is not None
            started = process.stdout.readline()
            clock.sleep(pause)
            process.kill()
        assert started == b"go\n"
        whole = []
        for path in paths:
            assert not path.exists()
            assert unfinished(path) == part(path)
            found = read_contacts(part(path))
            assert np.array_equal(found.sample, np.arange(len(found)))
            assert np.array_equal(found.estimate.candidates, np.arange(len(found)) // 200)
            assert np.array_equal(found.time, (np.arange(len(found)) % 200) / 7)
            whole.append(len(found) // 200)
        assert min(whole) >= 4
        assert max(whole) - min(whole) <= 1  # nothing was lost that had been written before; of a torn block some rows


def test_parquet_has_the_columns_of_csv_with_types_and_null_where_there_is_nothing(tmp_path: Path) -> None:
    known = _contacts(500)
    _write(tmp_path / "contacts.parquet", known, 100)
    frame = pl.read_parquet(tmp_path / "contacts.parquet")
    assert tuple(frame.columns) == COLUMNS
    whole = ("sample", "contact", "candidates")
    assert frame.schema == {
        name: pl.Int64 if name in whole else pl.String if name == "status" else pl.Float64 for name in COLUMNS
    }
    assert frame["px"].is_null().to_list() == np.isnan(known.estimate.point[:, 0]).tolist()
    assert not frame["px"].is_nan().any()
    assert frame["status"].to_list() == [Status(code).label for code in known.estimate.status]


def _mcap(tmp_path: Path) -> tuple[Path, Contacts]:
    path, known = tmp_path / "contacts.mcap", _contacts(700)
    _write(path, known, 300, frame_id="probe")
    return path, known


def test_mcap_is_whole_and_indexed_for_the_reference_reader(tmp_path: Path) -> None:
    from mcap.reader import NonSeekingReader, make_reader

    path, known = _mcap(tmp_path)
    placed = int(np.isfinite(known.estimate.point[:, 0]).sum())
    counts = {"/palpate/contact/estimate": 700, "/palpate/contact/point": placed, "/palpate/contact/wrench": placed}
    with path.open("rb") as file:
        seeking = make_reader(file, validate_crcs=True)
        assert seeking.get_header().profile == "ros2"
        summary = seeking.get_summary()
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count == 3
        names = {key: channel.topic for key, channel in summary.channels.items()}
        assert {names[k]: n for k, n in summary.statistics.channel_message_counts.items()} == counts
        by_index = [(c.topic, m.sequence, m.log_time, m.data) for _, c, m in seeking.iter_messages()]
        middle = by_index[len(by_index) // 2][2]
        later = [m.log_time for _, _, m in seeking.iter_messages(starting_at=middle)]
        assert sorted(later) == sorted(entry[2] for entry in by_index if entry[2] >= middle)
    with path.open("rb") as file:
        streamed = NonSeekingReader(file, validate_crcs=True).iter_messages()
        in_order = [(c.topic, m.sequence, m.log_time, m.data) for _, c, m in streamed]
    assert sorted(by_index) == sorted(in_order)
    times = [entry[2] for entry in in_order]
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (min(times), max(times))
    for topic, count in counts.items():
        assert sorted(entry[1] for entry in in_order if entry[0] == topic) == list(range(count))


def test_mcap_means_to_ros_what_was_estimated(tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    path, known = _mcap(tmp_path)
    estimate = known.estimate
    decoded: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            decoded.setdefault(connection.msgtype, []).append(message)
            assert message.header.frame_id == "probe"
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    everything = sorted(decoded["palpate_msgs/msg/Contact"], key=lambda message: (message.sample, message.contact))
    assert [message.status for message in everything] == estimate.status.tolist()
    assert everything[0].IMPLAUSIBLE == Status.IMPLAUSIBLE
    for name, column in (("sample", known.sample), ("contact", known.identity), ("time", known.time)):
        values = np.array([getattr(message, name) for message in everything])
        assert np.array_equal(values, column, equal_nan=True)
    for name in ("point", "normal", "force"):
        values = np.array(
            [[getattr(message, name).x, getattr(message, name).y, getattr(message, name).z] for message in everything]
        )
        assert np.array_equal(values, getattr(estimate, name), equal_nan=True)
    covariance = np.array([message.covariance for message in everything]).reshape(-1, 3, 3)
    assert np.array_equal(covariance, estimate.covariance, equal_nan=True)
    torques = np.array([message.torque for message in everything])
    assert np.array_equal(torques, estimate.torque, equal_nan=True)
    for message in everything:
        if np.isfinite(message.time):  # a double of 1.7e9 s is known to 0.24 us
            assert message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec == pytest.approx(
                message.time, abs=5e-7
            )
    placed = np.isfinite(estimate.point[:, 0])
    poses = [message.pose for message in decoded["geometry_msgs/msg/PoseStamped"]]
    points = np.array([[pose.position.x, pose.position.y, pose.position.z] for pose in poses])
    rotations = Rotation.from_quat(
        [[pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w] for pose in poses]
    )
    wrenches = [message.wrench for message in decoded["geometry_msgs/msg/WrenchStamped"]]
    forces = np.array([[wrench.force.x, wrench.force.y, wrench.force.z] for wrench in wrenches])
    torques = np.array([[wrench.torque.x, wrench.torque.y, wrench.torque.z] for wrench in wrenches])
    order = np.argsort(points[:, 0])  # readers sort by time, and times repeat
    known_order = np.flatnonzero(placed)[np.argsort(estimate.point[placed, 0])]
    assert np.array_equal(points[order], estimate.point[known_order])
    # the rotation of a unit vector in double precision
    np.testing.assert_allclose(rotations.apply([0, 0, 1])[order], estimate.normal[known_order], atol=1e-14)
    order = np.argsort(forces[:, 0])
    known_order = np.flatnonzero(placed)[np.argsort(estimate.force[placed, 0])]
    assert np.array_equal(forces[order], estimate.force[known_order])
    about = estimate.torque[known_order, None] * estimate.normal[known_order]
    assert np.array_equal(torques[order], about)


def test_definitions_are_those_of_ros(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    path, _ = _mcap(tmp_path)
    store = get_typestore(Stores.ROS2_JAZZY)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    standard = [schema for schema in summary.schemas.values() if schema.name.startswith("geometry_msgs")]
    assert len(standard) == 2
    for schema in standard:
        assert schema.encoding == "ros2msg"
        definition, _ = store.generate_msgdef(schema.name, ros_version=2)
        assert schema.data.decode().split() == definition.split()


@pytest.mark.parametrize("time", [[-5.0, -1.0], [np.nan, np.nan], [1e300, np.inf], [0.9999999999, 2.0**31]])
def test_times_that_ros_cannot_say_are_kept_in_our_message(tmp_path: Path, time: list[float]) -> None:
    from mcap.reader import make_reader

    known = _contacts(2)
    path = tmp_path / "contacts.mcap"
    write_contacts(path, Contacts.single(np.array(time), known.estimate))
    assert np.array_equal(read_contacts(path).time, time, equal_nan=True)
    with path.open("rb") as file:
        stamps = [message.log_time for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
    assert all(0 <= stamp < 2**31 * 10**9 for stamp in stamps)


def test_a_normal_that_points_straight_down_has_a_rotation(tmp_path: Path) -> None:
    from palpate.files.contacts.mcap import _z_to

    normals = np.array([[0, 0, -1.0], [0, 0, 1.0], [1e-9, 0, -1.0], [0, 1e-7, -1.0], [1.0, 0, 0]])
    found = Rotation.from_quat(_z_to(normals)).apply([0, 0, 1])
    np.testing.assert_allclose(found, normals, atol=2e-9)  # nearer to straight down it is taken as straight


def test_other_suffixes_and_folders_in_the_way_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'.txt'.*\.csv, \.parquet, \.mcap"), open_contacts(tmp_path / "contacts.txt"):
        pass
    (tmp_path / "contacts.csv.part").mkdir()
    (tmp_path / "contacts.csv.part" / "mine.txt").write_text("")
    with (
        pytest.raises(InputError, match=r"is a folder with a file that Palpate did not write, 'mine.txt'.*Remove"),
        open_contacts(tmp_path / "contacts.csv"),
    ):
        pass
    assert (tmp_path / "contacts.csv.part" / "mine.txt").exists()


def test_files_that_are_no_contacts_are_said(tmp_path: Path) -> None:
    pl.DataFrame({"time": [1.0]}).write_parquet(tmp_path / "a.parquet")
    (tmp_path / "b.parquet").write_bytes(b"PAR1 and no more")
    (tmp_path / "c.mcap").write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "d").mkdir()
    for name, word in (("a.parquet", "no column 'sample'"), ("b.parquet", "not a file of contacts"), ("d", "folder")):
        with pytest.raises(InputError, match=word):
            read_contacts(tmp_path / name)
    with pytest.raises(InputError, match=r"palpate_msgs/msg/Contact.*palpate"):
        read_contacts(tmp_path / "c.mcap")
    known = _contacts(5)
    frame = pl.DataFrame({"time": [1.0]})
    write_contacts(tmp_path / "e.parquet", known)
    frame = pl.read_parquet(tmp_path / "e.parquet").with_columns(status=pl.lit("contct"))
    frame.write_parquet(tmp_path / "e.parquet")
    with pytest.raises(InputError, match=r"parquet: .*unknown status 'contct'"):
        read_contacts(tmp_path / "e.parquet")


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_file_that_has_no_row_yet_is_one_without_rows(tmp_path: Path, suffix: str) -> None:
    """A writer that is killed before its first block leaves one."""
    path = tmp_path / f"contacts{suffix}"
    with open_contacts(path):
        assert len(read_contacts(part(path))) == 0


HEADER = (
    "sample,time,contact,status,px,py,pz,nx,ny,nz,fx,fy,fz,torque,var_xx,var_xy,var_xz,var_yy,var_yz,var_zz,candidates"
)


def test_the_header_is_the_one_that_was_agreed() -> None:
    assert ",".join(COLUMNS) == HEADER


def test_where_there_is_none_the_field_is_empty_and_status_is_lower_case(tmp_path: Path) -> None:
    nothing = np.full((1, 3), np.nan)
    estimate = ContactEstimate(
        nothing.copy(),
        nothing.copy(),
        nothing.copy(),
        np.full(1, np.nan),
        np.full((1, 3, 3), np.nan),
        np.zeros(1),
        np.zeros(1, dtype=np.int64),
        np.array([Status.NO_POSE], dtype=np.int8),
    )
    write_contacts(tmp_path / "contacts.csv", Contacts.single(np.array([0.5]), estimate))
    lines = (tmp_path / "contacts.csv").read_text().splitlines()
    assert lines == [HEADER, "0,0.5,0,no_pose" + "," * 17 + "0"]


def _write_half(path: Path) -> None:
    with replacing(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        _write_half(path)
    assert [file.name for file in tmp_path.iterdir()] == ["contacts.csv"]
    assert path.read_text() == "old"


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"csv: cannot write here"), replacing(tmp_path / "no" / "contacts.csv"):
        pass


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("a,b\n1,2", "not a contacts.csv.*palpate"),
        (f"{HEADER}\n0,0,0,contct{',1' * 16},1", "unknown status 'contct'.*'contact'"),
        (f"{HEADER}\n,0,0,contact{',1' * 16},1", ": .*whole numbers"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / "other.csv").write_text(text)
    with pytest.raises(InputError, match=word):
        read_contacts(tmp_path / "other.csv")


def test_truth_at_instants_with_and_without_what_is_optional(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("time,px,py,pz\n0,1,2,3\n")
    truth = read_ground_truth(path)
    assert isinstance(truth, TrueSamples)
    assert truth.normal is None
    assert truth.force is None
    path.write_text("time,px,py,pz,nx,ny,nz,fx,fy,fz\n0,1,2,3,0,0,1,4,5,6\n")
    truth = read_ground_truth(path)
    assert isinstance(truth, TrueSamples)
    assert truth.point.tolist() == [[1, 2, 3]]
    assert truth.normal.tolist() == [[0, 0, 1]]
    assert truth.force.tolist() == [[4, 5, 6]]


def test_truth_touch_by_touch(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("start,end,px,py,pz,fx,fy,fz,label\n0,1,1,2,3,0,0,-4,tip\n2,3,4,5,6,0,1,-5,\n")
    truth = read_ground_truth(path)
    assert isinstance(truth, TrueTouches)
    assert truth.force.tolist() == [[0, 0, -4], [0, 1, -5]]
    assert truth.label == ("tip", "2")
    assert truth.end.tolist() == [1, 3]


def test_touches_ask_for_touches(tmp_path: Path) -> None:
    (tmp_path / "marks.csv").write_text("time,px,py,pz\n0,1,2,3")
    with pytest.raises(InputError, match=r"no column 'start'.*Available"):
        read_touches(tmp_path / "marks.csv")


@pytest.mark.parametrize(
    ("row", "word"),
    [
        (f"0,0,0,contact,,2,3{',1' * 14}", "line 2: has a status that needs a point, but has no point"),
        (f"0,0,0,ambiguous,inf,2,3{',1' * 14}", "line 2: has a status that needs a point, but has no point"),
        (f"0.5,0,0,contact{',1' * 17}", "line 2: sample, contact and candidates must be whole"),
        (f"inf,0,0,contact{',1' * 17}", "line 2: sample, contact and candidates must be whole"),
        (f"0,0,0,contact,1,2,3,one{',1' * 13}", "line 2: 'one' in column 'nx' is not a number"),
        (f"0,soon,0,no_contact{',' * 17}0", "line 2: 'soon' in column 'time'"),
        ("0,0,0,no_contact", "line 2: does not have 21 fields"),
    ],
)
def test_a_row_of_contacts_that_was_spoilt_is_named(tmp_path: Path, row: str, word: str) -> None:
    (tmp_path / "contacts.csv").write_text(f"{HEADER}\n{row}\n1,1,0,no_contact{',' * 17}0\n2,2,0,contact{',1' * 17}\n")
    with pytest.raises(InputError, match=word):
        read_contacts(tmp_path / "contacts.csv")


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("t,px,py,pz\n0,1,2,3", "a column 'time'.*Available"),
        ("time,px,py\n0,1,2", "no column 'pz'.*Available"),
        ("start,end,px,py,pz\n3,2,1,1,1", "line 2: a touch must start before it ends"),
        ("time,px,py,pz\n0,1,2,3\n1,nan,2,3", "line 3: an instant needs a point"),
        ("time,px,py,pz\n0,1,2,3\n1,x,2,3", "line 3: 'x' in column 'px'"),
        ("time,px,py,pz\n0,x,2,3\n1,x,2,3", "csv: column 'px' has no numbers"),
        ("time,px,py,pz\n0,1,2,3\n,1,2,3", "line 3: an instant needs a time"),
        ("time,px,py,pz,fx,fy,fz\n0,1,2,3,,,\n1,1,2,3,a,0,0\n2,1,2,3,1,0,0", "line 3: 'a' in column 'fx'"),
        ("start,end,px,py,pz\n0,1,1,2,3\n2,3,1,nan,3", "line 3: a touch needs a point"),
        ("start,end,px,py,pz\n0,1,1,2,3\n2,3,1", "line 3: does not have 5 fields"),
    ],
)
def test_a_row_of_truth_that_was_spoilt_is_named(tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(InputError, match=word):
        read_ground_truth(tmp_path / "truth.csv")
