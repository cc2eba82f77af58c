"""`palpate simulate marker-ring`: record a barrel to try calibration and estimation on."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import counting, lines, note, progress, title, wait
from palpate.console.options import CountOption
from palpate.errors import InputError
from palpate.files.atomic import PART, reserve_output, sibling_folder

Flag = Annotated[bool, FlagCreatePairsOff]
Folder = Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")]


def simulate_marker_ring(
    *,
    output: Folder,
    seed: Annotated[int, arg(metavar="N")] = 0,
    touches: Flag = False,
    small: Flag = False,
    count: CountOption = None,
    rings: Annotated[int, arg(metavar="N")] = 1,
    images: Flag = False,
) -> None:
    """Simulate a marker ring.

    Record a simulated barrel: its calibration run, or touches to judge by; with the truth from its mechanics.

    Args:
        output: folder to make: frames.avi, truth.csv, rig.toml, camera.toml.
        seed: seed of the unit; wall, silicone, lens and mounting differ from one to the next.
        touches: record touches, several at once and moving, instead of a calibration run.
        small: fewer angles or touches, on a coarser barrel: seconds instead of minutes.
        count: number of angles around the ring, or of touches; otherwise 36 angles or 12 touches (small: 24
            or 4).
        rings: number of rings of 24 markers each, at distances of 10 mm: 1 to 3.
        images: write a folder of images instead of a video.
    """
    require_new(output)
    if seed < 0 or (count is not None and count < 1):
        raise InputError("seed must be 0 or more, and count 1 or more.", where="--seed, --count")
    if rings not in (1, 2, 3):
        raise InputError(f"must be from 1 to 3, not {rings}.", where="--rings")
    with complete_session(output) as part, counting():
        figures = _record(part, seed, rings, touches, small, count, images)
    title(f"marker ring, unit {seed} -> {output}")
    lines(figures)
    note(["truth.csv is of the centre of pressure, by linear elasticity; estimates never see it"])


def require_new(folder: Path) -> None:
    """Check that a folder can be made, and keep other processes from making it until the command ends.

    Raises:
        InputError: it is a file, is not empty, its parent does not exist, or another process makes it.
    """
    reserve_output(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file, not a folder.", where=str(folder), hint="Name another folder.")
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError("is not empty.", where=str(folder), hint="Name a new folder.")


def require_within(**bounds: tuple[int | float, int | float, int | float]) -> None:
    """Check that options are within their bounds: least, given, most.

    Raises:
        InputError: one is not.
    """
    for name, (least, given, most) in bounds.items():
        if not least <= given <= most:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"must be from {least:g} to {most:g}, not {given:g}.", where=option)


def require_known(value: str, known: Iterable[str], what: str) -> None:
    """Check that an option is one of the known words.

    Raises:
        InputError: it is not.
    """
    if value not in known:
        raise InputError(f"the {what} {value!r} is unknown.", where=f"--{what}", hint=f"Use one of {', '.join(known)}.")


def require_new_run(output: Path, film: Path | None, files: Mapping[str, Path], hint: str) -> None:
    """Check that a recording, its film and the files of the run can be made, and keep other processes from the two.

    Raises:
        InputError: a name ends otherwise (`hint` is on that of the recording), exists, or another process makes it.
    """
    if output.suffix != ".mcap":
        raise InputError("is not the name of an MCAP file.", where=str(output), hint=hint)
    if film is not None and film.suffix != ".mp4":
        raise InputError("is not the name of a video.", where=str(film), hint="Name it RUN.mp4.")
    films = [] if film is None else [film]
    for file in (output, *films):
        reserve_output(file)
    for file in (*files.values(), *films):
        if file.exists() or file.is_symlink():
            raise InputError("is already there.", where=str(file), hint="Name another output.")


@contextmanager
def complete_run(output: Path, film: Path | None) -> Generator[tuple[Path, Path | None]]:
    """Yield where to record a run and its film; they, and the files next to them, take their names at the end."""
    with sibling_folder(output) as part, counting():
        video = None if film is None else part / f"{output.stem}.mp4"
        yield part / output.name, video
        if film is not None and video is not None:
            shutil.move(video, film)
        for file in sorted(part.iterdir()):
            file.replace(output.parent / file.name)


@contextmanager
def complete_session(output: Path) -> Generator[Path]:
    """Yield the path of a folder next to the output that becomes it at the end.

    After Ctrl-C or an error it is removed.
    """
    part = Path(tempfile.mkdtemp(prefix=f".{output.name}.", suffix=PART, dir=output.absolute().parent))
    try:
        yield part
        part.chmod(0o755)
        if output.exists():
            output.rmdir()
        part.rename(output)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _record(
    folder: Path, seed: int, rings: int, touches: bool, small: bool, count: int | None, images: bool
) -> list[tuple[str, object]]:
    """Simulate and write a run; return its figures."""
    from palpate_lab.simulation import ring_session as ring  # here: with them comes scipy
    from palpate_lab.simulation import ring_session_files as files

    wait("building the barrel")
    unit = ring.RingUnit.drawn(seed, coarse=small, rings=rings)
    form = "folder" if images else "video"
    if touches:
        wanted = ring.Touching(touches=count or (4 if small else 12), seed=seed)
        session = ring.touching_run(unit, wanted, progress)
        files.write_touching_run(session, folder, images=form, watch=progress)
    else:
        session = ring.calibration_run(unit, ring.Protocol.sized(small=small, angles=count), progress)
        files.write_calibration_run(session, folder, images=form, watch=progress)
    seconds, contacts = len(session.time) / ring.RATE, session.contacts
    return [
        ("frames", f"{len(session.time)} of {unit.camera.width} x {unit.camera.height}, {seconds:.1f} s"),
        ("touched", f"in {(contacts > 0).mean():.0%} of the frames, by {contacts.max()} at once at most"),
        ("force", f"up to {session.strongest:.1f} N"),
    ]
