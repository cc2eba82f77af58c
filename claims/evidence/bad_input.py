"""Bad input: each case is given to the command, which must say a sentence, exit accordingly and lose no row.

What people do wrong, each by name. `claims.evidence.mutated` has files that were mutated at random.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
import trimesh

from claims.command import cli, must
from claims.row import Row
from palpate_lab.simulation import simulate_session, write_session


@dataclass(frozen=True)
class Case:
    """What is spoilt in a good session, the exit code due, and words that the answer must hold."""

    name: str
    spoil: Callable[[Path], None]
    code: int
    words: tuple[str, ...]


def rows(small: bool) -> Iterator[Row]:
    """The cases are the same small and full; small spoils a shorter session."""
    with TemporaryDirectory() as scratch:
        good = Path(scratch) / "good"
        write_session(simulate_session(touches=2 if small else 3, facets=320), good)
        must("calibrate", "payload", good / "free_motion.csv", "-o", good / "payload.toml")
        for number, case in enumerate(CASES):
            folder = Path(scratch) / str(number)
            folder.mkdir()
            for file in good.iterdir():
                (folder / file.name).write_bytes(file.read_bytes())
            case.spoil(folder)
            yield _judge(case, folder)


def _judge(case: Case, folder: Path) -> Row:
    log, out = folder / "touches.csv", folder / "contacts.csv"
    code, _, _, text = cli("estimate", log, "--rig", folder / "rig.toml", "-o", out)
    said = [line.strip() for line in text.replace(f"{folder}/", "").splitlines() if line.strip()]
    held = [line for line in said if any(word in line.lower() for word in case.words)]
    held.sort(key=lambda line: not line.startswith(("warning:", "palpate:")))
    kept, got = True, f"exit {code}; "
    if out.exists():
        samples, written = pl.read_csv(log, infer_schema=False).height, pl.read_csv(out, infer_schema=False)
        kept = written["sample"].n_unique() == samples
        got = f"exit {code}, {samples} rows in and {written['sample'].n_unique()} out; "
    got += held[0] if held else "nothing said: " + " / ".join(said[-3:])
    due = "exit 0 or 4, said, all rows" if case.code == 0 else f"exit {case.code}, said"
    return Row(
        case.name, due, got, code in (case.code, case.code or 4) and bool(held) and kept and "Traceback" not in text
    )


# --- the spoiling


def _log(change: Callable[[pl.DataFrame], pl.DataFrame]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "touches.csv"
        change(pl.read_csv(path)).write_csv(path)

    return spoil


def _set(values: dict[str, object], some: slice) -> Callable[[Path], None]:
    def change(table: pl.DataFrame) -> pl.DataFrame:
        rows = pl.Series(range(table.height)).is_in(list(range(*some.indices(table.height))))
        return table.with_columns(
            pl.when(rows).then(pl.lit(value, dtype=pl.Float64)).otherwise(pl.col(name)).alias(name)
            for name, value in values.items()
        )

    return _log(change)


def _contact(wrench: dict[str, float]) -> Callable[[Path], None]:
    """Every reading becomes this contact at the surface's frame's origin in the sensor, no payload."""

    def spoil(folder: Path) -> None:
        _log(lambda table: table.with_columns(pl.lit(value).alias(name) for name, value in wrench.items()))(folder)
        _rig("payload = ", "# payload = ")(folder)

    return spoil


def _rig(old: str, new: str) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "rig.toml"
        path.write_text(path.read_text().replace(old, new))

    return spoil


def _mesh(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Another list of triangles (f, 3, 3) [mm]."""

    def spoil(folder: Path) -> None:
        path = folder / "probe.stl"
        triangles = change(np.array(trimesh.load_mesh(path, process=False).triangles))
        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=False).export(path)

    return spoil


def _empty(folder: Path) -> None:
    (folder / "touches.csv").write_text("")


def _no_mesh(folder: Path) -> None:
    (folder / "probe.stl").write_bytes(bytes(84))


def _plane_force(folder: Path) -> None:
    _contact({"fx": 5.0, "fy": 0.0, "fz": 0.0, "tx": 0.0, "ty": 0.0, "tz": 0.0})(folder)
    _rig('mesh = "probe.stl"', 'kind = "plane"')(folder)
    _rig('unit = "mm"  ', "#")(folder)


def _newton_millimetres(folder: Path) -> None:
    _rig("range = ", "# range = ")(folder)
    _beyond_range(folder)


def _beyond_range(folder: Path) -> None:
    for name in ("touches.csv", "free_motion.csv"):  # the payload too, so that only the unit is wrong
        pl.read_csv(folder / name).with_columns(pl.col("tx", "ty", "tz") * 1e3).write_csv(folder / name)
    cli("calibrate", "payload", folder / "free_motion.csv", "-o", folder / "payload.toml")


def _rested(table: pl.DataFrame, rows: slice, change: Callable[[pl.DataFrame], pl.DataFrame]) -> pl.DataFrame:
    begin, end, _ = rows.indices(table.height)
    return pl.concat([table[:begin], change(table[begin:end]), table[end:]])


CASES = (
    Case("empty log", _empty, 1, ("empty", "no ")),
    Case("log with a header and no rows", _log(lambda table: table[:0]), 1, ("no ", "empty")),
    Case("missing column", _log(lambda table: table.drop("tz")), 1, ("tz",)),
    Case("NaN", _set({"fx": float("nan")}, slice(10, 20)), 0, ("nan", "invalid")),
    Case("infinity", _set({"ty": float("inf")}, slice(10, 20)), 0, ("inf",)),
    Case("saturation", _set({"fz": 250.0}, slice(10, 20)), 0, ("saturated",)),
    Case("unsorted times", _log(lambda t: _rested(t, slice(50, 90), lambda part: part.reverse())), 0, ("backwards",)),
    Case("repeated times", _set({"time": 0.1}, slice(20, 30)), 0, ("repeat",)),
    Case("a gap", _log(lambda t: pl.concat([t[:100], t[300:]])), 0, ("gap",)),
    Case("torque in N mm declared as N m", _newton_millimetres, 0, ("units of the torque",)),
    Case("the same, the rig stating the sensor's range", _beyond_range, 0, ("unit",)),
    Case("mesh in mm declared as m", _rig('unit = "mm"', 'unit = "m"'), 1, ("unit",)),
    Case("open mesh", _mesh(lambda triangles: triangles[20:]), 0, ("not closed",)),
    Case("zero-area facets", _mesh(lambda t: np.concatenate([t, t[:9, [0, 1, 1]]])), 0, ("without area",)),
    Case("flipped normals", _mesh(lambda triangles: triangles[:, ::-1]), 0, ("turned",)),
    Case("some flipped facets", _mesh(lambda t: np.concatenate([t[:50, ::-1], t[50:]])), 0, ("turned",)),
    Case("empty mesh", _no_mesh, 1, ("mesh", "facet")),
    Case("misspelt rig key", _rig("friction = ", "fricton = "), 1, ("friction",)),
    Case("zero force", _contact(dict.fromkeys(("fx", "fy", "fz", "tx", "ty", "tz"), 0.0)), 0, ("no_contact",)),
    Case("force in the surface's plane", _plane_force, 0, ("off_surface", "implausible")),
)
