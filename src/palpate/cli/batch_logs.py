"""Find the logs of a batch by files, folders and patterns, and name their outputs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from glob import glob, has_magic
from pathlib import Path

from palpate.errors import InputError
from palpate.files.atomic import PART
from palpate.files.logs.frame_folder import holds_frames
from palpate.files.logs.video import VIDEOS

LOGS = (".csv", ".tsv", ".txt", ".parquet", ".npy", ".npz", ".mcap", ".bag", ".db3", *VIDEOS)  # of a folder's files


def logs_of(given: Sequence[Path], output: Path) -> list[Path]:
    """Return every log once, in the given order; those in and below a folder by name.

    A folder that is a ROS 2 bag or holds frames is one log.

    Args:
        given: files, folders and patterns (`*`, `?`, `[...]`, `**`).
        output: folder of the results, which is skipped.

    Raises:
        InputError: a file does not exist, or a folder or pattern gives no log.
        OSError: a folder cannot be read.
    """
    found = dict[Path, Path]()
    for path in given:
        logs = list(_expanded(path, output.resolve()))
        if not logs:
            what = "contains no log" if path.is_dir() else "matches no file"
            raise InputError(f"{what}.", where=str(path), hint=f"Give logs that end in {', '.join(LOGS)}.")
        found |= {log.resolve(): log for log in logs if log.resolve() not in found}
    return list(found.values())


def names_of(logs: Sequence[Path], known: Mapping[Path, str]) -> dict[Path, str]:
    """Return log -> name of its output without a suffix: the log's name, after its folders where two are alike.

    Args:
        logs: logs of this batch.
        known: resolved path of a log -> name of its output in earlier runs. These stay; the others are named as if all
            were new.
    """
    names = {log: known[log.resolve()] for log in logs if log.resolve() in known}
    taken, unnamed = {name.lower() for name in known.values()}, [log for log in logs if log not in names]
    others = set(known) - {log.resolve() for log in unnamed}  # count as if they were not named yet
    for depth in range(max((len(log.resolve().parts) for log in unnamed), default=0)):
        called = {log: _called(log.resolve(), depth) for log in [*unnamed, *others]}
        count = Counter(name.lower() for name in called.values())
        unique = {log: called[log] for log in unnamed if count[called[log].lower()] == 1}
        settled = {log: name for log, name in unique.items() if name.lower() not in taken}
        names |= settled
        taken |= {name.lower() for name in settled.values()}
        unnamed = [log for log in unnamed if log not in settled]
    for log in unnamed:  # the same but for the suffix, or for its letters' case
        name = next(name for k in range(1, len(logs) + 2) if (name := f"{log.stem}-{k}").lower() not in taken)
        names[log] = name
        taken.add(name.lower())
    return {log: names[log] for log in logs}


def _called(log: Path, depth: int) -> str:
    """Return the log's name after `depth` of its folders."""
    return "-".join([*log.parts[-1 - depth : -1], log.stem]).replace("/", "")


def _expanded(path: Path, output: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from [path] if _is_log(path) else _below(path, output)
    elif path.exists():
        yield path
    elif not has_magic(str(path)):
        raise InputError("the file does not exist.", where=str(path))
    else:
        for each in map(Path, sorted(glob(str(path), recursive=True))):
            if output not in (each.resolve(), *each.resolve().parents):
                yield from _expanded(each, output) if each.is_dir() else [each]


def _below(folder: Path, output: Path) -> Iterator[Path]:
    """Yield the logs in a folder and in the folders below it."""
    if folder.resolve() == output:
        return
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.suffix == PART:
            continue
        if path.is_dir():
            yield from [path] if _is_log(path) else _below(path, output)
        elif path.suffix.lower() in LOGS:
            yield path


def _is_log(folder: Path) -> bool:
    """Return whether the folder is a ROS 2 bag or a folder of frames."""
    return (folder / "metadata.yaml").exists() or holds_frames(folder)
