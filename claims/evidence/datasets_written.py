"""LeRobot data sets of versions 2.0, 2.1 and 3.0, by their documented schemas: presses on a ball at known points."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

RADIUS, FPS = 0.02, 100.0
RIG = f"""
[surface]
kind = "sphere"
radius = {RADIUS}

[force_torque]
columns = "observation.state[2:8]"
noise = {{ force = 0.05, torque = 0.0005 }}
"""
NAMES = ["elbow.pos", "wrist.pos", "ft.fx", "ft.fy", "ft.fz", "ft.tx", "ft.ty", "ft.tz"]
USUAL = ("timestamp", "frame_index", "episode_index", "index", "task_index")
VERSION_2 = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VERSION_3 = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
A_FILE = 20  # episodes of a file of version 3


def write_dataset(folder: Path, version: str, episodes: int = 3, length: int = 60) -> np.ndarray:
    """Write a data set; returns the point that is pressed in each row, (n, 3), NaN where nothing is."""
    rng = np.random.default_rng(7)
    made = [_episode(rng, number, length + number % 5, version) for number in range(episodes)]
    frames = [frame for frame, _ in made]
    start = np.cumsum([0, *map(len, frames)])
    frames = [frame.with_columns(pl.col("index") + first) for frame, first in zip(frames, start.tolist(), strict=False)]
    features = {
        "observation.state": {"dtype": "float32", "shape": [8], "names": NAMES},
        "observation.tactile": {"dtype": "float32", "shape": [4, 6], "names": ["row", "column"]},
        "action": {"dtype": "float32", "shape": [2], "names": NAMES[:2]},
        **{
            name: {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1], "names": None}
            for name in USUAL
        },
    }
    info = {
        "codebase_version": version,
        "robot_type": None,
        "total_episodes": episodes,
        "total_frames": int(start[-1]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "fps": int(FPS),
        "splits": {"train": f"0:{episodes}"},
        "data_path": VERSION_3 if version == "v3.0" else VERSION_2,
        "video_path": None,
        "features": features,
    }
    _write(folder / "meta/info.json", json.dumps(info))
    _write(folder / "README.md", "A data set.")
    _write(folder / "videos/top/chunk-000/file-000.mp4", "not a real video")
    (_version_3 if version == "v3.0" else _version_2)(folder, frames, version)
    return np.concatenate([points for _, points in made])


def _episode(rng: np.random.Generator, number: int, length: int, version: str) -> tuple[pl.DataFrame, np.ndarray]:
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    point = RADIUS * normal
    force = -5.0 * normal + np.cross(normal, rng.normal(size=3))
    pressed = (np.arange(length) >= length // 3) & (np.arange(length) < 2 * length // 3)
    wrench = np.where(pressed[:, None], np.concatenate([force, np.cross(point, force)]), 0.0)
    wrench += rng.normal(size=(length, 6)) * np.repeat([0.05, 0.0005], 3)
    state = np.concatenate([rng.normal(size=(length, 2)), wrench], axis=1).astype(np.float32)
    frame = pl.DataFrame(
        {
            "observation.state": state,
            "observation.tactile": rng.normal(size=(length, 4, 6)).astype(np.float32),
            "action": state[:, :2],
            "timestamp": (np.arange(length) / FPS).astype(np.float32),
            "frame_index": np.arange(length),
            "episode_index": np.full(length, number),
            "index": np.arange(length),
            "task_index": np.zeros(length, dtype=np.int64),
        }
    )
    lists = {"observation.state": 1, "observation.tactile": 2, "action": 1}  # of version 2: of any length
    kinds = [pl.List(pl.Float32), pl.List(pl.List(pl.Float32))]
    loose = frame.with_columns(pl.col(name).cast(kinds[axes - 1]) for name, axes in lists.items())
    return frame if version == "v3.0" else loose, np.where(pressed[:, None], point, np.nan)


def _version_2(folder: Path, frames: Sequence[pl.DataFrame], version: str) -> None:
    for number, frame in enumerate(frames):
        _rows(folder / VERSION_2.format(episode_chunk=0, episode_index=number), frame)
    rows = [{"episode_index": k, "tasks": ["press"], "length": len(frame)} for k, frame in enumerate(frames)]
    _write(folder / "meta/episodes.jsonl", _lines(rows))
    _write(folder / "meta/tasks.jsonl", _lines([{"task_index": 0, "task": "press"}]))
    if version == "v2.0":
        _write(folder / "meta/stats.json", json.dumps(_statistics(pl.concat(frames))))
    else:
        each = [{"episode_index": k, "stats": _statistics(frame)} for k, frame in enumerate(frames)]
        _write(folder / "meta/episodes_stats.jsonl", _lines(each))


def _version_3(folder: Path, frames: Sequence[pl.DataFrame], version: str) -> None:
    start, rows = 0, list[dict[str, Any]]()
    for number, frame in enumerate(frames):
        statistics = {
            f"stats/{name}/{key}": value
            for name, values in _statistics(frame, quantiles=True).items()
            for key, value in values.items()
        }
        row = {"episode_index": number, "tasks": ["press"], "length": len(frame)}
        row |= {"data/chunk_index": 0, "data/file_index": number // A_FILE}
        row |= {"dataset_from_index": start, "dataset_to_index": start + len(frame), **statistics}
        rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        start += len(frame)
    for first in range(0, len(frames), A_FILE):
        path = VERSION_3.format(chunk_index=0, file_index=first // A_FILE)
        _rows(folder / path, pl.concat(frames[first : first + A_FILE]))
    _rows(folder / "meta/episodes/chunk-000/file-000.parquet", pl.DataFrame(rows))
    _write(folder / "meta/stats.json", json.dumps(_statistics(pl.concat(frames), quantiles=True)))
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": []}
    tasks = pl.DataFrame({"task_index": [0], "task": ["press"]})
    tasks.write_parquet(folder / "meta/tasks.parquet", metadata={"pandas": json.dumps(pandas)})


def _statistics(frame: pl.DataFrame, *, quantiles: bool = False) -> dict[str, dict[str, Any]]:
    shares = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99} if quantiles else {}
    found = dict[str, dict[str, Any]]()
    for name in frame.columns:
        values = np.array(frame[name].to_list(), dtype=np.float64).reshape(len(frame), -1)
        if frame[name].dtype == pl.List(pl.List(pl.Float32)) or name == "observation.tactile":
            continue
        found[name] = {key: getattr(values, key)(axis=0).tolist() for key in ("min", "max", "mean", "std")}
        found[name] |= {"count": [len(values)]}
        found[name] |= {key: np.quantile(values, share, axis=0).tolist() for key, share in shares.items()}
    return found


def _rows(path: Path, frame: pl.DataFrame) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    frame.write_parquet(path, metadata={"huggingface": '{"info": {"features": {}}}'})


def _lines(rows: Sequence[Mapping[str, Any]]) -> str:
    return "".join(f"{json.dumps(row)}\n" for row in rows)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
