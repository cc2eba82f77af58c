"""Run `palpate batch`: many logs with one rig, on all cores or a cluster, and one page about all of them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache, partial
from math import nan
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from palpate.cli.batch_dataset import CONTACTS, EpisodeLog, episodes_of, label
from palpate.cli.batch_logs import logs_of, names_of
from palpate.cli.estimate_log import TORN, estimate_log, record_of
from palpate.cli.estimate_robot import require_robot_options, write_robot
from palpate.cli.rig_options import RigOptions
from palpate.console.console import Quantity, announce, lines, note, overwrite, title
from palpate.console.options import CountOption
from palpate.console.parallel import begin_results, from_row, read_rows, require_backend, run_kept
from palpate.contact.estimate import Status
from palpate.contact.events import Events
from palpate.errors import InputError, PalpateError
from palpate.files.atomic import require_folder, reserve_output, write_text, writing
from palpate.files.inputs import open_input
from palpate.files.logs.layout import pose_path
from palpate.files.models import provenance
from palpate.setup import Rig
from palpate.setup.load import robot_of
from palpate.setup.robot import Robot
from palpate.viewer.batch_summary import LogResult, compose, figures
from palpate.viewer.report import render, require_report
from palpate.viewer.run_summary import RunSummary

__all__ = ["batch"]

UNBELIEVABLE, SOME_FAILED = 4, 5
PAGE, KEPT = "batch.html", "batch.jsonl"
PATHS = ("rig", "mesh", "payload")  # of a set-up
SHOWN = 5  # failures that are printed
RESULTS, WORKERS = "results of a batch of logs", "--workers"


@dataclass(frozen=True)
class _Job:
    """A log to be done; paths are absolute.

    Attributes:
        setup: rig and options.
        made: digest of version, rig and options.
        called: the log, as the user gave it.
        log: the log.
        output: file of contacts to write.
        frame: coordinate frame of the result.
        parent: process whose child must do it; 0: any.
        episode: that of a data set which is the log; None: all of the file is.
    """

    setup: RigOptions
    made: str
    called: str
    log: Path
    output: Path
    frame: str
    parent: int
    episode: EpisodeLog | None = None

    @property
    def key(self) -> str:
        """Resolved path of the log, with the number of the episode."""
        return str(self.log.resolve()) + ("" if self.episode is None else f"#{self.episode.episode.index}")


@dataclass(frozen=True)
class _Kept:
    """A line of the results: a log that is done, or failed.

    Attributes:
        log: resolved path.
        output: name of the file of contacts.
        made: as in `_Job`.
        digest: `log_digest`; "" where it failed.
        size: bytes of the output.
        result: summary for the page.
    """

    log: str
    output: str
    made: str
    digest: str
    size: int
    result: LogResult


def batch(
    logs: Annotated[Positional[tuple[Path, ...]], arg(metavar="LOGS")],
    /,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")],
    setup: Annotated[RigOptions, arg(name="")],
    form: Annotated[Literal["parquet", "csv", "mcap"], arg(name="format", metavar="NAME")] = "parquet",
    frame: Literal["surface", "sensor", "base"] = "surface",
    workers: CountOption = None,
    backend: Annotated[str, arg(metavar="NAME")] = "processes",
) -> None:
    """Estimate contacts in many logs, and write one page about them.

    Find contacts in many logs, each exactly as `palpate estimate` would, and write one page about all of them.

    The folder receives a file of contacts per log, each with its .toml, batch.html (a row per log) and batch.jsonl
    (completed logs). The same command continues where it was ended: logs with a complete output from the same log, rig,
    options and version are not done again. A log that cannot be used is listed with the reason. Exit code 5: done, but
    some logs failed; 3: one was cut off; 4: nothing in one can be believed.

    Of a LeRobot data set each episode is a log, and the folder receives a copy of it with contacts as columns.

    Args:
        logs: files, folders (with all that is below) and patterns; see `palpate estimate`. Or one data set's folder.
        output: folder to write into; it is created if only its parent exists.
        setup: what is touched, and how contacts are found.
        form: format of the files of contacts: parquet, csv or mcap.
        frame: coordinate frame of the results; base needs the sensor's orientation and position in the logs.
        workers: number of logs at a time; by default one per core.
        backend: what runs them: processes on this machine, or a dask or ray cluster that sees the same files.

    Raises:
        InputError: there is no log, an option, the rig or the folder cannot be used, or an output is an input.
        OSError: a file of the rig cannot be read for its digest.
        KeyboardInterrupt: Ctrl-C; what is done stays.
        SystemExit: 5: some logs failed; 3: one was cut off; 4: nothing in one can be believed.
    """
    count = require_backend(backend, workers, WORKERS)
    require_report()
    rig, episodes = _stated(setup), episodes_of(logs, output)
    if isinstance(rig, Robot) and episodes:
        what = "a data set has the episodes of one sensor, but this is the rig of a robot."
        raise InputError(what, where=str(rig.path), hint="Write a rig of the sensor.")
    files = rig.files()
    found = [] if episodes else logs_of(logs, output)
    _require_folder(output)
    made = _digest(setup, files, frame)
    kept = {each.log: each for each in _read(output / KEPT)}
    known = {Path(each.log): each.output.removesuffix(f".{form}") for each in kept.values()}
    anywhere, folder = _absolute(setup), output.absolute()
    parent = os.getpid() if backend == "processes" and count > 1 else 0
    jobs = [
        _Job(anywhere, made, _printable(log), log.absolute(), folder / f"{name}.{form}", frame, parent)
        for log, name in names_of(found, known).items()
    ]
    jobs += [
        _Job(anywhere, made, each.called, each.path, folder / f"{each.name}.{form}", frame, parent, each)
        for each in episodes
    ]
    if episodes:
        (output / CONTACTS).mkdir(exist_ok=True)
    _require_separate(jobs, setup, files)
    done = dict[str, _Kept]()
    for job in jobs:
        overwrite(f"checking which logs are done: {job.called}")
        if _is_done(kept.get(job.key), job):
            done[job.key] = kept[job.key]
    begin_results(output / KEPT, {"command": "batch"}, map(asdict, kept.values()))
    if done:
        announce(f"{len(done)} of {len(jobs)} logs are in {output} already; the others follow")
    wanted = [job for job in jobs if job.key not in done]
    try:
        with closing(run_kept(_one, wanted, output / KEPT, (count, backend, WORKERS), asdict, _lost)) as results:
            for result in results:
                done[result.log] = result
                overwrite(_so_far(done, len(jobs)))
    except KeyboardInterrupt:
        announce(f"{len(done)} of {len(jobs)} logs are in {output}: run the same command to continue")
        raise
    results = [done[job.key].result for job in jobs]
    if episodes:
        label(episodes, _contacts(jobs, results), output, frame)
    _end(results, output, setup, files)


def _contacts(jobs: Sequence[_Job], results: Sequence[LogResult]) -> dict[int, Path]:
    """Return the number of each episode that is done -> file of its contacts."""
    pairs = zip(jobs, results, strict=True)
    return {job.episode.episode.index: job.output for job, done in pairs if job.episode and not done.failure}


def _one(job: _Job) -> _Kept:
    """Estimate one log; an error becomes its result."""
    try:
        digest = _log_digest(job)  # before: a log that grows meanwhile is another log
        rig = _rig(job.setup, job.made)
        if isinstance(rig, Robot):
            return _robot_contacts(job, rig, digest)
        rig = rig if job.episode is None else job.episode.rig(rig)
        opened = job.setup.open(job.log, rig)
        files = {"log": job.log, "rig": job.setup.rig, **opened.files()}
        done = estimate_log(opened, job.output, job.frame, files, partial(_watch, job.parent), keep_short=False)
    except PalpateError as problem:
        return _failed(job, str(problem).removeprefix(f"{job.log}: "))  # the page names the log
    except Exception as problem:  # of one log in a thousand: the others shall not wait for it to be mended
        return _failed(job, f"{type(problem).__name__}: {' '.join(str(problem).split())}")
    warnings = (*([done.nothing] if done.nothing else []), *done.warnings, *done.short)
    result = _result(job, [done.summary], done.summary.finder.touches(), warnings)
    return _done(job, digest, replace(result, ended=done.ended, believed=not done.nothing))


def _robot_contacts(job: _Job, robot: Robot, digest: str) -> _Kept:
    """Estimate the log of a robot; one without the contacts of some sensor is not believed."""
    watch = partial(_watch, job.parent)
    done = write_robot(job.log, robot, job.output, job.frame, job.setup.sensor, watch, keep_short=False)
    summaries, warnings = list(done.summary.summaries.values()), tuple(done.pipeline.warnings())
    result = _result(job, summaries, done.summary.touches(), warnings)
    return _done(job, digest, replace(result, ended=done.record["ended"], believed=not done.pipeline.failed))


def _result(job: _Job, summaries: Sequence[RunSummary], touches: Events, warnings: tuple[str, ...]) -> LogResult:
    """Return the result of a log from the summary of each sensor."""
    statuses = np.sum([each.statuses for each in summaries], axis=0)
    return LogResult(
        job.called,
        job.output.name,
        samples=sum(each.samples for each in summaries),
        contacts=int(statuses[[Status.CONTACT, Status.AMBIGUOUS]].sum()),
        touches=len(touches),
        peak=float(touches.peak_force.max()) if len(touches) else nan,
        statuses=tuple(statuses.tolist()),
        warnings=warnings,
    )


def _done(job: _Job, digest: str, result: LogResult) -> _Kept:
    return _Kept(job.key, job.output.name, job.made, digest, job.output.stat().st_size, result)


def _failed(job: _Job, why: str) -> _Kept:
    return _Kept(job.key, job.output.name, job.made, "", 0, LogResult(job.called, failure=why))


def _lost(job: _Job) -> _Kept:
    """Return the result of a log whose worker was ended from outside."""
    return _failed(job, "the process that read it ended early: too little memory, or a crash in a library.")


@lru_cache(maxsize=1)
def _rig(setup: RigOptions, made: str) -> Rig | Robot:
    """Load the rig, once per process; `made` changes with the rig's files."""
    return _stated(setup)


def _stated(setup: RigOptions) -> Rig | Robot:
    """Return the robot of a rig, or the rig of one sensor with all options applied."""
    robot = None if setup.rig is None else robot_of(setup.rig)
    if robot is None:
        return setup.load()
    require_robot_options(robot, setup)
    return robot


def _watch(parent: int, done: int, share: float) -> None:
    """Raise KeyboardInterrupt in a worker whose command was killed."""
    if parent and os.getppid() != parent:
        raise KeyboardInterrupt


def log_digest(log: Path) -> str:
    """Return the SHA-256 (hexadecimal) of a log's bytes; of a folder, of the names, sizes and times in it.

    Raises:
        InputError: the file cannot be read.
        OSError: the folder cannot be read.
    """
    if not log.is_dir():
        with open_input(log) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    stats = [(path.name, path.stat()) for path in sorted(log.iterdir())]
    return _sha256([(name, stat.st_size, stat.st_mtime_ns) for name, stat in stats])


def _sha256(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()


def _digest(setup: RigOptions, files: Mapping[str, Path], frame: str) -> str:
    """Return the SHA-256 of version, files of the rig and options."""
    options = {each.name: getattr(setup, each.name) for each in fields(setup) if each.name not in PATHS}
    return _sha256(provenance({"rig": setup.rig, **files}, {**options, "frame": frame}))


def _printable(log: Path) -> str:
    """Return the path as text; a name need not be UTF-8."""
    return str(log).encode(errors="backslashreplace").decode()


def _absolute(setup: RigOptions) -> RigOptions:
    paths = {name: path.absolute() for name in PATHS if (path := getattr(setup, name)) is not None}
    return replace(setup, **paths)


def _require_folder(output: Path) -> None:
    require_folder(output)
    with writing(output):
        if output.exists() and not output.is_dir():
            what, hint = "is not a folder, which many logs need.", "Name another with -o FOLDER."
            raise InputError(what, where=str(output), hint=hint)
        output.mkdir(exist_ok=True)
    reserve_output(output / KEPT)


def _require_separate(jobs: Sequence[_Job], setup: RigOptions, files: Mapping[str, Path]) -> None:
    """Raise an InputError if an output is an input of any log."""
    inputs = [setup.rig, *files.values(), *(job.log for job in jobs)]
    read = {path.resolve() for path in inputs if path is not None}
    for path in (path for job in jobs for path in (job.output, record_of(job.output))):
        if path.resolve() in read:
            raise InputError("would overwrite an input.", where=str(path), hint="Name another folder.")


def _read(path: Path) -> Iterator[_Kept]:
    """Yield the results of earlier runs; the last one of a log counts."""
    if not path.exists():
        return
    _, rows = read_rows(path, RESULTS)
    try:
        for row in rows:
            yield from_row(_Kept, {**row, "result": from_row(LogResult, row["result"])})
    except (KeyError, TypeError) as problem:
        raise InputError(f"does not hold {RESULTS}.", where=str(path), hint="Name another folder.") from problem


def _log_digest(job: _Job) -> str:
    """Return the digest of a log, and of its table of poses if there is one."""
    rig = _rig(job.setup, job.made)
    rigs = [each.rig for each in rig.sensors.values()] if isinstance(rig, Robot) else [rig]
    poses = {path for each in rigs if (path := pose_path(each.orientation.file, job.log)) is not None}
    return log_digest(job.log) + "".join(log_digest(path) for path in sorted(poses) if path.is_file())


def _is_done(kept: _Kept | None, job: _Job) -> bool:
    """Return whether a log is done from the same inputs, and its output is unchanged."""
    output = job.output
    if kept is None or kept.result.failure or (kept.made, kept.output) != (job.made, output.name):
        return False
    unchanged = output.is_file() and output.stat().st_size == kept.size and record_of(output).is_file()
    return unchanged and _log_digest(job) == kept.digest


def _so_far(done: dict[str, _Kept], total: int) -> str:
    failed = sum(bool(each.result.failure) for each in done.values())
    samples = sum(each.result.samples for each in done.values())
    return f"{len(done)} of {total} logs, {samples:,} samples" + (f", {failed} failed" if failed else "")


def _end(results: Sequence[LogResult], output: Path, setup: RigOptions, files: Mapping[str, Path]) -> None:
    page = output / PAGE
    inputs = (("rig", str(setup.rig or setup.mesh)), *((name, str(path)) for name, path in files.items()))
    write_text(page, render(compose(results, inputs)))
    title(f"{len(results)} logs -> {page}")
    lines((name, Quantity(text, value)) for name, text, value in figures(results))
    failed = [each for each in results if each.failure]
    note((f"{each.log}: {each.failure}" for each in failed[:SHOWN]), kind="warning")
    note([f"{len(failed) - SHOWN} more logs failed, see {page}"] if len(failed) > SHOWN else [], kind="warning")
    torn, nothing = any(each.ended == "torn" for each in results), any(not each.believed for each in results)
    if failed or torn or nothing:
        raise SystemExit(SOME_FAILED if failed else TORN if torn else UNBELIEVABLE)
