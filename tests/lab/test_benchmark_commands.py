"""The public benchmark as a stranger uses it: made, answered by a CSV or a function, scored; mistakes are sentences."""

import hashlib
import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.errors import InputError
from palpate_lab.benchmark import TASKS, make_benchmark
from palpate_lab.benchmark.files import read_answers, read_benchmark, read_truth
from palpate_lab.benchmark.scoring import score
from palpate_lab.cli.benchmark_entrants import users
from palpate_lab.cli.benchmark_palpate import palpate_entrants
from palpate_lab.cli.benchmark_peers import peers

MADE = ("ellipsoid", "torus", "box", "payload-log", "fingertip")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("benchmark") / "tasks"
    make_benchmark(made, small=True, only=MADE)
    return made


@pytest.fixture(scope="module")
def perfect(folder: Path) -> Path:
    """The truth as a stranger would answer with it."""
    tables = []
    for name in read_benchmark(folder):
        known = pl.read_csv(folder / name / "truth.csv").drop_nulls("px")
        tables.append(known.select(pl.lit(name).alias("task"), pl.all()))
    pl.concat(tables).write_csv(folder / "perfect.csv")
    return folder / "perfect.csv"


def _hash(folder: Path) -> dict[str, str]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_the_same_seed_gives_the_same_bits_whatever_else_is_made(folder: Path, tmp_path: Path) -> None:
    make_benchmark(tmp_path / "again", small=True, only=("torus", "fingertip"))
    make_benchmark(tmp_path / "other", 2, small=True, only=("torus",))
    for name in ("torus", "fingertip"):
        assert _hash(tmp_path / "again" / name) == _hash(folder / name)
    assert _hash(tmp_path / "other/torus")["readings.csv"] != _hash(folder / "torus")["readings.csv"]


def test_truth_lies_on_the_exact_surface_and_makes_the_readings(folder: Path) -> None:
    """By the equations; the ellipsoid's readings have no noise, so that M - p x F is along the normal."""
    tasks = read_benchmark(folder)
    points = {name: read_truth(tasks[name])[0].point for name in ("ellipsoid", "torus", "box")}
    halves = np.array([0.03, 0.02, 0.012])
    assert np.abs(np.sum((points["ellipsoid"] / halves) ** 2, axis=1) - 1).max() < 1e-6  # nine digits are written
    ring = np.hypot(points["torus"][:, 0], points["torus"][:, 1]) - 0.03
    assert np.abs(np.hypot(ring, points["torus"][:, 2]) - 0.01).max() < 1e-8
    assert np.abs(np.max(np.abs(points["box"]) / halves, axis=1) - 1).max() < 1e-6
    wrench = np.stack(list(tasks["ellipsoid"].readings()))
    normal = points["ellipsoid"] / halves**2
    left = wrench[:, 3:] - np.cross(points["ellipsoid"], wrench[:, :3])
    assert np.abs(np.cross(left, normal / np.linalg.norm(normal, axis=1, keepdims=True))).max() < 1e-7
    for name in MADE[:3]:
        assert tasks[name].mesh().open_edges == 0


def test_perfect_answers_of_a_stranger_score_nothing_off(folder: Path, perfect: Path) -> None:
    tasks = read_benchmark(folder)
    answers = read_answers(perfect, tasks)
    assert set(answers) == set(MADE)
    for name, task in tasks.items():
        got = score(answers[name], *read_truth(task))
        assert (got.median, got.p95, got.near, got.answered, got.false, got.force) == (0, 0, 1, 1, 0, 0)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("task,sample,px,py,pz\ntorus,0,1,2", "no row has the 5 fields.*line 2 has 4"),
        ("task,sample,px,py,pz\ntorus,0,1,2,nan", "line 2.*pz is not a finite number.*leave out the row"),
        ("task,sample,px,py,pz\ntorus,0,1,2,x\ntorus,1,1,2,3", "line 2.*|'x' in column 'pz' is not a number"),
        ("task,sample,px,py,pz\ntorsu,0,1,2,3", "line 2.*task 'torsu' is unknown.*'torus'"),
        ("task,sample,px,py,pz\ntorus,15,1,2,3", "line 2.*sample.*0 to 14, not 15"),
        ("task,sample,px,py,pz\ntorus,0.5,1,2,3", "line 2.*sample.*not 0.5"),
        ("task,sample,px,py,pz\ntorus,3,1,2,3\ntorus,3,1,2,3", "line 3.*sample 3 of torus has more than 1 contact"),
        ("task,sample,px,py\ntorus,0,1,2", "no column 'pz'"),
        ("task,sample,px,py,pz,fx\ntorus,0,1,2,3,4", "no column 'fy'"),
        ("task,sample,px,py,pz,fx,fy,fz\ntorus,0,1,2,3,4,,6", "line 2.*fy is not a finite.*all numbers of a force"),
        ("task,sample,px,py,pz,cx\ntorus,0,1,2,3,4", "no column 'cx'.*cxx"),
        ("task,sample,px,py,pz,cxx,cxy,cxz,cyy,cyz,czz\ntorus,0,1,2,3,1,2,0,1,0,1", "line 2.*variance is negative"),
    ],
)
def test_a_mistake_in_a_csv_is_one_sentence_with_its_line(folder: Path, tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "answers.csv").write_text(line + "\n")
    with pytest.raises(InputError, match=said):
        read_answers(tmp_path / "answers.csv", read_benchmark(folder))


def test_forces_and_covariances_may_be_left_out_row_by_row(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("pz,py,px,sample,task,fx,fy,fz\n3,2,1,1,torus,4,5,6\n3,2,1,0,torus,,,\n")
    got = read_answers(tmp_path / "a.csv", read_benchmark(folder))["torus"]
    assert got.point.tolist() == [[1, 2, 3]] * 2
    assert np.array_equal(got.force, [[np.nan] * 3, [4, 5, 6]], equal_nan=True)


MINE = """
import numpy as np
def truth(task):
    if task.kind != "wrench":
        return None
    known = task.table("truth.csv")
    rows = iter(np.column_stack([known[name] for name in ("px", "py", "pz")]))
    return lambda reading: next(rows) if reading.shape == (len(task.columns),) else None
never = lambda task: lambda reading: None
wide = lambda task: lambda reading: np.zeros(4)
many = lambda task: lambda reading: np.zeros((2, 3))
broken = lambda task: lambda reading: 1 / 0
odd = lambda task: 3
number = 5
"""


def test_a_function_of_a_user_and_the_page(
    folder: Path, perfect: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_benchmark_entry.py").write_text(MINE)
    given = ["--answers", str(perfect), "--estimator", "my_benchmark_entry:truth", "--alone"]
    assert main(["benchmark", "score", str(folder), *given, "-o", "table.html", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    tables = {part["title"]: part["tables"][0] for part in said["parts"]}
    assert set(tables) == set(MADE)
    for name, rows in tables.items():
        names = [row["name"] for row in rows]
        entered = ["perfect.csv", "my_benchmark_entry:truth"]
        assert names == (entered if name in MADE[:3] else entered[:1])
        assert all(row["median [mm]"] == 0.0 for row in rows)
    page = (tmp_path / "table.html").read_text()
    assert "my_benchmark_entry:truth" in page
    assert "torus" in page


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("never", ""),
        ("wide", "task box, sample 0: answered with shape 4"),
        ("many", "2 contacts, but at most 1"),
        ("broken", r"raised ZeroDivisionError .*my_benchmark_other.py, line"),
        ("odd", "must return a function .* not int"),
        ("number", "has no function 'number'"),
        ("nothing", "has no function 'nothing'"),
    ],
)
def test_what_a_function_does_wrong_is_one_sentence(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_benchmark_other.py").write_text(MINE)
    task = read_benchmark(folder)["box"]
    if not said:
        found = users(f"my_benchmark_other:{name}").enter(task)
        assert score(found.contacts, *read_truth(task)).answered == 0.0
        return
    with pytest.raises(InputError, match=said):
        users(f"my_benchmark_other:{name}").enter(task)


def test_every_peer_enters_something_and_palpate_is_within_its_ellipses(folder: Path) -> None:
    """Where logs are concerned the quick peers only: a tenth of the readings' cost is theirs."""
    tasks = read_benchmark(folder)
    entered: set[str] = set()
    for name in ("torus", "box", "payload-log", "fingertip"):
        task, log = tasks[name], name in MADE[3:]
        truth, quiet = read_truth(task)
        for entrant in (*palpate_entrants(), *peers()):
            if log and entrant.name not in ("Palpate", "first hit of the line of action"):
                continue
            found = entrant.enter(task)
            if found is None:
                continue
            got = score(found.contacts, truth, quiet)
            entered.add(entrant.name)
            if entrant.name == "Palpate":
                assert got.near > 0.9
                assert got.coverage.inside > 0.7  # 15 wrenches: at 95 % fewer than 11 come once in a thousand times
    assert len(entered) == 7


@pytest.mark.parametrize(
    ("call", "code", "said"),
    [
        ("benchmark --help", 0, "make"),
        ("benchmark score --help", 0, "infinitely far off"),
        ("benchmark mkae -o x", 2, "did you mean `palpate benchmark make`"),
        ("benchmark score x --answer y", 2, "did you mean --answers?"),
        ("benchmark score nowhere", 1, "is not a folder"),
        ("benchmark score . --alone", 1, "no estimator to score"),
        ("benchmark score . -o table.txt", 1, "Name it .html or .md"),
        ("benchmark score .", 1, "has no task"),
        ("benchmark make -o new --only torsu", 1, "task 'torsu' is unknown"),
        ("benchmark score {folder} --estimator mine --alone", 1, "module:function"),
        ("benchmark score {folder} --estimator no_such_module:f --alone", 1, "module 'no_such_module' is neither"),
    ],
)
def test_the_front_door(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    call: str, code: int, said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(call.format(folder=folder).split()) == code
    out, err = capsys.readouterr()
    assert said in (err if code else out)
    if code:
        assert err.count("\n") == 1
        assert not (tmp_path / "new").exists()


def test_every_kind_of_task_is_there() -> None:
    assert set(MADE) | {"ellipsoid-noise", "probe", "skin", "marker-ring"} == set(TASKS)
