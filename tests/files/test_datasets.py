"""Data sets of LeRobot: `palpate batch` copies them with contacts as columns, row for row, or says a sentence."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from claims.evidence.datasets_written import NAMES, RADIUS, RIG, write_dataset
from palpate.cli import main
from palpate.contact.estimate import Status
from palpate.contact.table import from_frame, schema
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.files.datasets import columns, labelled
from palpate.files.datasets.dataset import read_dataset
from palpate.files.datasets.named import write_named
from palpate.setup import load_rig
from palpate.setup.rig import check_rig

PREFIX = "observation.contact."
NEW = {f"{PREFIX}{name}" for name in ("count", "status", "point", "force", "covariance")}
VERSIONS = ("v2.0", "v2.1", "v3.0")


def _batch(folder: Path, *more: str, data: str = "data_set", out: str = "out") -> int:
    (folder / "rig.toml").write_text(RIG)
    words = ["batch", str(folder / data), "--rig", str(folder / "rig.toml"), "-o", str(folder / out), "--workers", "1"]
    return main([*words, *more])


@pytest.fixture(scope="module", params=VERSIONS)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A folder with a data set and its copy, and the points that are pressed."""
    folder = tmp_path_factory.mktemp("made")
    points = write_dataset(folder / "data_set", request.param, episodes=22 if request.param == "v3.0" else 3)
    (folder / "data_set" / ".cache").mkdir()
    (folder / "data_set" / ".cache" / "token").write_text("")
    assert _batch(folder) == 0
    return folder, points


def _table(root: Path) -> pl.DataFrame:
    return pl.concat([pl.read_parquet(file) for file in sorted((root / "data").rglob("*.parquet"))])


def _json(path: Path) -> Any:
    return json.loads(path.read_text())


def test_the_copy_has_the_rows_and_the_contacts_in_them(made: tuple[Path, np.ndarray]) -> None:
    folder, points = made
    first, copy = _table(folder / "data_set"), _table(folder / "out")
    assert set(copy.columns) - set(first.columns) == NEW
    old = copy.drop(NEW)
    assert old.equals(first.cast(old.schema))
    pressed = np.isfinite(points[:, 0])
    np.testing.assert_array_equal(copy[f"{PREFIX}count"].to_numpy() > 0, pressed)
    point, force = (np.array(copy[PREFIX + name].to_list()) for name in ("point", "force"))
    assert np.abs(point - points)[pressed].max() < 0.1 * RADIUS
    assert not point[~pressed].any()
    assert np.linalg.norm(force[pressed], axis=1) == pytest.approx(5.0, abs=1.5)
    assert (copy[f"{PREFIX}status"].to_numpy()[pressed] <= Status.AMBIGUOUS).all()


def test_the_copy_states_what_it_has(made: tuple[Path, np.ndarray]) -> None:
    folder, _ = made
    first, copy = (_json(folder / name / "meta/info.json") for name in ("data_set", "out"))
    assert {**copy, "features": first["features"]} == first
    features = copy["features"]
    assert features.keys() - first["features"].keys() == NEW
    assert features[f"{PREFIX}point"]["shape"] == [3]
    assert features[f"{PREFIX}point"]["info"] == {
        "unit": "m",
        "frame": "surface",
        "of": "the contact with the largest force",
    }
    assert features[f"{PREFIX}status"]["info"]["codes"][Status.NO_CONTACT] == "no_contact"
    table = _table(folder / "out")
    for name in NEW:
        values = np.array(table[name].to_list(), dtype=np.float64).reshape(len(table), -1)
        assert [values.shape[1]] == features[name]["shape"]
        for path in (folder / "out/meta").rglob("*"):
            for old, new, rows in _statistics(path, name, table, values):
                assert new.keys() == old.keys()
                np.testing.assert_allclose(new["mean"], rows.mean(axis=0), rtol=1e-6, atol=1e-12)
                np.testing.assert_allclose(new["std"], rows.std(axis=0), rtol=1e-5, atol=1e-12)
                np.testing.assert_array_equal(new["max"], rows.max(axis=0))
                assert list(new["count"]) == [len(rows)]


def _statistics(path: Path, name: str, table: pl.DataFrame, values: np.ndarray) -> list[tuple[Any, Any, np.ndarray]]:
    """Statistics of another feature, of this one, and the values that these are of, as a file has them."""
    whose = table["episode_index"].to_numpy()
    if path.name == "stats.json":
        return [(_json(path)["timestamp"], _json(path)[name], values)]
    if path.name == "episodes_stats.jsonl":
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        return [
            (line["stats"]["timestamp"], line["stats"][name], values[whose == line["episode_index"]]) for line in lines
        ]
    if path.parent.parent.name != "episodes":
        return []
    rows = pl.read_parquet(path)

    def of(feature: str, row: dict[str, Any]) -> dict[str, Any]:
        head = f"stats/{feature}/"
        return {key.removeprefix(head): value for key, value in row.items() if key.startswith(head)}

    return [
        (of("timestamp", row), of(name, row), values[whose == row["episode_index"]])
        for row in rows.iter_rows(named=True)
    ]


def test_all_else_is_as_it_was(made: tuple[Path, np.ndarray]) -> None:
    folder, _ = made
    files = {path.relative_to(folder / "data_set") for path in (folder / "data_set").rglob("*") if path.is_file()}
    copied = {path.relative_to(folder / "out") for path in (folder / "out").rglob("*") if path.is_file()}
    assert files - copied == {Path(".cache/token")}
    assert {path.parts[0] for path in copied - files} == {"contacts", "batch.html", "batch.jsonl"}
    video = Path("videos/top/chunk-000/file-000.mp4")
    assert (folder / "out" / video).samefile(folder / "data_set" / video)
    assert not (folder / "out/README.md").samefile(folder / "data_set/README.md")
    for path in sorted((folder / "out/data").rglob("*.parquet")):
        kept = pl.read_parquet_metadata(path)
        assert kept.keys() & {"ARROW:schema", "huggingface"} == {"huggingface"}


def test_an_episode_is_what_estimate_makes_of_it(made: tuple[Path, np.ndarray]) -> None:
    folder, _ = made
    episode = read_dataset(folder / "data_set").episodes[1]
    (folder / "one.toml").write_text(f'{RIG}\n[time]\ncolumn = "timestamp"\nunit = "s"\nepisode = 1\n')
    words = ["estimate", str(folder / "data_set" / episode.file), "--rig", str(folder / "one.toml")]
    assert main([*words, "-o", str(folder / "one.parquet")]) == 0
    assert (folder / "one.parquet").read_bytes() == (folder / "out/contacts/episode_000001.parquet").read_bytes()
    assert len(read_contacts(folder / "one.parquet")) == episode.length


def test_a_copy_that_was_stopped_does_not_open_and_the_same_command_goes_on(
    made: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = made
    before = {path: path.read_bytes() for path in (folder / "out").rglob("*") if path.is_file()}
    kept = {path: path.stat().st_mtime_ns for path in (folder / "out/contacts").iterdir()}

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(labelled, "_write_statistics", stop)
        assert _batch(folder) == 130
    assert not (folder / "out/meta/info.json").exists()
    (folder / "out/data/.left.parquet.x.part").write_text("")
    assert _batch(folder) == 0
    assert "the others follow" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    del before[folder / "out/batch.html"]
    assert {path: path.read_bytes() for path in before} == before
    assert not list((folder / "out").rglob("*.part"))


def _info(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    def spoil(root: Path) -> None:
        info = _json(root / "meta/info.json")
        change(info)
        (root / "meta/info.json").write_text(json.dumps(info))

    return spoil


def _rows(change: Callable[[pl.DataFrame], pl.DataFrame]) -> Callable[[Path], None]:
    def spoil(root: Path) -> None:
        path = root / "data/chunk-000/episode_000001.parquet"
        change(pl.read_parquet(path)).write_parquet(path)

    return spoil


def _file(name: str, text: str | None) -> Callable[[Path], None]:
    def spoil(root: Path) -> None:
        (root / "meta" / name).unlink()
        if text is not None:
            (root / "meta" / name).write_text(text)

    return spoil


WIDER = pl.col("observation.state").list.concat(pl.lit([0.0], dtype=pl.List(pl.Float32)))


@pytest.mark.parametrize(
    ("spoil", "code", "said"),
    [
        (_info(lambda info: info.update(codebase_version="v4.0")), 1, "LeRobot's version 'v4.0'; known are"),
        (_info(lambda info: info.pop("fps")), 1, "states no rate: fps is None. Write"),
        (_info(lambda info: info.pop("features")), 1, "states no features. Copy"),
        (_info(lambda info: info.update(data_path="../{episode_index}.parquet")), 1, "a file outside of its folder"),
        (_info(lambda info: info.update(data_path="{other}.parquet")), 1, "does not state where the rows"),
        (_info(lambda info: info["features"].update({f"{PREFIX}point": {}})), 1, "column 'observation.contact.point'"),
        (_file("info.json", "{"), 1, "is not JSON"),
        (_file("episodes.jsonl", None), 1, "episodes.jsonl: the file does not exist"),
        (_file("episodes.jsonl", ""), 1, "data_set: has no episodes"),
        (_file("episodes_stats.jsonl", '{"episode_index": 7, "stats": {}}'), 1, "does not hold the statistics of each"),
        (_rows(lambda rows: rows[:-1]), 5, "has 60 rows of episode 1, but the folder meta states 61. Copy"),
        (_rows(lambda rows: rows.with_columns(WIDER)), 5, "'observation.state' has 9 numbers, but meta/info.json"),
        (_rows(lambda rows: rows.drop("observation.state")), 5, "there is no column 'observation.state[2]'"),
        (_rows(lambda rows: rows.drop("episode_index")), 5, "has no column 'episode_index'. Remove"),
    ],
)
def test_a_data_set_that_is_not_as_it_states_is_a_sentence(
    spoil: Callable[[Path], None], code: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_dataset(tmp_path / "data_set", "v2.1")
    spoil(tmp_path / "data_set")
    assert _batch(tmp_path) == code
    printed = "".join(capsys.readouterr())
    assert said in printed
    assert "Traceback" not in printed
    assert not (tmp_path / "out/meta/info.json").exists()
    assert code == 1 or "the data set is not written: 1 of 3 episodes have no contacts" in printed


@pytest.mark.parametrize("made", ["v2.1"], indirect=True)
def test_workers_that_were_started_elsewhere_find_a_data_set(
    made: tuple[Path, np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are kept for the next batch, and stay in the folder in which they were started."""
    folder, _ = made
    for place, data_set, rig in (
        (tmp_path, folder / "data_set", folder / "rig.toml"),
        (folder, "data_set", "rig.toml"),
    ):
        monkeypatch.chdir(place)
        output = tmp_path / f"from_{place.name}"
        assert main(["batch", str(data_set), "--rig", str(rig), "-o", str(output), "--workers", "2"]) == 0


def test_files_of_another_system_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise OSError

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    write_dataset(tmp_path / "data_set", "v2.1")
    assert _batch(tmp_path) == 0
    first, copy = (tmp_path / name / "videos/top/chunk-000/file-000.mp4" for name in ("data_set", "out"))
    assert first.read_bytes() == copy.read_bytes()
    assert not first.samefile(copy)


def test_times_that_are_not_there_follow_from_the_rate(tmp_path: Path) -> None:
    root = tmp_path / "data_set"
    write_dataset(root, "v2.1")
    for path in (root / "data").rglob("*.parquet"):
        pl.read_parquet(path).drop("timestamp").write_parquet(path)
    _info(lambda info: info["features"].pop("timestamp"))(root)
    assert _batch(tmp_path) == 0
    np.testing.assert_allclose(np.diff(read_contacts(tmp_path / "out/contacts/episode_000000.parquet").time), 0.01)


def test_a_slice_names_columns(tmp_path: Path) -> None:
    for given in ('"a.b[6:12]"', '["a.b[6:9]", "a.b[9:12]"]', '["a.b[6:11]", "a.b[11]"]'):
        (tmp_path / "rig.toml").write_text(RIG.replace('"observation.state[2:8]"', given))
        assert load_rig(tmp_path / "rig.toml").layout().wrench == tuple(f"a.b[{k}]" for k in range(6, 12))
    for given in ("a[6:6]", "a[7:6]", "a[0:99999999]"):
        table = {"surface": {"kind": "sphere", "radius": 1.0}, "force_torque": {"columns": given}}
        with pytest.raises(InputError, match=r"names \d+ columns.*Write"):
            check_rig(table, tmp_path / "rig.toml")


def test_a_row_has_its_largest_contact() -> None:
    """Of two contacts at once, the first one and the second one is larger; two are found and not answered."""
    one = {"time": 0.0, "contact": 1, "status": "contact", "candidates": 1, "px": 1.0, "py": 0.0, "pz": 0.0}
    one |= dict.fromkeys(("fx", "fy"), 0.0) | dict.fromkeys(("var_xy", "var_xz", "var_yz"), 0.5)
    forces = [(0, 1.0), (0, 3.0), (1, 0.5), (1, 0.2)]
    rows = [{**one, "sample": sample, "fz": force, "px": force} for sample, force in forces]
    rows += [{**one, "sample": sample, "fz": 9.0, "status": "off_surface"} for sample in (1, 2)]
    contacts = from_frame(pl.DataFrame(rows, schema=schema()))
    made = columns.contact_columns(contacts, 3, "contacts.csv")
    assert made["count"].tolist() == [[2], [2], [0]]
    assert made["status"].tolist() == [[0], [0], [Status.OFF_SURFACE]]
    assert made["force"].tolist() == [[0, 0, 3], [0, 0, 0.5], [0, 0, 0]]
    assert made["point"].tolist() == [[3, 0, 0], [0.5, 0, 0], [0, 0, 0]]
    assert made["covariance"].shape == (3, 6)
    lost = columns.statistics({"point": np.array([[1.0], [np.nan], [3.0]])})[f"{columns.PREFIX}point"]
    assert (lost["mean"].tolist(), lost["count"].tolist()) == ([2.0], [3])
    for count, numbers in ((4, contacts.sample), (3, contacts.sample + 1)):
        with pytest.raises(InputError, match=rf"contacts\.csv: holds contacts of 3 samples.*episode has {count} rows"):
            columns.contact_columns(replace(contacts, sample=numbers), count, "contacts.csv")


def test_the_first_episode_has_a_column_for_each_name(tmp_path: Path) -> None:
    write_dataset(tmp_path, "v3.0", episodes=2)
    data = read_dataset(tmp_path)
    made = write_named(data, tmp_path / "named.parquet")
    named, rows = (pl.read_parquet(tmp_path / name) for name in ("named.parquet", data.episodes[0].file))
    lists = {"observation.state": NAMES, "action": NAMES[:2]}
    assert made == {f"{of}.{name}": f"{of}[{k}]" for of, names in lists.items() for k, name in enumerate(names)}
    assert set(named.columns) == {*rows.columns, *made} - lists.keys()
    for of, names in lists.items():
        np.testing.assert_array_equal(named[[f"{of}.{name}" for name in names]].to_numpy(), rows[of].to_numpy()[:60])
