"""`palpate simulate phantom`: record a probe that is kept on moving tissue by force sensing alone."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import Quantity, announce, lines, note, progress, title, wait
from palpate.console.options import FileOption, Scalar
from palpate.errors import InputError
from palpate_lab.cli.simulate import complete_run, require_known, require_new_run

if TYPE_CHECKING:
    from palpate.control.align import AlignController
    from palpate_lab.cli.phantom_run import PhantomMoment
    from palpate_lab.simulation.phantom.lab import PhantomLab, PhantomTruth
    from palpate_lab.simulation.phantom.run_files import PhantomRun

    Show = tuple[
        int, Callable[[PhantomTruth, str], None]
    ]  # period in periods of the sensor, and the function that shows a moment

Flag = Annotated[bool, FlagCreatePairsOff]
Out = Annotated[Path, arg(aliases=["-o"], metavar="RUN.mcap")]
Film = Annotated[FileOption, arg(metavar="RUN.mp4")]
Seconds = Annotated[Scalar, arg(metavar="S")]
Count = Annotated[int, arg(metavar="N")]

BEGIN = 5.0  # s: by then the probe has approached, pressed and settled
SHOWN = 20  # periods of the sensor between two pictures of the live page
FRAMED = 8  # and of the film
PLATE = (0.20, 0.14, 0.06)  # m: the drawn phantom


def simulate_phantom(
    *,
    output: Out,
    motion: Annotated[str, arg(metavar="NAME")] = "in-plane",
    period: Seconds = None,
    probe: Annotated[str, arg(metavar="NAME")] = "convex",
    seconds: Annotated[float, arg(metavar="S")] = 30.0,
    seed: Count = 0,
    method: Annotated[str, arg(metavar="NAME")] = "ours",
    film: Film = None,
    view: Flag = False,
    port: Count = 8080,
) -> None:
    """Simulate a probe held on a moving soft phantom.

    Hold a probe on a soft phantom that moves, in a physics engine; record it with its truth.

    Args:
        output: recording (MCAP) to write; next to it, with the same stem, _rig.toml, _robot.urdf, _probe.stl,
            _payload.toml and _truth.csv.
        motion: motion from 5 s on: still, vertical (10 mm), in-plane or out-of-plane (10 deg), breathing
            (10 mm), unplanned (three sines of random periods, and a step of 10 deg).
        period: period of the sine or of breathing; otherwise 10 s or 4 s.
        probe: shape of the probe: convex, linear or t-shaped.
        seconds: duration to simulate.
        seed: seed of noise and of unplanned motion.
        method: ours, or paper: its plain admittance with its Kalman filter.
        film: write a video too, drawn without a screen.
        view: serve a page meanwhile to watch it live, in real time.
        port: first port to try for the page.
    """
    if not 0.0 < seconds <= 3600.0:
        raise InputError(f"must be more than 0 and at most 3600, not {seconds:g}.", where="--seconds")
    if seed < 0:
        raise InputError("must not be negative.", where="--seed")
    from palpate_lab.cli.phantom_run import METHODS, controller_for
    from palpate_lab.simulation.phantom.run_files import files_of

    require_known(method, METHODS, "method")
    require_new_run(output, film, files_of(output), "Name it RUN.mcap.")
    if film is not None:
        from palpate_lab.simulation.phantom.film import choose_renderer

        choose_renderer()
    lab = _lab(motion, period, probe, seed)
    wait("loading compiled loops")
    with complete_run(output, film) as (recording, video):
        run = _recorded(lab, controller_for(lab, method), seconds, video, port if view else None)
        _write(run, lab, recording)
    title(f"{probe} probe on a phantom, {motion}, method {method} -> {output}")
    lines(_figures(run, lab))
    note(["truth is on /truth/* and in _truth.csv; neither the controller nor an estimate sees it"])


def _lab(name: str, period: float | None, probe: str, seed: int) -> PhantomLab:
    from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab
    from palpate_lab.simulation.phantom.motion import motion

    moving = motion(name, period=period, seed=seed, begin=BEGIN)
    return PhantomLab(LabSettings(probe=probe, motion=moving, seed=seed))


def _recorded(
    lab: PhantomLab, controller: AlignController, seconds: float, film: Path | None, port: int | None
) -> PhantomRun:
    """Run to the end, and draw and show the run meanwhile if requested."""
    from palpate_lab.cli.phantom_run import moments
    from palpate_lab.simulation.phantom.run_files import PhantomRun

    seen: list[PhantomMoment] = []
    states: list[str] = []
    with ExitStack() as stack:
        shows = [show for show in (_filmed(lab, film, stack), _live(lab, port, stack)) if show is not None]
        for moment in moments(lab, controller, seconds):
            seen.append(moment)
            states.append(f"{controller.state.name.lower()}: {controller.why}")
            for every, show in shows:
                if (len(seen) - 1) % every == 0:
                    show(moment.truth, states[-1])
            if len(seen) % 100 == 0:
                progress(len(seen), moment.reading.time / seconds)
    commands = np.array([moment.command for moment in seen])
    return PhantomRun([each.reading for each in seen], commands, states, [each.truth for each in seen])


def _filmed(lab: PhantomLab, path: Path | None, stack: ExitStack) -> Show | None:
    """Return the function that adds a moment to the film, and its period; None without a film."""
    if path is None:
        return None
    from palpate_lab.simulation.phantom.film import Film

    film = stack.enter_context(Film(lab, path))

    def show(truth: PhantomTruth, state: str) -> None:
        film.add(_words(truth, state.partition(":")[0]))

    return FRAMED, show


def _live(lab: PhantomLab, port: int | None, stack: ExitStack) -> Show | None:
    """Return the function that shows a moment on the page in real time, and its period; None without a page."""
    if port is None:
        return None
    from palpate_lab.cli.phantom_run import FORCE
    from palpate_lab.viewer.live_probe import LiveProbe

    page = stack.enter_context(LiveProbe(lab.probe.vertices, lab.probe.faces, PLATE, FORCE, port=port))
    announce(f"open {page.address} in a browser; Ctrl-C ends the run and leaves no file")
    start = monotonic()

    def show(truth: PhantomTruth, state: str) -> None:
        place = truth.sensor.apply(np.nan_to_num(truth.centre))
        angles = truth.in_plane, truth.out_of_plane
        push = np.stack([place, truth.force])
        page.show(truth.time, truth.sensor, truth.phantom, push, angles, state, lab.links())
        sleep(max(0.0, start + truth.time - monotonic()))

    return SHOWN, show


def _words(truth: PhantomTruth, state: str) -> str:
    turned = np.degrees([truth.in_plane, truth.out_of_plane])
    return f"{truth.time:5.1f} s  {state}  {truth.press:4.1f} N  {turned[0]:+5.2f} {turned[1]:+5.2f} deg"


def _write(run: PhantomRun, lab: PhantomLab, recording: Path) -> None:
    from palpate.files.models.kinds import write_model
    from palpate_lab.cli.phantom_run import phantom_payload
    from palpate_lab.simulation.phantom.run_files import files_of, write_run

    wait("writing")
    write_run(run, lab, recording, recording.stem)
    write_model(files_of(recording)["payload"], phantom_payload(lab))


def _figures(run: PhantomRun, lab: PhantomLab) -> list[tuple[str, object]]:
    """Return force and angles from when the phantom began to move."""
    moved = [truth for truth in run.truths if truth.time >= lab.settings.motion.begin] or run.truths
    press = np.array([truth.press for truth in moved])
    angle = np.degrees([truth.angle for truth in moved])
    lost = float((press <= 0.0).mean())
    return [
        ("seconds", Quantity(f"{run.truths[-1].time:.1f}", run.truths[-1].time)),
        ("at the end", run.states[-1]),
        ("force", Quantity(f"{press.min():.2f} to {press.max():.2f} N", [float(press.min()), float(press.max())])),
        (
            "angle",
            Quantity(f"{angle.mean():.2f} +- {angle.std():.2f} deg, worst {angle.max():.2f}", float(angle.mean())),
        ),
        ("without contact", Quantity(f"{lost:.1%} of the time", lost)),
    ]
