"""Read what a LeRobot data set states of itself: its features, and where the rows of each episode are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import polars as pl

from palpate.errors import InputError
from palpate.files.inputs import open_input
from palpate.files.logs.parquet import reading_parquet, sample_shapes, scan_rows

INFO = Path("meta/info.json")
EPISODES = "meta/episodes/*/*.parquet"  # of version 3
_TIME = "timestamp"
_AGAIN = "Copy the data set again."


@dataclass(frozen=True)
class Episode:
    """An episode of a data set.

    Attributes:
        index: its number.
        file: Parquet file with its rows, relative to the data set.
        length: number of its rows.
    """

    index: int
    file: Path
    length: int


@dataclass(frozen=True)
class Dataset:
    """A LeRobot data set.

    Attributes:
        root: its folder.
        info: contents of meta/info.json.
        episodes: its episodes, by number.
    """

    root: Path
    info: Mapping[str, Any]
    episodes: tuple[Episode, ...]

    @property
    def features(self) -> Mapping[str, Any]:
        """Name of each column or video -> dict of its dtype, shape and names."""
        return self.info["features"]

    @property
    def time(self) -> dict[str, Any]:
        """The keys of a rig's [time], a dict: the column of the times, or, where there is none, the rate."""
        return {"column": _TIME, "unit": "s"} if _TIME in self.features else {"rate": float(self.info["fps"])}

    def require_rows(self, episode: Episode) -> None:
        """Check that an episode's file has its rows, and lists of numbers as long as the features state.

        Raises:
            InputError: it has not, or cannot be read.
        """
        path = self.root / episode.file
        with reading_parquet(path):
            rows = scan_rows(path, episode.index)
            count, shapes = int(rows.select(pl.len()).collect().item()), sample_shapes(rows)
        if count != episode.length:
            what = f"has {count} rows of episode {episode.index}, but the folder meta states {episode.length}."
            raise InputError(what, where=str(path), hint=_AGAIN)
        for name, shape in shapes.items():
            stated = tuple(self.features.get(name, {}).get("shape", shape))
            if shape not in ((), stated):
                what = f"a row of {name!r} has {_times(shape)} numbers, but {INFO} states {_times(stated)}."
                raise InputError(what, where=str(path), hint="Remove this episode, or write its rows as the others.")


def _times(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def is_dataset(folder: Path) -> bool:
    """Return whether a folder is a LeRobot data set."""
    return (folder / INFO).is_file()


def read_dataset(root: Path) -> Dataset:
    """Return the `Dataset` in a folder.

    Raises:
        InputError: a file of its folder meta is missing, cannot be read or lacks something, its version is not known,
            or it has no episodes.
    """
    info = _info(root / INFO)
    listed = _of_version_3 if info["codebase_version"].startswith("v3") else _of_version_2
    try:
        episodes = tuple(sorted(listed(root, info), key=lambda episode: episode.index))
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as problem:
        what = f"does not state where the rows of each episode are ({' '.join(repr(problem).split())})."
        raise InputError(what, where=str(root / "meta"), hint=_AGAIN) from problem
    if not episodes:
        raise InputError("has no episodes.", where=str(root))
    if outside := [each.file for each in episodes if each.file.is_absolute() or ".." in each.file.parts]:
        raise InputError(f"names a file outside of its folder, {str(outside[0])!r}.", where=str(root / INFO))
    return Dataset(root, info, episodes)


def _info(path: Path) -> dict[str, Any]:
    """Return the contents of meta/info.json, with version, fps and features as they must be."""
    info = read_json(path)
    version, fps, features = (info.get(key) for key in ("codebase_version", "fps", "features"))
    if not re.match(r"v[23]\.\d", str(version)):
        what = f"is a data set of LeRobot's version {version!r}; known are v2.0, v2.1 and v3.0."
        raise InputError(what, where=str(path), hint="Convert it with LeRobot's own tools first.")
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not fps > 0:
        raise InputError(f"states no rate: fps is {fps!r}.", where=str(path), hint="Write the frames a second there.")
    listed = list(cast("dict[str, object]", features).values()) if isinstance(features, dict) else [None]
    if not all(isinstance(each, dict) for each in listed):
        raise InputError("states no features.", where=str(path), hint=_AGAIN)
    return info


def _of_version_2(root: Path, info: Mapping[str, Any]) -> Iterator[Episode]:
    """Yield the episodes of version 2, which have a file each."""
    pattern = info.get("data_path", "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet")
    for row in json_lines(root / "meta" / "episodes.jsonl"):
        index = int(row["episode_index"])
        file = pattern.format(episode_chunk=index // int(info.get("chunks_size", 1000)), episode_index=index)
        yield Episode(index, Path(file), int(row["length"]))


def _of_version_3(root: Path, info: Mapping[str, Any]) -> Iterator[Episode]:
    """Yield the episodes of version 3, of which a file has several."""
    pattern = info.get("data_path", "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet")
    columns = ["episode_index", "data/chunk_index", "data/file_index", "length"]
    for path in sorted(root.glob(EPISODES)):
        with reading_parquet(path):
            rows = pl.scan_parquet(path, glob=False).select(columns).collect()
        for index, chunk, file, length in rows.iter_rows():
            yield Episode(index, Path(pattern.format(chunk_index=chunk, file_index=file)), length)


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        InputError: the file cannot be read, or holds none.
    """
    with open_input(path) as file:
        return _object(file.read(), path)


def json_lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects in a file with one in each line.

    Raises:
        InputError: the file cannot be read, or a line holds none.
    """
    with open_input(path) as file:
        return [_object(line, path) for line in file if line.strip()]


def _object(raw: bytes, path: Path) -> dict[str, Any]:
    try:
        made: object = json.loads(raw)
    except ValueError as problem:  # of the encoding, too
        raise InputError(f"is not JSON ({problem}).", where=str(path), hint=_AGAIN) from problem
    if not isinstance(made, dict):
        raise InputError("holds no JSON object.", where=str(path), hint=_AGAIN)
    return cast("dict[str, Any]", made)
