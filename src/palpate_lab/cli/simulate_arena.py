"""`palpate simulate arena`: simulate robots that find their way by touch, one run as a recording or many as a page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import Quantity, announce, lines, note, progress, title, wait
from palpate.console.options import CountOption, FileOption, NameOption, require_port
from palpate.errors import InputError
from palpate_lab.cli.arena_setup import ArenaRequest, robot_skin
from palpate_lab.cli.simulate import complete_run, require_new_run

if TYPE_CHECKING:
    from palpate_lab.cli.arena_run import ArenaRun
    from palpate_lab.simulation.arena.moment import ArenaMoment, ArenaResult

    Show = Callable[[ArenaMoment], None]

Flag = Annotated[bool, FlagCreatePairsOff]
Out = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
Film = Annotated[FileOption, arg(metavar="RUN.mp4")]
Name = Annotated[str, arg(metavar="NAME")]
Count = Annotated[int, arg(metavar="N")]

FRAMED = 6  # moments between two pictures of the film
PICTURES = 25  # of the film a second, which makes it five times as fast as what happened


def simulate_arena(
    *,
    output: Out,
    robots: CountOption = None,
    seed: Count = 0,
    density: NameOption = None,
    layout: Name = "random",
    method: Name = "ours",
    images: Flag = False,
    seconds: Annotated[float, arg(metavar="S")] = 600.0,
    rig: FileOption = None,
    fault: NameOption = None,
    film: Film = None,
    view: Flag = False,
    port: Count = 8080,
    seeds: CountOption = None,
    jobs: CountOption = None,
    backend: Name = "processes",
) -> None:
    """Simulate robots that find their way by touch.

    Send robots with a soft skin through an arena that they cannot see; record one run, or judge many seeds.

    Args:
        output: recording (MCAP) of one run; next to it, with the same stem, _arena.toml, _truth.csv and _felt.csv, with
            --images _rig.toml and _ring.toml too. With --seeds: a page (.html), and .jsonl with a line per run.
        robots: number of robots; otherwise 4, or as many as the layout has.
        seed: seed of the arena, of all noise and of random choices on the way; with --seeds the first one.
        density: of a random arena's blocks: sparse, paper or dense; otherwise paper.
        layout: random, paper (as in its figure 11), u (a trap between start and goal), corridor (one and a half
            robots wide), or a file of your own (.toml), as _arena.toml next to a recording.
        method: ours, no-push, no-memory, or paper, paper-turned, paper-random: the paper's states, which retreat
            towards the goal, to the side or at random.
        images: close the loop through images of the skin's camera; otherwise through the places of its markers.
        seconds: longest duration of a run.
        rig: TOML that names the model of a ring for all robots to wear; otherwise one that is calibrated already.
        fault: fault of the first robot: blind or stuck-wheel, both from 10 s on, torn or wrong-goal.
        film: write a video too, five times as fast, drawn without a screen.
        view: serve a page meanwhile to watch it live; its speed is set there.
        port: first port to try for the page.
        seeds: number of arenas to run in parallel; results are kept, and the same command goes on with the rest.
        jobs: number of processes for them; otherwise one per core.
        backend: what runs them: processes on this machine, or a dask or ray cluster.
    """
    asked = ArenaRequest(robots, density, layout, method, images, seconds, fault, None if rig is None else str(rig))
    if seed < 0:
        raise InputError("must not be negative.", where="--seed")
    require_port(port, "--port")
    if seeds is not None:
        _require_alone(view=view, film=film is not None)
        from palpate_lab.cli.arena_batch import run_batch

        run_batch(asked, range(seed, seed + seeds), output, jobs, backend)
        return
    _require_single(jobs, backend)
    asked.check()
    from palpate_lab.simulation.arena.run_files import files_of

    hint = "Name it RUN.mcap; a page of many runs needs --seeds."
    require_new_run(output, film, files_of(output, asked.arena(seed).robots, asked.images), hint)
    wait("loading compiled loops")
    run = asked.run(seed)
    with complete_run(output, film) as (recording, video):
        result = _recorded(run, asked, recording, video, port if view else None)
    title(f"{len(result.arrived)} robots, {run.settings.layout.name}, method {method} -> {output}")
    lines(_figures(result))
    note(_next(output, asked))


def _require_alone(*, view: bool, film: bool) -> None:
    """Refuse a page or a film of many runs."""
    for option, given in (("--view", view), ("--film", film)):
        if given:
            raise InputError("is possible for one run only.", where=option, hint="Leave out this option or --seeds.")


def _require_single(jobs: int | None, backend: str) -> None:
    if jobs is not None or backend != "processes":
        raise InputError(
            "is for many runs only.", where="--jobs" if jobs is not None else "--backend", hint="Add --seeds N."
        )


def _recorded(run: ArenaRun, asked: ArenaRequest, recording: Path, film: Path | None, port: int | None) -> ArenaResult:
    """Run to the end, write the files, and draw and show the run meanwhile if requested."""
    from palpate_lab.simulation.arena.run_files import RunRecorder, files_of, write_arena

    layout, settings = run.settings.layout, run.settings
    robots = len(layout.starts)
    with ExitStack() as stack:
        recorder = stack.enter_context(RunRecorder(recording, robots, images=asked.images, radius=run.robot.radius))
        shows: list[Show] = [recorder.add, *_filmed(run, film, stack), *_live(run, port, stack)]
        for count, moment in enumerate(run):
            for show in shows:
                show(moment)
            if count % 30 == 0:
                progress(count, min(1.0, moment.time / settings.seconds))
    said = {"seed": settings.seed, "method": settings.method, "sensing": settings.sensing, "seconds": settings.seconds}
    if asked.fault is not None:
        said["fault"] = asked.fault
    write_arena(files_of(recording, robots, asked.images)["arena"], layout, said)
    if asked.images:
        _write_ring(asked, recording)
    return run.result()


def _write_ring(asked: ArenaRequest, recording: Path) -> None:
    """Write the files that `palpate estimate` needs to read a robot's camera."""
    from palpate.files.models.kinds import write_model
    from palpate_lab.simulation.arena.run_files import files_of, write_rig

    write_rig(recording)
    write_model(files_of(recording, 1, True)["ring"], robot_skin(asked.rig).ring)


def _filmed(run: ArenaRun, path: Path | None, stack: ExitStack) -> list[Show]:
    """Return the function that adds a moment to the film; none without a film."""
    if path is None:
        return []
    from palpate.viewer.video import Video
    from palpate_lab.viewer.arena_picture import SIZE, ArenaPicture

    picture = ArenaPicture(run.settings.layout, run.robot.radius)
    video = stack.enter_context(closing(Video(path, SIZE, PICTURES)))
    last = -1

    def show(moment: ArenaMoment) -> None:
        nonlocal last
        last += 1
        if last % FRAMED == 0 or moment.arrived.all():
            video.add(picture.draw(moment))

    return [show]


def _live(run: ArenaRun, port: int | None, stack: ExitStack) -> list[Show]:
    """Return the function that shows a moment on the page, and waits while the run is early or the page is paused."""
    if port is None:
        return []
    from palpate_lab.viewer.live_arena import LiveArena

    page = stack.enter_context(LiveArena(run.settings.layout, run.robot.radius, port=port))
    announce(f"open {page.address} in a browser; Ctrl-C ends the run and leaves no file")

    def show(moment: ArenaMoment) -> None:
        page.show(moment, now=bool(moment.arrived.all()))
        page.wait(moment.time)

    return [show]


def _figures(result: ArenaResult) -> list[tuple[str, object]]:
    times = np.array(result.arrived)
    there = np.isfinite(times)
    after = ", ".join(f"{time:.1f}" if np.isfinite(time) else "never" for time in times)
    figures: list[tuple[str, object]] = [
        ("arrived", Quantity(f"{there.sum()} of {len(times)}", int(there.sum()))),
        ("after", Quantity(f"{after} s", list(result.arrived))),
        ("way", Quantity(f"{', '.join(f'{way:.2f}' for way in result.path)} m", list(result.path))),
        ("force", Quantity(f"{result.force:.2f} N at 99 % of the contact time", result.force)),
        ("greatest", Quantity(f"{max(result.greatest):.2f} N", max(result.greatest))),
        ("pushes", sum(result.pushes)),
        ("deadlocks", sum(result.deadlocks)),
    ]
    lost = [f"robot {k + 1}" for k in np.flatnonzero(~there).tolist()]
    return figures + [(name, result.state[int(name.split()[1]) - 1]) for name in lost]


def _next(output: Path, asked: ArenaRequest) -> list[str]:
    found = ["what really touched is in _truth.csv and on /robot_*/truth and /truth; no robot sees it"]
    if asked.images:
        rig = output.with_name(f"{output.stem}_rig.toml")
        found.append(f"palpate estimate {output} --rig {rig} -o contacts.csv")
        found.append(f"palpate evaluate contacts.csv {output.with_name(f'{output.stem}_robot_1_truth.csv')}")
    return found
