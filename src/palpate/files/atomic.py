"""Write files that are complete or absent, and never overwrite an input."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory, mkstemp

from palpate.errors import InputError
from palpate.files.inputs import irregular
from palpate.files.output_lock import only_writer, reserve

PART = ".part"
RING = ".ring"  # of a live record, which is not recovered yet
WHOLE = "whole.part"  # in an OUTPUT.part that is a folder, the file that replaces OUTPUT


def keep_inputs(output: Path, inputs: Iterable[Path | None], *, siblings: Iterable[Path] = ()) -> None:
    """Check outputs before any work is done, and reserve them until the command ends.

    Args:
        output: file to write.
        inputs: files to read, or None; not those that may be updated in place.
        siblings: other files to write, such as OUTPUT.toml.

    Raises:
        InputError: a file to write is an input (under any name or link), a folder, a pipe or a device; its folder does
            not exist; its name is too long; or another process is writing it.
    """
    read = [(path, _status(path)) for path in inputs if path is not None]
    grown = Path(f"{output}{PART}")
    for written in (output, *siblings, grown):
        target = _status(written)
        if written is not grown:  # a folder of that name may remain from a killed process
            _refuse_irregular(written, target)
        for path, status in read:
            if target is not None and status is not None and os.path.samestat(target, status):
                raise InputError(f"would overwrite an input, {path}.", where=str(written), hint="Name another output.")
    for written in (output, *siblings):
        reserve_output(written)


def reserve_output(path: Path) -> None:
    """Let no other process write a file or folder until the command ends.

    Raises:
        InputError: another process is writing it, its parent folder does not exist, or its name is too long.
    """
    require_folder(path)
    with writing(path), suppress(FileNotFoundError):
        part(path).lstat()  # the name may be too long
    reserve(_target(path))


def part(path: Path) -> Path:
    """Return the path of a file while it is being written: OUTPUT.part, next to the file that OUTPUT resolves to.

    Raises:
        InputError: the path cannot be resolved.
    """
    target = _target(path)
    return target.with_name(target.name + PART)


@contextmanager
def growing(path: Path) -> Generator[Path]:
    """Yield OUTPUT.part, to be written piece by piece; it replaces OUTPUT when the block ends well or by Ctrl-C.

    After another error, or a kill, it stays; that of an earlier run is removed first. It may be a folder; then the file
    `WHOLE` in it replaces OUTPUT.

    Raises:
        InputError: OUTPUT cannot be written, is a folder, a pipe or a device, or another process is writing it; or
            OUTPUT.part is a folder with foreign files.
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
    """Yield a temporary path that replaces `path`, or the target of this link, if the block ends well.

    Raises:
        InputError: `path` cannot be written, is a folder, a pipe or a device, or another process is writing it; or the
            block raises an OSError.
    """
    _refuse_irregular(path, _status(path))
    target = _target(path)
    with writing(path), only_writer(target):
        handle, name = mkstemp(dir=target.parent, prefix=f".{target.name[:32]}.", suffix=PART)
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
    """Raise an OSError of the block as an error that names `path`.

    Raises:
        InputError: the block raises an OSError.
    """
    try:
        yield
    except OSError as problem:
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8, either completely or not at all.

    Raises:
        InputError: the file cannot be written, or the text cannot be encoded.
    """
    try:
        raw = text.encode()
    except UnicodeEncodeError as problem:
        what = "cannot be written: it would contain a file name that is not UTF-8."
        raise InputError(what, where=str(path)) from problem
    with replacing(path) as temporary:
        temporary.write_bytes(raw)


def _target(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError) as problem:  # the last two: a NUL in the name, links in a circle
        raise InputError(f"cannot write here ({_reason(problem)}).", where=str(path)) from problem


def _place(temporary: Path, target: Path) -> None:
    with writing(target):
        if (temporary / WHOLE).exists():
            (temporary / WHOLE).replace(target)
            shutil.rmtree(temporary)
        elif temporary.is_file():
            temporary.replace(target)


def _clear(temporary: Path) -> None:
    """Remove what a killed process wrote, but no foreign files."""
    if not temporary.is_dir():
        temporary.unlink(missing_ok=True)
        return
    if strange := [file.name for file in temporary.iterdir() if file.suffix not in (".parquet", PART)]:
        what = f"is a folder with a file that Palpate did not write, {strange[0]!r}, but the output needs this path."
        raise InputError(what, where=str(temporary), hint="Remove the folder, or name another output.")
    shutil.rmtree(temporary)


def _refuse_irregular(path: Path, status: os.stat_result | None) -> None:
    if status is not None and (kind := irregular(status)):
        raise InputError(f"is {kind}, not a file to write.", where=str(path), hint="Name another output.")


def require_folder(path: Path) -> None:
    """Check that the parent folder of a path exists.

    Raises:
        InputError: it does not.
    """
    folder = _target(path).parent
    if not folder.is_dir():
        what = f"cannot write here: there is no folder {str(folder)!r}."
        raise InputError(what, where=str(path), hint=f"Make it first: mkdir -p {quote(str(folder))}")


def _status(path: Path) -> os.stat_result | None:
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
    """Yield a temporary folder next to the output, and delete it afterwards.

    Raises:
        OSError: the folder cannot be made.
    """
    made = TemporaryDirectory(PART, f".{output.stem}.", output.absolute().parent, ignore_cleanup_errors=True)
    with made as folder:
        yield Path(folder)
