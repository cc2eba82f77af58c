"""LeRobot data sets labelled by `palpate batch`: the same rows, contacts where they are, killed and resumed.

Where PALPATE_LEROBOT names Pythons that have the library, such as a 0.3 for version 2.1 and a later one for version 3.0
(`v2.1=PYTHON:v3.0=PYTHON`), it opens each copy and its original.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

from claims.evidence.datasets_written import RIG, write_dataset
from claims.row import Row
from palpate.contact.estimate import CHI2_95

PREFIX = "observation.contact."
OPEN = """
import sys
import numpy as np, torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
first, copy = (LeRobotDataset("palpate/made", root=root) for root in sys.argv[1:])
new = sorted(set(copy.features) - set(first.features))
wrong = 0
for k in range(len(first)):
    one, other = first[k], copy[k]
    wrong += set(other) - set(one) != set(new) or any(
        not torch.equal(one[name], other[name]) if torch.is_tensor(one[name]) else one[name] != other[name]
        for name in one
    )
for name in new:
    values = np.stack([np.atleast_1d(copy[k][name].numpy()) for k in range(len(copy))]).astype(float)
    kept = copy.meta.stats[name]
    for key in ("mean", "std", "min", "max"):
        wrong += not np.allclose(kept[key], getattr(values, key)(axis=0), rtol=1e-4, atol=1e-9)
batch = next(iter(torch.utils.data.DataLoader(copy, batch_size=8)))
print(len(first), len(copy), copy.num_episodes, len(new), wrong, tuple(batch["observation.contact.point"].shape))
"""


def rows(small: bool) -> Iterator[Row]:
    """Small: 3 episodes in place of 50, of one version."""
    for version in ("v3.0",) if small else ("v2.1", "v3.0"):
        with TemporaryDirectory() as scratch:
            folder, count = Path(scratch), 3 if small else 50
            (folder / "rig.toml").write_text(RIG)
            points = write_dataset(folder / "data_set", version, count)
            _batch(folder, "plain").wait()
            yield _killed(folder, version, count, small=small)
            yield _rows_equal(folder, version, count)
            yield from _right(folder, version, points)
            yield _opened(folder, version, count)


def _batch(folder: Path, out: str) -> subprocess.Popen[bytes]:
    words = ["batch", "data_set", "--rig", "rig.toml", "-o", out, "--workers", "2"]
    nowhere = subprocess.DEVNULL
    call = [sys.executable, "-m", "palpate", *words]
    return subprocess.Popen(call, cwd=folder, stdout=nowhere, stderr=nowhere, start_new_session=True)


def _killed(folder: Path, version: str, count: int, *, small: bool) -> Row:
    """Twice by the signal that nothing can catch: after half of the episodes, and (alone in small) while it copies."""
    out, codes = folder / "killed", list[int]()
    for there in (lambda: _lines(out) > count // 2, lambda: (out / "data").exists())[small:]:
        process = _batch(folder, out.name)
        while process.poll() is None and not there():
            time.sleep(0.002)
        os.killpg(process.pid, signal.SIGKILL)
        codes.append(process.wait())
    torn = (out / "meta/info.json").exists()
    code = _batch(folder, out.name).wait()
    same = _files(out) == _files(folder / "plain") and not torn
    what = f"{count} episodes of {version}, killed after half of them and while the copy is written, resumed"
    got = f"exit {code}, {'the same' if same else 'OTHER'} bits; killed {codes.count(-9)} times"
    got += ", with half a copy that opens" if torn else ""
    return Row(what, "exit 0, the same bits as at once", got, code == 0 and same)


def _lines(out: Path) -> int:
    kept = out / "batch.jsonl"
    return kept.read_bytes().count(b"\n") - 1 if kept.exists() else 0


def _files(out: Path) -> dict[str, bytes]:
    """Contents of all files but the page and the list of what is done, whose order is that of the workers."""
    files = (file for file in sorted(out.rglob("*")) if file.is_file() and not file.name.startswith("batch."))
    return {str(file.relative_to(out)): file.read_bytes() for file in files}


def _table(root: Path) -> pl.DataFrame:
    return pl.concat([pl.read_parquet(file) for file in sorted((root / "data").rglob("*.parquet"))])


def _rows_equal(folder: Path, version: str, count: int) -> Row:
    first, copy = _table(folder / "data_set"), _table(folder / "plain")
    new = [name for name in copy.columns if name.startswith(PREFIX)]
    same = copy.drop(new).equals(first.cast(copy.drop(new).schema))
    got = f"{len(copy):,} of {len(first):,} rows, {len(new)} new columns, the others {'equal' if same else 'OTHER'}"
    return Row(f"{count} episodes of {version}: rows of the copy", "all, equal", got, same and len(new) == 5)


def _right(folder: Path, version: str, points: np.ndarray) -> Iterator[Row]:
    """The points that are pressed are known, and so are the rows in which nothing is."""
    copy = _table(folder / "plain").sort("index")
    found = copy[f"{PREFIX}count"].to_numpy() > 0
    point, upper = (np.array(copy[PREFIX + name].to_list(), dtype=float) for name in ("point", "covariance"))
    pressed = np.isfinite(points[:, 0])
    share = float(np.mean(found == pressed))
    what = f"{version}: rows with a contact where one is, none where none is"
    yield Row(what, ">= 0.99", f"{share:.4f}", share >= 0.99)
    both = found & pressed
    error = point[both] - points[both]
    covariance = upper[both][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    inverse = np.linalg.pinv(covariance, rcond=1e-3, hermitian=True)
    inside = float(np.mean(np.einsum("ni,nij,nj->n", error, inverse, error) <= CHI2_95))
    got = f"{inside:.3f}; {1e3 * np.median(np.linalg.norm(error, axis=1)):.2f} mm at the median"
    yield Row(f"{version}: points within their 95 % ellipse by the columns", "0.90 to 0.99", got, 0.9 <= inside <= 0.99)


def _opened(folder: Path, version: str, count: int) -> Row:
    what, target = f"{count} episodes of {version}, opened by LeRobot's library", "all rows, equal; statistics right"
    given = (text.partition("=") for text in os.environ.get("PALPATE_LEROBOT", "").split(os.pathsep))
    python = {name: path for name, _, path in given}.get(version)
    if python is None:
        return Row(what, target, "skipped: PALPATE_LEROBOT names no Python for it")
    call = [python, "-c", OPEN, str(folder / "data_set"), str(folder / "plain")]
    done = subprocess.run(
        call, capture_output=True, text=True, check=False, env={**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    )
    words = (done.stdout.splitlines() or [done.stderr[-300:]])[-1]
    first, copied, episodes, new, wrong = map(int, words.split(" (")[0].split()) if not done.returncode else [0] * 5
    got = f"{copied:,} of {first:,} rows, {episodes} episodes, {new} columns, {wrong} wrong"
    right = first > 0 and (copied, episodes, new, wrong) == (first, count, 5, 0)
    return Row(what, target, words if done.returncode else got, right)
