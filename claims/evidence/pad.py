"""A real pad on a real sensor, through `palpate estimate` with a rig file.

The driver swapped y and z of force and torque (a reflection), so the rig says axes x, z, y and left-handed. The pad's
top is the plane y = 8 mm of the sensor; the path's truth is in the pad's frame, x = 0.06 + px, y = 0.142 - pz.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

from claims.command import must
from claims.evidence.covariance import CHI2_95
from claims.row import Row, shared, skipped

PRESSED = 1.5  # N
_FILES = "--rig {0}/rig.toml --marks {0}/marks.csv -o {0}/new.toml"
RIG = """\
[surface]
kind = "plane"
point = [0, 0.008, 0]
normal = [0, 1, 0]
half_width = 0.2

[time]
column = "timestamp"

[force_torque]
columns = ["ft_wrench_force_x", "ft_wrench_force_y", "ft_wrench_force_z",
           "ft_wrench_torque_x", "ft_wrench_torque_y", "ft_wrench_torque_z"]
axes = ["x", "z", "y"]
left_handed = true

[estimate]
method = "{method}"
contact = {{ on = 0.5, off = 0.3 }}
"""


def rows(small: bool) -> Iterator[Row]:
    """Some runs of the commands; small leaves out the calibrations with a mark a row."""
    folder = shared()
    if folder is None:
        yield from skipped("the path and the two weights", "")
        return
    with TemporaryDirectory() as scratch:
        yield from _path(folder / "data/pad/trajectory_panda_ft_opti.csv", Path(scratch))
        yield from _ellipses(folder / "data/pad/trajectory_panda_ft_opti.csv", Path(scratch), small)
        yield from _weights(folder / "data/pad/data_two_payloads_ft.csv", Path(scratch))


def _estimated(log: Path, scratch: Path, method: str) -> pl.DataFrame:
    """contacts.csv, with the located point in the pad's frame as x, y [m]."""
    rig, out = scratch / "rig.toml", scratch / "contacts.csv"
    rig.write_text(RIG.format(method=method))
    must("estimate", log, "--rig", rig, "-o", out)
    table = pl.read_csv(out, infer_schema_length=None)
    return table.with_columns((0.06 + pl.col("px")).alias("x"), (0.142 - pl.col("pz")).alias("y"))


def _path(log: Path, scratch: Path) -> Iterator[Row]:
    truth = pl.read_csv(log)
    pressed = (truth["ft_wrench_force_z"].abs() > PRESSED).to_numpy()
    ought = truth.select("opti_x", "opti_y").to_numpy()[pressed]
    theirs = np.linalg.norm(truth.select("ft_x", "ft_y").to_numpy()[pressed] - ought, axis=1).mean()
    half = len(ought) // 2
    for method in ("soft_finger", "wrench_axis"):
        table = _estimated(log, scratch, method)
        got = table.select("x", "y").to_numpy()[pressed]
        answered = table["status"].is_in(["contact", "ambiguous"]).to_numpy()[pressed]
        off = got - ought
        mean = np.linalg.norm(off, axis=1).mean()
        judged = []
        for fit, judge in ((slice(0, half), slice(half, None)), (slice(half, None), slice(0, half))):
            judged.append(np.linalg.norm(off[judge] - off[fit].mean(axis=0), axis=1).mean())
        met, name = method == "soft_finger", method.replace("_", " ")
        text = f"{1e3 * mean:.2f} mm over {len(ought):,} rows, {answered.mean():.1%} answered"
        text += f" (the authors' {1e3 * theirs:.2f})"
        passed = bool(mean <= 3.9e-3 and answered.all()) if met else None
        yield Row(f"{name}, all rows with |Fz| > 1.5 N, as recorded: mean error", "<= 3.9 mm", text, passed)
        text = ", ".join(f"{1e3 * value:.2f}" for value in judged) + " mm (judged on the second half, on the first)"
        what = f"{name}, one constant offset fitted on one half, judged on the other"
        yield Row(what, "<= 3.4 mm", text, max(judged) <= 3.4e-3 if met else None)


def _ellipses(log: Path, scratch: Path, small: bool) -> Iterator[Row]:
    """The mounting calibrated on one half of the path, its ellipses judged on the other: marks of 0.1 s, and of a row.

    The path's x and y are -z and x of the plane, so that a mark is (x - 0.06, 0.008, 0.142 - y).
    """
    truth = pl.read_csv(log)
    pressed = np.flatnonzero((truth["ft_wrench_force_z"].abs() > PRESSED).to_numpy())
    x, y = truth.select("opti_x", "opti_y").to_numpy().T
    points = np.column_stack([x - 0.06, np.full(len(x), 0.008), 0.142 - y])
    time, half = truth["timestamp"].to_numpy(), len(pressed) // 2
    for rows, called in ((8, "of 0.1 s each"), (1, "one a row"))[: 1 if small else 2]:
        held = list[str]()
        for fit, judge in ((pressed[:half], pressed[half:]), (pressed[half:], pressed[:half])):
            parts = np.split(fit[: len(fit) // rows * rows], len(fit) // rows)
            at = np.array([points[part].mean(axis=0) for part in parts]).T
            ends = {"start": [time[part[0]] for part in parts], "end": [time[part[-1]] for part in parts]}
            pl.DataFrame({**ends, "px": at[0], "py": at[1], "pz": at[2]}).write_csv(scratch / "marks.csv")
            (scratch / "rig.toml").write_text(RIG.format(method="soft_finger"))
            must("calibrate", "mounting", log, *_FILES.format(scratch).split())
            must("estimate", log, "--rig", scratch / "new.toml", "-o", scratch / "contacts.csv")
            table = pl.read_csv(scratch / "contacts.csv", infer_schema_length=None)[judge]
            off = table.select("px", "pz").to_numpy() - points[judge][:, [0, 2]]
            spread = table.select("var_xx", "var_xz", "var_zz").to_numpy()[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
            square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off)
            size = np.sqrt(np.median(np.linalg.eigvalsh(spread).mean(axis=1)))
            held.append(f"{np.mean(square <= CHI2_95):.1%} at {1e3 * size:.1f} mm")
        text = ", ".join(held) + " of standard deviation (judged on the second half, on the first)"
        met = all(float(share.split("%")[0]) >= 85.0 for share in held)
        what = f"mounting calibrated on one half, marks {called}: truth in the 95 % ellipse on the other"
        yield Row(what, ">= 85 %", text, met)


def _weights(log: Path, scratch: Path) -> Iterator[Row]:
    """One weight, then another beside it, then the first taken away: the point of both lies between the two alone."""
    table = _estimated(log, scratch, "soft_finger").filter(pl.col("x").is_not_null())
    time, force = table["time"].to_numpy(), np.linalg.norm(table.select("fx", "fy", "fz").to_numpy(), axis=1)
    place = table.select("x", "y").to_numpy()
    plateaus = []
    for begin, end in _steady(time, np.rint(force / 1.5)):
        level = int(np.rint(np.median(force[begin:end]) / 1.5))
        plateaus.append((level, np.median(place[begin:end], axis=0), np.median(force[begin:end])))
    gaps = []
    for before, both, after in zip(plateaus, plateaus[1:], plateaus[2:], strict=False):
        if (before[0], both[0], after[0]) == (1, 2, 1):
            mean = (before[1] * before[2] + after[1] * after[2]) / (before[2] + after[2])
            gaps.append(np.linalg.norm(both[1] - mean))
    text = ", ".join(f"{1e3 * gap:.2f}" for gap in gaps) + " mm"
    text += f" (every plateau of both that stands between two of one; {sum(p[0] == 2 for p in plateaus)} in the log)"
    what = "two weights: from the force-weighted mean of the single plateaus"
    yield Row(what, "<= 1.5 mm", text, bool(gaps) and max(gaps) <= 1.5e-3)


def _steady(time: np.ndarray, level: np.ndarray) -> list[tuple[int, int]]:
    """Runs of one level of at least 0.8 s, less 0.3 s at either end; readings that flicker for less are ignored."""
    edges = np.flatnonzero(np.diff(level)) + 1
    found = []
    for begin, end in zip(np.r_[0, edges], np.r_[edges, len(level)], strict=True):
        if level[begin] in (1, 2) and time[end - 1] - time[begin] >= 0.8:
            inner = np.flatnonzero((time >= time[begin] + 0.3) & (time <= time[end - 1] - 0.3))
            found.append((int(inner[0]), int(inner[-1]) + 1))
    return found
