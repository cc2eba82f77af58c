"""What robots and laboratories send: tables of any form, /tf and joint states, links of a URDF, and the real tables."""

import re
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from claims.command import cli
from claims.evidence.exports import EDITED, EXPORTS, NOTED, READ, REFUSED
from claims.evidence.first_minutes import EDIT, GOOD, LOST, REFUSAL, first_minutes, plain_answers
from claims.evidence.made_robots import (
    MESHES,
    MOUNTED,
    MOVED,
    mounting_apart,
    poses_apart,
    vertices_apart,
    write_robots,
)
from claims.evidence.robot import WRENCH, apart, apart_from_library, readme, write_robot
from claims.row import Row, shared, skipped
from palpate.files.logs import LogLayout, read_recording
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session

EXACT = 1e-12  # m, and elements of rotations
MEDIAN = 1.5  # mm: marks are hit within 0.4 mm, and three of them make the mounting


@dataclass(frozen=True)
class Real:
    """A real table: what a person says of it, and the exit code and words of `rig new` that say the same."""

    name: str
    person: str
    code: int
    words: list[str]


REAL = [Real(**each) for each in tomllib.loads(Path(__file__).with_name("real_tables.toml").read_text())["table"]]


def rows(small: bool) -> Iterator[Row]:
    """Small takes few tables and postures: the tests of `files` and of real data try them all."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _tables(Path(folder) / "tables", 60 if small else 1)
        yield from _tree(Path(folder) / "tree", 3 if small else 20)
        yield from _links(Path(folder) / "links", 2 if small else 1000)
        yield from _real(Path(folder) / "real", 6 if small else 1)


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
            yield Row(f"tables: {what}", "all", f"{len(good)} of {len(wanted)}", len(good) == len(wanted))
    misread = [f"{name} ({each.wrong})" for name, each in found.items() if each.misread]
    got = f"{len(misread)} of {len(found)}" + (f": {', '.join(misread)}" if misread else "")
    yield Row("tables: misread in silence (samples, times, units, axes, answers)", "0", got, not misread)


def _tree(folder: Path, touches: int) -> Iterator[Row]:
    session = simulate_session(3, touches=touches, facets=300)
    folder.mkdir()
    write_session(session, folder)
    write_robot(session, folder)
    yield from _poses(folder, session)
    said = next(line for line in readme(folder) if "location of touches" in line)
    middle = float(re.findall(r"\d+\.\d+", said)[1])
    what = "a bag with /tf, joint states and two wrenches: the README's commands, touches' location"
    yield Row(what, f"median <= {MEDIAN} mm", f"median {middle} mm; {touches} touches", middle <= MEDIAN)


def _poses(folder: Path, session: Session) -> Iterator[Row]:
    layout = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"))
    moved = LogLayout(wrench_topic=WRENCH, frames=("world", "ft_sensor"), urdf=folder / "robot.urdf")
    for name, how in (("/tf and /tf_static", layout), ("joint states and a URDF", moved)):
        found = read_recording(folder / "touches", how)
        off = apart(found, session.touches), apart_from_library(found, session.touches, folder / "robot.urdf")
        got = f"{off[0]:.1e}, {off[1]:.1e}"
        yield Row(
            f"{name}: poses from the simulated ones, and from pytransform3d's", "<= 1e-12", got, max(off) <= EXACT
        )


def _links(folder: Path, count: int) -> Iterator[Row]:
    folder.mkdir()
    robots = write_robots(folder)
    off = [vertices_apart(robots[name], link, kind, folder / where) for name, link, kind, where in MESHES]
    yield _urdf(f"surfaces of {len(off)} links from pinocchio's", off)
    off = [mounting_apart(robots[name], link, sensor) for name, link, sensor in MOUNTED]
    yield _urdf(f"mountings of {len(off)} links from pinocchio's and pytransform3d's", off)
    off = [poses_apart(robots[name], base, sensor, joints, count) for name, base, sensor, joints in MOVED]
    yield _urdf(f"kinematics of {len(off)} chains from pytransform3d's, {count:,} postures each", off)


def _urdf(what: str, off: list[float]) -> Row:
    return Row(f"URDF: {what}", "<= 1e-12", f"{max(off):.1e}", max(off) <= EXACT)


def _real(folder: Path, step: int) -> Iterator[Row]:
    """What `rig new` takes the real tables for."""
    folder.mkdir()
    where = shared()
    if where is None:
        yield from skipped("real tables: what `rig new` takes them for", "")
        return
    for each in REAL[::step]:
        said = cli("rig", "new", where / "data" / each.name, "-o", folder / "rig.toml", "--force").output
        said = said.replace(f"{where / 'data'}/", "")
        yield Row(f"{each.name}; a person says: {each.person}", "", _short(said), None)


def _short(said: str) -> str:
    """What it was taken for, and what is to be checked, or why it was refused."""
    notes = re.findall(r"^  (?:note|check): (?!every line is a guess)(.*)$", said, re.MULTILINE)
    return "; ".join(notes) or said.removeprefix("palpate: ").strip()
