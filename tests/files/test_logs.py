"""A CSV log becomes a recording: rows in = rows out, what cannot be read is NaN and said, what is missing is named."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import join, open_log, read_recording
from palpate.files.logs.layout import LogLayout, axis_matrix
from palpate.files.tables.table import read_table
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE

HEADER = "time,fx,fy,fz,tx,ty,tz"
ROWS = ["0.00,1,2,3,0.1,0.2,0.3", "0.01,4,5,6,0.4,0.5,0.6", "0.02,7,8,9,0.7,0.8,0.9"]


def _log(tmp_path: Path, *lines: str, end: str = "\n") -> Path:
    path = tmp_path / "log.csv"
    path.write_bytes(end.join(lines).encode())
    return path


def test_the_plain_log_needs_no_mapping(tmp_path: Path) -> None:
    recording = read_recording(_log(tmp_path, HEADER, *ROWS))
    assert recording.notes == ()
    assert recording.time.tolist() == [0.0, 0.01, 0.02]
    assert recording.channels[FORCE].tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert recording.channels[TORQUE].tolist() == [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_separators_line_ends_and_marks_do_not_matter(tmp_path: Path, end: str, separator: str, mark: str) -> None:
    lines = [line.replace(",", separator) for line in [mark + HEADER, *ROWS, ""]]
    wrenches = read_recording(_log(tmp_path, *lines, end=end)).wrenches()
    assert np.array_equal(wrenches, read_recording(_log(tmp_path, HEADER, *ROWS)).wrenches())


def test_order_of_columns_does_not_matter_and_others_are_ignored(tmp_path: Path) -> None:
    recording = read_recording(_log(tmp_path, "tz,ty,tx,note,fz,fy,fx,time", "6,5,4,hello,3,2,1,0"))
    assert recording.wrenches().tolist() == [[1, 2, 3, 4, 5, 6]]


def test_rows_in_are_rows_out_and_bad_fields_are_named(tmp_path: Path) -> None:
    bad = [
        "0.03,oops,2,3,0,0,0",
        "0.04,1,,3,0,0,0",
        "0.05,nan,2,3,0,0,0",
        "0.06,inf,2,3,0,0,0",
        "0.07,1,2",
        "x,1,2,3,0,0,0",
    ]
    recording = read_recording(_log(tmp_path, HEADER, *ROWS, *bad, "0.08,1,2,3,0,0,0,5"))
    assert len(recording) == 10
    assert np.flatnonzero(np.isnan(recording.channels[FORCE]).any(axis=1)).tolist() == [3, 4, 5, 7, 9]
    assert np.isinf(recording.channels[FORCE][6, 0])
    assert np.isnan(recording.time[8])
    said = " ".join(recording.notes)
    assert "line 5, column 'fx', 'oops'" in said
    assert "2 rows do not have 7 fields (first: line 9)" in said
    assert "infinite" in said


def test_blank_lines_are_not_rows_and_lines_keep_their_number(tmp_path: Path) -> None:
    recording = read_recording(_log(tmp_path, HEADER, ROWS[0], "", "   ", "0.01,oops,5,6,0,0,0", "", ""))
    assert len(recording) == 2
    assert "line 5" in recording.notes[0]


@pytest.mark.parametrize("unit", ["Nm", "N m", "N*m", "N.m", "N·m"])
def test_a_unit_may_be_spelt_as_people_spell_it(tmp_path: Path, unit: str) -> None:
    assert read_recording(_log(tmp_path, HEADER, *ROWS), LogLayout(torque_unit=unit)).wrenches()[0, 5] == 0.3


def test_swapped_axes_apply_to_force_and_torque_alike(tmp_path: Path) -> None:
    layout = LogLayout(axes=("x", "z", "-y"), left_handed=False)
    assert read_recording(_log(tmp_path, HEADER, "0,1,2,3,4,5,6"), layout).wrenches().tolist() == [[1, 3, -2, 4, 6, -5]]
    layout = LogLayout(axes=("x", "z", "y"), left_handed=True)
    assert read_recording(_log(tmp_path, HEADER, "0,1,2,3,4,5,6"), layout).wrenches().tolist() == [[1, 3, 2, 4, 6, 5]]


@pytest.mark.parametrize(
    ("axes", "left_handed", "word"),
    [
        (("x", "z", "y"), False, "left-handed"),
        (("-x", "-y", "-z"), False, "left-handed"),
        (("x", "y", "z"), True, "right-handed.*Remove"),
        (("x", "x", "z"), False, "axes: .*three different axes"),
        (("x", "q", "z"), False, "'q' is not an axis.*Write"),
    ],
)
def test_axes_that_cannot_be_meant_are_refused(axes: tuple[str, ...], left_handed: bool, word: str) -> None:
    with pytest.raises(InputError, match=word):
        axis_matrix(axes, left_handed=left_handed, where="axes")


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "log.csv: the file is empty"),
        (HEADER, "log.csv: there is a header, but no rows"),
        ("0,1,2,3,4,5,6\n1,1,2,3,4,5,6", "no column 'time'.*Available: 'column_1'"),
        ("1\n2\n3", "only one column. Separate"),
        ("time\n1\n2", "no column 'fx'.*Available"),
        ("time,Fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6", "'fx'.*Did you mean 'Fx'"),
        (f"{HEADER},fx\n0,1,2,3,4,5,6,7", "'fx' occurs 2 times.*Give"),
        (f"{HEADER}\n0,a,2,3,4,5,6\n1,b,2,3,4,5,6", "csv: column 'fx' has no numbers; line 2 has 'a'"),
        (f"{HEADER}\n0,5,1,5,2,5,3,5,4,5,5,5,6,5\n", "no row has the 7 fields.*decimal point"),
        ("\0\0\0\0", "not a text file.*Name"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_name(tmp_path: Path, content: str, word: str) -> None:
    path = _log(tmp_path, content)
    with pytest.raises(InputError, match=word) as refused:
        read_recording(path)
    assert str(path) in str(refused.value)


def test_a_missing_file_offers_its_neighbour(tmp_path: Path) -> None:
    _log(tmp_path, HEADER, *ROWS)
    with pytest.raises(InputError, match=r"the file does not exist.*'log\.csv'"):
        read_recording(tmp_path / "logs.csv")


@pytest.mark.parametrize(
    ("times", "word"),
    [
        ((0, 1, 2, 1.5, 3, 4), "run backwards in 1 places"),
        ((0, 1, 1, 2, 3, 4), "1 times repeat"),
        ((0, 1, 2, 8, 9, 10), "1 gaps longer than 5 steps"),
        ((0, 1, "", 3, 4, 5), "1 of 6 times are missing"),
    ],
)
def test_odd_times_are_kept_and_said(tmp_path: Path, times: tuple[object, ...], word: str) -> None:
    recording = read_recording(_log(tmp_path, HEADER, *(f"{time},1,2,3,4,5,6" for time in times)))
    assert len(recording) == 6
    assert word in " ".join(recording.notes)


def test_quaternions_far_from_unit_are_set_aside_and_said(tmp_path: Path) -> None:
    rows = [f"{k},1,2,3,4,5,6,{q}" for k, q in enumerate(["0,0,0,1", "0,0,0,0", "0,0,0,1.1", "0,0,0,"])]
    recording = read_recording(_log(tmp_path, f"{HEADER},qx,qy,qz,qw", *rows))
    assert np.isnan(recording.channels[ORIENTATION]).any(axis=1).tolist() == [False, True, False, True]
    said = " ".join(recording.notes)
    assert "1 quaternions have a length far from 1" in said
    assert "1 quaternions are not unit" in said


def test_a_declared_orientation_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no column 'a'.*Available"):
        read_recording(_log(tmp_path, HEADER, *ROWS), LogLayout(orientation=("a", "b", "c", "d")))


def test_a_row_is_a_line_whatever_its_quotes_say(tmp_path: Path) -> None:
    rows = ['0,0,0,-5,0,0,0,"a', "1,0,0,-6,0,0,0,", '2,0,0,-5,0,0,0,b"', '3,0,0,-7,0,0,0,"c, d"', "4,1,2"]
    recording = read_recording(_log(tmp_path, f"{HEADER},note", *rows))
    assert len(recording) == 5
    assert np.isnan(recording.wrenches()[:, 2]).tolist() == [True, False, True, False, True]
    assert recording.wrenches()[[1, 3], 2].tolist() == [-6, -7]
    said = " ".join(recording.notes)
    assert "2 rows have a quote that is not closed (first: line 2)" in said
    assert "1 rows do not have 8 fields (first: line 6)" in said


def test_a_quote_elsewhere_does_not_let_a_row_shift(tmp_path: Path) -> None:
    header = '"time",label,fx,fy,fz,tx,ty,tz'
    recording = read_recording(_log(tmp_path, header, '0,"a, b",1,2,3,4,5,6', "", '1,"a",9,1,2,3,4,5,6'))
    assert recording.wrenches()[0].tolist() == [1, 2, 3, 4, 5, 6]
    assert np.isnan(recording.wrenches()[1]).all()
    assert "first: line 4" in recording.notes[0]
    with pytest.raises(InputError, match=r"no row has the 7 fields of the header; line 2 has 14.*decimal"):
        read_recording(_log(tmp_path, HEADER.replace("time", '"time"'), "0,5,1,5,2,5,3,5,4,5,5,5,6,5"))


def test_quoted_names_and_texts_keep_what_the_quotes_protect(tmp_path: Path) -> None:
    table = read_table(_log(tmp_path, '"a, N";b', '"tip; ""left""";1'))
    assert table.names == ("a, N", "b")
    assert table.strings("a, N").to_list() == ['tip; "left"']


def test_blank_lines_before_the_header_count(tmp_path: Path) -> None:
    recording = read_recording(_log(tmp_path, "", " ", HEADER, ROWS[0], "0.01,oops,5,6,0,0,0"))
    assert "line 5, column 'fx'" in recording.notes[0]


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (f"{HEADER}\n\t\n", "a header, but no rows"),
        (f'"{HEADER}\n0,1,2,3,4,5,6', "line 1: a quote is not closed in the header"),
        (f'{HEADER}\n"0,1,2,3,4,5,6\n1,1,2,3,4,5,6"', "line 2 has a quote that is not closed.*decimal"),
        (f'{HEADER}\n""\n', "line 2 has 1.*decimal"),
    ],
)
def test_a_file_of_quotes_or_tabs_is_refused_in_a_sentence(tmp_path: Path, content: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_recording(_log(tmp_path, content))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("piece", [60, 61, 97, 150, 400])
def test_pieces_do_not_change_what_is_read_or_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, piece: int
) -> None:
    """The step that is usual is taken from the first piece; here it is the same everywhere."""
    rows = [f"{0.01 * k + (k > 20):.2f},1,2,{k},4,5,6,{'' if k % 3 else k}" for k in range(40)]
    rows[5:5] = ["", "  ", '0.055,oops,2,3,4,5,6,"x', "0.056,1,2"]
    rows[30:30] = ["", "0.2,inf,2,3,4,5,6,7", "0.1,none,2,3,4,5,6,7"]
    path = _log(tmp_path, "", f"{HEADER},note", *rows, "", end=end)
    whole = read_recording(path)
    assert len(whole.notes) == 8
    monkeypatch.setattr("palpate.files.logs.text.PIECE", piece)
    monkeypatch.setattr("palpate.files.logs.stuck.FIRST", 1)
    log = open_log(path)
    blocks = list(log.blocks())
    assert len(blocks) > 2
    joined = join(blocks)
    assert np.array_equal(joined.time, whole.time, equal_nan=True)
    assert np.array_equal(joined.wrenches(), whole.wrenches(), equal_nan=True)
    assert log.notes() == whole.notes
    assert log.position == log.size


def test_a_column_of_text_is_refused_only_if_it_never_holds_a_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sensor that starts late writes words for the first minute."""
    monkeypatch.setattr("palpate.files.logs.text.PIECE", 100)
    rows = [f"{k},{'starting' if k < 50 else 1},2,3,4,5,6" for k in range(60)]
    recording = read_recording(_log(tmp_path, HEADER, *rows))
    assert np.isnan(recording.wrenches()[:, 0]).tolist() == [True] * 50 + [False] * 10
    with pytest.raises(InputError, match=r"csv: column 'fx' has no numbers; line 2 has 'starting'"):
        read_recording(_log(tmp_path, HEADER, *rows[:50]))


def test_a_quoted_line_with_a_carriage_return_is_a_sentence(tmp_path: Path) -> None:
    """Python's csv refuses such a line with an error of its own; found by fuzzing."""
    path = tmp_path / "log.csv"
    path.write_bytes(b'a,b\n1,"2"\r3\n4,5\n')
    with pytest.raises(InputError, match=r"log\.csv.*Available"):
        read_recording(path)
