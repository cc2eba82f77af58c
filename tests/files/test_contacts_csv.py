"""contacts.csv and truth.csv: what is written reads back the same to the last bit, whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from palpate.contact import ContactEstimate, Contacts, Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.table import COLUMNS
from palpate.errors import InputError
from palpate.files.atomic import replacing
from palpate.files.contacts import read_contacts, write_contacts
from palpate.files.ground_truth import read_ground_truth, read_touches

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
