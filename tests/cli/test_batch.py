"""`palpate batch`: the bits of one by one, whatever runs them; what is done stays done, what fails is said."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import polars as pl
import pytest

from claims.evidence.datasets_written import write_dataset
from palpate.cli import batch as command
from palpate.cli import main
from palpate.cli.batch_logs import logs_of, names_of
from palpate.console import parallel
from palpate.errors import InputError
from palpate.setup import load_rig
from palpate_lab.simulation.session import simulate_session
from palpate_lab.simulation.session_files import write_session
from tests.files.test_datasets import _batch as label
from tests.files.test_datasets import _rows, _table
from tests.support.logs_torn import torn_pages

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")
pytest.importorskip("joblib")

BROKEN = "time,fx\n1,2\n"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig, three logs, two of one name, a file that is none, and what `palpate estimate` makes of a log."""
    folder = tmp_path_factory.mktemp("fleet")
    write_session(simulate_session(3, touches=3, facets=500), folder)
    assert main(["calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")]) == 0
    lines = (folder / "touches.csv").read_text().splitlines(keepends=True)
    for name, end in (("a/run.csv", 700), ("b/run.csv", 500), ("b/later.csv", 300)):
        (folder / "logs" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "logs" / name).write_text("".join(lines[:end]))
    (folder / "logs" / "b" / "broken.csv").write_text(BROKEN)
    words = ["estimate", str(folder / "logs/a/run.csv"), "--rig", str(folder / "rig.toml")]
    main([*words, "-o", str(folder / "one.parquet")])
    return folder


def _batch(fleet: Path, out: Path, *words: str, logs: str = "logs") -> int:
    workers = () if "--workers" in words else ("--workers", "1")
    return main(["batch", str(fleet / logs), "--rig", str(fleet / "rig.toml"), "-o", str(out), *workers, *words])


@pytest.fixture(scope="module")
def made(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a batch that is done."""
    out = tmp_path_factory.mktemp("made") / "out"
    assert _batch(fleet, out) == 5
    return out


def _same(one: Path, other: Path) -> bool:
    """Contacts and what they are made from, to the last bit."""
    names = sorted(path.name for path in one.iterdir() if path.name not in ("batch.html", "batch.jsonl"))
    return len(names) == 6 and all((one / name).read_bytes() == (other / name).read_bytes() for name in names)


def test_each_log_is_what_estimate_makes_of_it(fleet: Path, made: Path) -> None:
    names = {path.name for path in made.iterdir()}
    assert {"a-run.parquet", "b-run.parquet", "later.parquet", "batch.html", "batch.jsonl"} <= names
    assert (made / "a-run.parquet").read_bytes() == (fleet / "one.parquet").read_bytes()
    assert (made / "a-run.parquet.toml").read_bytes() == (fleet / "one.parquet.toml").read_bytes()


def test_what_fails_is_listed_and_nothing_else_is_lost(fleet: Path, made: Path) -> None:
    page = (made / "batch.html").read_text()
    assert re.search(r"3 of 4|of 4", page)
    assert "Logs that failed" in page
    assert "there is no column" in page
    rows = re.findall(r"<td[^>]*>[^<]*logs/[^<]*</td>", page)
    assert len([row for row in rows if "run.csv" in row]) == 2


def test_what_is_whole_is_not_done_again(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log, an output, or the rig that changed, a line that was cut, and what failed are done again."""
    out = tmp_path / "out"
    assert _batch(fleet, out, logs="logs/b/*.csv") == 5
    before = {path: path.stat().st_mtime_ns for path in out.glob("*.parquet")}
    capsys.readouterr()
    assert _batch(fleet, out, "--json", logs="logs/b/*.csv") == 5
    said = json.loads(capsys.readouterr().out)
    assert said["facts"]["done"] == 2
    assert "broken.csv: there is no column" in said["warnings"][0]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    (out / "run.parquet").write_bytes(b"cut")
    kept = out / "batch.jsonl"
    kept.write_text(kept.read_text()[:-20])
    assert _batch(fleet, out, logs="logs/b/*.csv") == 5
    after = {path.name: path.stat().st_mtime_ns > then for path, then in before.items()}
    assert after == {"run.parquet": True, "later.parquet": False}
    assert _batch(fleet, out, "--friction", "0.9", logs="logs/b/later.csv") == 0
    assert (out / "later.parquet").stat().st_mtime_ns > before[out / "later.parquet"]


def test_ctrl_c_leaves_no_half_output_and_goes_on(
    fleet: Path, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calls = iter(range(100))

    def stop(parent: int, done: int, share: float) -> None:
        if next(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(command, "_watch", stop)
    out = tmp_path / "out"
    assert _batch(fleet, out) == 130
    assert "2 of 4 logs are in" in capsys.readouterr().out
    assert [path.name for path in out.glob("*.parquet")] == ["a-run.parquet"]
    assert _batch(fleet, out) == 5
    assert _same(made, out)


def test_a_batch_that_is_killed_goes_on(fleet: Path, made: Path, tmp_path: Path) -> None:
    """By the signal that nothing can catch, with its two workers, when the first log is done."""
    out = tmp_path / "out"
    words = ["batch", str(fleet / "logs"), "--rig", str(fleet / "rig.toml"), "-o", str(out), "--workers", "2"]
    process = subprocess.Popen([sys.executable, "-m", "palpate", *words], start_new_session=True)
    for _ in range(6000):
        if process.poll() is not None or ((out / "batch.jsonl").exists() and len(_lines(out)) > 1):
            break
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert len(_lines(out)) > 1
    assert _batch(fleet, out) == 5
    assert _same(made, out)


def _lines(out: Path) -> list[str]:
    return (out / "batch.jsonl").read_text().splitlines()


def test_a_full_disk_is_a_sentence_and_the_same_command_goes_on(
    fleet: Path, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No file may become larger than some bytes, which is what a full disk is to a writer."""
    out, (_, most) = tmp_path / "out", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, most))
    try:
        assert _batch(fleet, out) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert "batch.html: cannot write here (File too large)" in capsys.readouterr().err
    assert [json.loads(line)["result"]["failure"].count("cannot write") for line in _lines(out)[1:]].count(1) == 3
    assert not list(out.glob("*.parquet"))
    assert _batch(fleet, out) == 5
    assert _same(made, out)


def test_a_log_that_breaks_in_the_middle_is_listed(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = torn_pages(fleet / "logs/a/run.csv", tmp_path / "run.parquet"), tmp_path / "out"
    words = ["batch", str(log), "--rig", str(fleet / "rig.toml"), "--workers", "1"]
    assert main([*words, "-o", str(out)]) == 5
    assert "run.parquet: cannot be read as Parquet" in capsys.readouterr().out
    assert not list(out.glob("*.parquet"))
    assert main([*words, "-o", str(log / "out")]) == 1
    assert "cannot write here: there is no folder" in capsys.readouterr().err


def test_a_worker_that_is_ended_from_outside_costs_one_job() -> None:
    """Jobs in Python, so that the one that leaves takes its process along."""
    jobs = ["1", "2", "__import__('os')._exit(3)", "4", "5"]
    found = parallel.each_done(eval, jobs, 2, "processes", "--workers", lambda job: len(job))
    assert sorted(found) == sorted([1, 2, len(jobs[2]), 4, 5])


@pytest.mark.parametrize(("backend", "module"), [("dask", "distributed"), ("ray", "ray")])
def test_every_backend_gives_the_same_bits(
    fleet: Path, made: Path, tmp_path: Path, backend: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a local cluster of each; `palpate batch` itself does not need them, so the environment may lack them."""
    pytest.importorskip(module)
    out = tmp_path / "out"
    monkeypatch.setenv("RAY_worker_niceness", "0")
    words = ["batch", str(fleet / "logs"), "--rig", str(fleet / "rig.toml"), "-o", str(out), "--workers", "2"]
    done = subprocess.run([sys.executable, "-m", "palpate", *words, "--backend", backend], check=False)  # a main module
    assert done.returncode == 5
    assert _same(made, out)


def test_what_a_backend_needs_is_said(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = parallel.import_module

    def missing(name: str) -> ModuleType:
        if name.startswith(("ray", "distributed")):
            raise ImportError(name)
        return real(name)

    monkeypatch.setattr(parallel, "import_module", missing)
    for backend, pip in (("ray", "pip install 'ray'"), ("dask", "pip install 'dask[distributed]'")):
        assert _batch(fleet, tmp_path / "out", "--backend", backend) == 1
        assert pip in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("logs", "words", "said"),
    [
        ("logs", ("--backend", "slurm"), "no backend 'slurm'. Use"),
        ("logs", ("--workers", "0"), "--workers"),
        ("nowhere", (), "does not exist"),
        ("logs/*.bag", (), "matches no file. Give"),
        ("logs/a/run.csv", ("--frame", "base", "--rig", "none.toml"), "the file does not exist"),
    ],
)
def test_a_batch_that_cannot_be_meant_is_one_sentence(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], logs: str, words: tuple[str, ...], said: str
) -> None:
    assert _batch(fleet, tmp_path / "out", *words, logs=logs) == 1
    assert said in capsys.readouterr().err


def test_no_log_is_written_over(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    log.write_bytes((fleet / "logs/a/run.csv").read_bytes())
    words = ["batch", str(log), "--rig", str(fleet / "rig.toml"), "-o", str(tmp_path), "--format", "csv"]
    assert main(words) == 1
    assert "would overwrite an input. Name" in capsys.readouterr().err


def test_logs_are_found_once_and_never_in_the_output(fleet: Path, tmp_path: Path) -> None:
    logs = fleet / "logs"
    found = logs_of([logs / "b", logs, Path(f"{logs}/**/run.csv")], fleet / "logs" / "a")
    assert [path.relative_to(logs).as_posix() for path in found] == ["b/broken.csv", "b/later.csv", "b/run.csv"]
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("")
    (tmp_path / "bag" / "bag_0.db3").write_text("")
    assert logs_of([tmp_path], tmp_path / "out") == [tmp_path / "bag"]
    with pytest.raises(InputError, match=r"contains no log.*Give"):
        logs_of([logs], logs)


def _names(words: str, known: dict[Path, str]) -> Iterator[str]:
    yield from names_of([Path(word) for word in words.split()], known).values()


@pytest.mark.parametrize(
    ("logs", "names"),
    [
        ("/x/a/run.csv /x/b/run.csv /x/b/one.csv", "one a-run b-run"),
        ("/x/a/run.csv /x/a/run.mcap", "run-1 run-2"),
        ("/x/a/RUN.csv /x/a/b/run.csv /y/b/run.csv", "a-RUN a-b-run y-b-run"),
    ],
)
def test_no_two_logs_share_an_output(logs: str, names: str) -> None:
    assert sorted(_names(logs, {})) == sorted(names.split())


def test_a_log_keeps_the_name_that_it_had() -> None:
    known = {Path("/x/a/run.csv").resolve(): "run"}
    assert list(_names("/x/a/run.csv /x/b/run.csv", known)) == ["run", "b-run"]


def test_a_data_set_is_labelled_alone_and_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_dataset(tmp_path / "data_set", "v2.1")
    assert label(tmp_path, out="data_set/out") == 1
    assert "is the data set or in it, and a copy is written. Name" in capsys.readouterr().err
    data, rig = str(tmp_path / "data_set"), str(tmp_path / "rig.toml")
    assert main(["rig", "new", data, "-o", str(tmp_path / "new.toml"), "--poses", rig]) == 1
    assert "not for a data set. Leave" in capsys.readouterr().err
    (tmp_path / "out/data").mkdir(parents=True)
    (tmp_path / "out/data/episode_000009.parquet").write_text("")
    assert label(tmp_path) == 1
    assert "is of another data set, which would be mixed with this one. Name" in capsys.readouterr().err
    assert main(["batch", data, rig, "--rig", rig, "-o", str(tmp_path / "out"), "--workers", "1"]) == 1
    assert "is labelled alone. Give" in capsys.readouterr().err


def test_rows_of_an_episode_that_is_not_listed_are_not_labelled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_dataset(tmp_path / "data_set", "v2.1")
    _rows(lambda rows: pl.concat([rows, rows[:1].with_columns(episode_index=pl.lit(9, pl.Int64))]))(
        tmp_path / "data_set"
    )
    assert label(tmp_path) == 1
    assert ".parquet: has rows of an episode that the folder meta does not list" in capsys.readouterr().err


def test_a_rig_is_guessed_from_the_names_that_features_state(tmp_path: Path) -> None:
    write_dataset(tmp_path / "data_set", "v3.0")
    assert main(["rig", "new", str(tmp_path / "data_set"), "-o", str(tmp_path / "rig.toml")]) == 0
    rig = load_rig(tmp_path / "rig.toml")
    assert rig.layout().wrench == tuple(f"observation.state[{k}]" for k in range(2, 8))
    assert rig.time.column == "timestamp"
    words = ["rig", "new", str(tmp_path / "data_set"), "-o", str(tmp_path / "skin.toml"), "--sensor", "skin"]
    assert main(words) == 0
    assert load_rig(tmp_path / "skin.toml").sensors["skin"].cells == "observation.tactile"
    shutil.copy(tmp_path / "skin.toml", tmp_path / "rig.toml")
    words = ["batch", str(tmp_path / "data_set"), "--rig", str(tmp_path / "skin.toml"), "-o", str(tmp_path / "out")]
    assert main([*words, "--workers", "1"]) in (0, 4)  # noise, in which nothing touches
    assert len(_table(tmp_path / "out")) == len(_table(tmp_path / "data_set"))
