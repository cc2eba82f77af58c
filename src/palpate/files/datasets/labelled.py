"""Write a copy of a data set whose rows have the contacts that were found in them as further columns."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import polars as pl

from palpate.errors import InputError
from palpate.files.atomic import PART, replacing, write_text, writing
from palpate.files.contacts import read_contacts
from palpate.files.datasets.columns import PREFIX, contact_columns, contact_features, joined, statistics
from palpate.files.datasets.dataset import EPISODES, INFO, Dataset, Episode, json_lines, read_json
from palpate.files.logs.parquet import EPISODE, reading_parquet

Statistics = dict[str, dict[str, np.ndarray]]
_LINKED = ("videos", "images")  # folders of files that nobody edits
_USUAL = ("min", "max", "mean", "std", "count")
_STATISTICS, _BY_EPISODE = Path("meta/stats.json"), Path("meta/episodes_stats.jsonl")
_ARROW, _OTHER = b"ARROW:schema", b"polars:arrow"  # keys in a Parquet file's index, of one length


def write_labelled(data: Dataset, contacts: Mapping[int, Path], output: Path, frame: str) -> None:
    """Write a copy of a data set with the contacts in each row as columns, which LeRobot opens as the original.

    Videos and images are links to the same files. Until all else is there, the copy has no meta/info.json.

    Args:
        data: the data set.
        contacts: number of each episode -> file of its contacts, of one sample for each row.
        output: folder, which exists.
        frame: coordinate frame of the contacts.

    Raises:
        InputError: the data set has such columns, a file cannot be read or written, contacts are of other rows, or the
            folder has rows of another data set.
    """
    if taken := [name for name in data.features if name.startswith(PREFIX)]:
        hint = "Give the data set that it was made from."
        raise InputError(f"has a column {taken[0]!r} already.", where=str(data.root), hint=hint)
    rows = {output / each.file for each in data.episodes}
    if others := [path for path in sorted((output / "data").rglob("*.parquet")) if path not in rows]:
        hint = "Name another folder with -o FOLDER."
        raise InputError("is of another data set, which would be mixed with this one.", where=str(others[0]), hint=hint)
    with writing(output):
        (output / INFO).unlink(missing_ok=True)
        for unfinished in list(output.rglob(f".*{PART}")):  # of a run that was killed
            unfinished.unlink()
        _copy(data, output)
    found = dict[int, Statistics]()
    for file, episodes in groupby(sorted(data.episodes, key=lambda each: each.file), key=lambda each: each.file):
        found |= _label(data.root / file, {each.index: each for each in episodes}, contacts, output / file)
    try:
        _write_statistics(data.root, dict(sorted(found.items())), output)
    except (KeyError, TypeError, AttributeError) as problem:
        what = f"does not hold the statistics of each episode, as LeRobot writes them ({problem!r})."
        raise InputError(what, where=str(data.root / "meta"), hint="Copy the data set again.") from problem
    features = {**data.features, **contact_features(frame)}
    _write_json(output / INFO, {**data.info, "features": features})


def _copy(data: Dataset, output: Path) -> None:
    """Copy or link all files but those of the rows and hidden ones."""
    rows = {each.file for each in data.episodes} | {INFO}
    for folder, folders, names in os.walk(data.root):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        inside = Path(folder).relative_to(data.root)
        for file in (inside / name for name in sorted(names) if not name.startswith(".")):
            if file not in rows:
                _place(data.root / file, output / file, link=file.parts[0] in _LINKED)


def _place(source: Path, target: Path, *, link: bool) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if link:
        target.unlink(missing_ok=True)
        try:
            target.hardlink_to(source.resolve())
        except OSError:  # of another file system, or one without links
            pass
        else:
            return
    with replacing(target) as temporary:
        shutil.copyfile(source, temporary)


def _label(
    path: Path, episodes: Mapping[int, Episode], contacts: Mapping[int, Path], target: Path
) -> dict[int, Statistics]:
    """Write the rows of a file with their contacts; return the statistics of each episode in it."""
    with reading_parquet(path):
        rows, kept = pl.read_parquet(path, glob=False), pl.read_parquet_metadata(path)
    whose = rows[EPISODE].to_numpy()
    if not np.isin(whose, list(episodes)).all():
        raise InputError("has rows of an episode that the folder meta does not list.", where=str(path))
    found, columns = dict[int, Statistics](), dict[str, np.ndarray]()
    for index in episodes:
        here = np.flatnonzero(whose == index)
        made = contact_columns(read_contacts(contacts[index]), len(here), str(contacts[index]))
        for name, values in made.items():
            columns.setdefault(name, np.zeros((len(rows), values.shape[1]), values.dtype))[here] = values
        found[index] = statistics(made)
    _write_rows(target, rows.with_columns(_series(*each) for each in columns.items()), kept)
    return found


def _series(name: str, values: np.ndarray) -> pl.Series:
    """Return a column as LeRobot stores it: plain numbers for one a row, else lists of one length."""
    return pl.Series(f"{PREFIX}{name}", values[:, 0] if values.shape[1] == 1 else values)


def _write_rows(path: Path, rows: pl.DataFrame, kept: Mapping[str, str]) -> None:
    """Write a Parquet file with the metadata of the one that it was read from.

    polars notes Arrow's large lists and texts in the file, in which LeRobot's reader does not see its images. Without
    this note they are read as Parquet's own types.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {key: value for key, value in kept.items() if key != _ARROW.decode()}
    with replacing(path) as temporary:
        rows.write_parquet(temporary, compression="snappy", metadata=metadata)
        with temporary.open("r+b") as file:
            _forget_arrow(file)


def _forget_arrow(file: BinaryIO) -> None:
    """Rename the key of Arrow's types in a Parquet file's index, which is followed by its length and four letters."""
    file.seek(-8, os.SEEK_END)
    length = int.from_bytes(file.read(4), "little")
    file.seek(-8 - length, os.SEEK_END)
    index = file.read(length)
    file.seek(-8 - length, os.SEEK_END)
    file.write(index.replace(_ARROW, _OTHER))


def _write_statistics(root: Path, found: Mapping[int, Statistics], output: Path) -> None:
    """Write the files of statistics with those of the contacts, as far as the data set has them."""
    if (root / _STATISTICS).is_file():
        old = read_json(root / _STATISTICS)
        _write_json(output / _STATISTICS, {**old, **_alike(old, joined(list(found.values())))})
    if (root / _BY_EPISODE).is_file():
        lines = json_lines(root / _BY_EPISODE)
        for line in lines:
            line["stats"] |= _alike(line["stats"], found[line["episode_index"]])
        write_text(output / _BY_EPISODE, "".join(f"{json.dumps(line, ensure_ascii=False)}\n" for line in lines))
    for path in sorted(root.glob(EPISODES)):
        with reading_parquet(path):
            rows, kept = pl.read_parquet(path, glob=False), pl.read_parquet_metadata(path)
        keys = {name.rpartition("/")[2]: None for name in rows.columns if name.startswith("stats/")}
        made = [_alike({"": keys}, found[index]) for index in rows[EPISODE]] if keys else []
        columns = [
            pl.Series(f"stats/{name}/{key}", [each[name][key] for each in made])
            for name, values in (made[0] if made else {}).items()
            for key in values
        ]
        _write_rows(output / path.relative_to(root), rows.with_columns(columns), kept)


def _alike(old: Mapping[str, Mapping[str, Any]], new: Statistics) -> dict[str, dict[str, list[Any]]]:
    """Return new statistics as lists, those that the old ones have of another feature."""
    there = next(iter(old.values()), dict.fromkeys(_USUAL))
    return {name: {key: each.tolist() for key, each in values.items() if key in there} for name, values in new.items()}


def _write_json(path: Path, value: object) -> None:
    write_text(path, f"{json.dumps(value, indent=4, ensure_ascii=False)}\n")
