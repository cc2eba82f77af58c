"""What robots and laboratories send: tables of any form, /tf and joint states, links of a URDF, and the real tables."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from evidence.exports import EDITED, EXPORTS, NOTED, READ, REFUSED
from evidence.first_minutes import EDIT, GOOD, LOST, REFUSAL, first_minutes, plain_answers
from evidence.made_robots import MESHES, MOUNTED, MOVED, mounting_apart, poses_apart, vertices_apart, write_robots
from evidence.robot import WRENCH, apart, apart_from_library, readme, write_robot
from evidence.row import Row, shared, skipped
from palpate.cli import main
from palpate.files.logs import LogLayout, read_recording
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session

__all__ = ["REAL", "Real", "rows"]

COMMAND = "python -m evidence --only files"
NAME = "files"
EXACT = 1e-12  # m, and elements of rotations
MEDIAN = 1.5  # mm: marks are hit within 0.4 mm, and three of them make the mounting


@dataclass(frozen=True)
class Real:
    """A real table: what a person says of it, and the exit code and words of `rig new` that say the same."""

    name: str
    person: str
    code: int
    words: tuple[str, ...]


REAL = (
    Real(
        "pad/trajectory_panda_ft_opti.csv",
        "ft_ is the sensor's wrench, y and z swapped; panda_ the arm's own; opti_ a tracked finger",
        0,
        ("2 wrenches", "panda_wrench_force_x", "opti_orientation_x"),
    ),
    Real(
        "pad/data_two_payloads_ft.csv",
        "a sensor's wrench under two weights at once",
        0,
        ("ft_wrench_force_x", "ft_wrench_torque_z"),
    ),
    Real(
        "nano17/cert_FT44297_loadcases.csv", "load cases of a certificate and their errors: no log", 1, ("--rate HZ",)
    ),
    Real(
        "nano17/roll_400_rows.csv",
        "wrenches of three Nano17 in N and N mm, without names or times",
        1,
        ("no column is recognised as the time",),
    ),
    Real("nano17/calibration_files_FT44297.cal", "ATI's calibration file, no log", 1, ("is ATI's calibration",)),
    Real(
        "payload/recorded_messages_wrench_100.txt",
        "100 wrenches along the axes of the base, without names or times",
        1,
        ("no column is recognised as the time",),
    ),
    Real("payload/recorded_messages_pose_100.txt", "100 poses without names: no wrench", 1, ("not a log of any of",)),
    Real(
        "strip/norm_SW35-RATIO100-P250.csv",
        "readings of seven strips, and where they were touched: no wrench",
        1,
        ("is not a log of any of", "strip1"),
    ),
    Real(
        "taxel_force/none.1614726111.69.txt",
        "counts of a load cell, and of taxels, without names: no wrench",
        1,
        ("is not a log of any of", "column_1, column_2"),
    ),
    Real("taxel_force/calibration2.txt", "one column of counts of a load cell: no wrench", 1, ("only one column",)),
)


def rows(small: bool) -> Iterator[Row]:
    """Small takes few tables and postures: the tests of `io` try them all."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _tables(Path(folder) / "tables", 40 if small else 1)
        yield from _tree(Path(folder) / "tree", 6 if small else 20)
        yield from _links(Path(folder) / "links", 5 if small else 1000)
        yield from _real(Path(folder) / "real")


def _row(what: str, target: str, got: str, passed: bool | None) -> Row:
    return Row(NAME, what, target, got, passed, COMMAND)


def _tables(folder: Path, step: int) -> Iterator[Row]:
    """Each of the made files, from `inspect` to contacts."""
    (folder / "plain").mkdir(parents=True)
    plain = plain_answers(folder / "plain")
    found = {}
    for name in [*EXPORTS][::step]:
        (folder / f"of {name}").mkdir()
        found[name] = first_minutes(EXPORTS[name], folder / f"of {name}", plain)
    for verdict, of, what in (
        (GOOD, READ, "read without an editor, with the answers of the plain CSV"),
        (EDIT, EDITED, "read with the same answers after the one line that `rig new` names"),
        (LOST, NOTED, "rows that cannot be read: said, and the others have the same answers"),
        (REFUSAL, REFUSED, "refused with the reason"),
    ):
        wanted = [found[each.name] for each in of if each.name in found]
        good = [each for each in wanted if each.verdict == verdict and not each.wrong]
        if wanted:
            yield _row(f"tables: {what}", "all", f"{len(good)} of {len(wanted)}", len(good) == len(wanted))
    misread = [f"{name} ({each.wrong})" for name, each in found.items() if each.misread]
    got = f"{len(misread)} of {len(found)}" + (f": {', '.join(misread)}" if misread else "")
    yield _row("tables: misread in silence (samples, times, units, axes, answers)", "0", got, not misread)


def _tree(folder: Path, touches: int) -> Iterator[Row]:
    """The session as a robot records it."""
    session = simulate_session(3, touches=touches, facets=300)
    folder.mkdir()
    write_session(session, folder)
    write_robot(session, folder)
    yield from _poses(folder, session)
    said = next(line for line in readme(folder) if "location of touches" in line)
    middle = float(re.findall(r"\d+\.\d+", said)[1])
    what = "a bag with /tf, joint states and two wrenches: the README's commands, touches' location"
    yield _row(what, f"median <= {MEDIAN} mm", f"median {middle} mm; {touches} touches", middle <= MEDIAN)


def _poses(folder: Path, session: Session) -> Iterator[Row]:
    layout = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"))
    moved = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"), urdf=folder / "robot.urdf")
    for name, how in (("/tf and /tf_static", layout), ("joint states and a URDF", moved)):
        found = read_recording(folder / "touches", how)
        off = apart(found, session.touches), apart_from_library(found, session.touches, folder / "robot.urdf")
        got = f"{off[0]:.1e}, {off[1]:.1e}"
        yield _row(
            f"{name}: poses from the simulated ones, and from pytransform3d's", "<= 1e-12", got, max(off) <= EXACT
        )


def _links(folder: Path, count: int) -> Iterator[Row]:
    """The three made robots."""
    folder.mkdir()
    robots = write_robots(folder)
    off = [vertices_apart(robots[name], link, kind, folder / where) for name, link, kind, where in MESHES]
    yield _urdf(f"surfaces of {len(off)} links from pinocchio's", off)
    off = [mounting_apart(robots[name], link, sensor) for name, link, sensor in MOUNTED]
    yield _urdf(f"mountings of {len(off)} links from pinocchio's and pytransform3d's", off)
    off = [poses_apart(robots[name], base, sensor, joints, count) for name, base, sensor, joints in MOVED]
    yield _urdf(f"kinematics of {len(off)} chains from pytransform3d's, {count:,} postures each", off)


def _urdf(what: str, off: list[float]) -> Row:
    return _row(f"URDF: {what}", "<= 1e-12", f"{max(off):.1e}", max(off) <= EXACT)


def _real(folder: Path) -> Iterator[Row]:
    """What `rig new` takes the real tables for."""
    folder.mkdir()
    where = shared()
    if where is None:
        yield from skipped(NAME, "real tables: what `rig new` takes them for", "", COMMAND)
        return
    for each in REAL:
        heard = io.StringIO()
        with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
            main(["rig", "new", str(where / "data" / each.name), "-o", str(folder / "rig.toml"), "--force"])
        said = heard.getvalue().replace(f"{where / 'data'}/", "")
        yield _row(f"{each.name}; a person says: {each.person}", "", _short(said), None)


def _short(said: str) -> str:
    """What it was taken for, and what is to be checked, or why it was refused."""
    notes = re.findall(r"^  (?:note|check): (?!every line is a guess)(.*)$", said, re.MULTILINE)
    return "; ".join(notes) or said.removeprefix("palpate: ").strip()
