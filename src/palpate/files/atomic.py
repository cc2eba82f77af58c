"""Files that are either whole or not there, and never an input of the command that writes them."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from shlex import quote

from palpate.errors import InputError
from palpate.files.output_lock import only_writer, reserve

__all__ = [
    "PART",
    "WHOLE",
    "growing",
    "irregular",
    "keep_inputs",
    "part",
    "replacing",
    "require_folder",
    "reserve_output",
    "sibling_folder",
    "write_text",
    "writing",
]

PART = ".part"
WHOLE = "whole.part"  # in a folder that grew: what it became


def keep_inputs(output: Path, inputs: Iterable[Path | None], *, siblings: Iterable[Path] = ()) -> None:
    """Refuse, before any work is done, to write over what is read, over what is no regular file, or into no folder.

    What will be written is reserved until the command ends: no other process writes it meanwhile.

    Args:
        output: what will be written.
        inputs: what is read; None is passed over. A file that may be updated in place is left out.
        siblings: what else will be written, such as OUTPUT.toml.

    Raises:
        InputError: a file to write is an input (by whatever name or link), a folder, a pipe or a device, or in a
            folder that is not there, or another process writes it.
    """
    read = [(path, _status(path)) for path in inputs if path is not None]
    grown = Path(f"{output}{PART}")
    for written in (output, *siblings, grown):
        target = _status(written)
        if written is not grown:  # a folder of that name may be what a killed process left
            _refuse_irregular(written, target)
        for path, status in read:
            if target is not None and status is not None and os.path.samestat(target, status):
                raise InputError(f"would overwrite an input, {path}.", where=str(written), hint="Name another output.")
    for written in (output, *siblings):
        reserve_output(written)


def reserve_output(path: Path) -> None:
    """Let no other process write a file or a folder until the command ends; see `require_folder`.

    Raises:
        InputError: another process writes it, or it would be in a folder that is not there.
    """
    require_folder(path)
    reserve(_target(path))


def part(path: Path) -> Path:
    """Where a file that grows for long stands until it is finished: OUTPUT.part, beside what OUTPUT leads to."""
    target = _target(path)
    return target.with_name(target.name + PART)


@contextmanager
def growing(path: Path) -> Generator[Path]:
    """OUTPUT.part, to be written bit by bit; it takes the place of OUTPUT when the block ends well or by Ctrl-C.

    After any other error it stays as it is, and so it does if the process is killed: what was done is in it. What was
    there before is removed. It may be a folder; then the file `WHOLE` in it takes the place.

    Raises:
        InputError: as `replacing`.
    """
    _refuse_irregular(path, _status(path))
    target, temporary = _target(path), part(path)
    with only_writer(target):
        with writing(path):
            _clear(temporary)
        try:
            yield temporary
        except KeyboardInterrupt:
            _place(temporary, target)
            raise
        _place(temporary, target)


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well, and vanishes when it does not.

    Links are followed: what they lead to is replaced.

    Raises:
        InputError: the folder is not there, or may not be written, `path` is a folder, a pipe or a device, or another
            process writes it.
    """
    _refuse_irregular(path, _status(path))
    target = _target(path)
    with writing(path), only_writer(target):
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:32]}.", suffix=PART)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o666 & ~_umask())  # mkstemp makes it private
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Generator[None]:
    """Says an error of the system as an `InputError` that names `path`."""
    try:
        yield
    except OSError as problem:
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all.

    Raises:
        InputError: it cannot be written, or holds what is not UTF-8: the name of some file.
    """
    try:
        raw = text.encode()
    except UnicodeEncodeError as problem:
        raise InputError("cannot be written: the name of a file in it is not UTF-8.", where=str(path)) from problem
    with replacing(path) as temporary:
        temporary.write_bytes(raw)


def _target(path: Path) -> Path:
    """What a name leads to."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError) as problem:  # the last two: a NUL in the name, links in a circle
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem


def _place(temporary: Path, target: Path) -> None:
    """What was finished takes its name; nothing happens where nothing was left, or joining it was interrupted."""
    with writing(target):
        if (temporary / WHOLE).exists():
            (temporary / WHOLE).replace(target)
            shutil.rmtree(temporary)
        elif temporary.is_file():
            temporary.replace(target)


def _clear(temporary: Path) -> None:
    """Remove what a killed process left, but no folder that may be somebody's own."""
    if not temporary.is_dir():
        temporary.unlink(missing_ok=True)
        return
    if strange := [file.name for file in temporary.iterdir() if file.suffix not in (".parquet", PART)]:
        raise InputError(
            f"is in the way: a folder with {strange[0]!r}.",
            where=str(temporary),
            hint="Remove it, or name another output.",
        )
    shutil.rmtree(temporary)


def irregular(status: os.stat_result) -> str:
    """Return what a path leads to where that is no regular file, and "" where it is one."""
    if stat.S_ISREG(status.st_mode):
        return ""
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(status.st_mode), "a device")


def _refuse_irregular(path: Path, status: os.stat_result | None) -> None:
    if status is not None and (kind := irregular(status)):
        raise InputError(f"is {kind}, not a file to write.", where=str(path), hint="Name another output.")


def require_folder(path: Path) -> None:
    """Refuse what is to be written in a folder that is not there: a command makes what it is to fill, nothing above.

    Raises:
        InputError: there is no such folder.
    """
    folder = _target(path).parent
    if not folder.is_dir():
        what = f"cannot write here: there is no folder {str(folder)!r}."
        raise InputError(what, where=str(path), hint=f"Make it first: mkdir -p {quote(str(folder))}")


def _status(path: Path) -> os.stat_result | None:
    """Of what a name leads to; None where there is nothing, or where writing will say what is wrong."""
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


def _reason(problem: Exception) -> str:
    return str((problem.strerror if isinstance(problem, OSError) else None) or problem)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def sibling_folder(output: Path) -> Generator[Path]:
    """A folder beside the output that is gone afterwards, after Ctrl-C too: what is finished has been moved out."""
    folder = Path(tempfile.mkdtemp(prefix=f".{output.stem}.", suffix=PART, dir=output.absolute().parent))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
