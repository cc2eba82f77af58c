"""`palpate demo`: run the chain of commands on a simulated session, from a robot's log to contacts on a probe."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import FlagCreatePairsOff, arg

from palpate.cli import main
from palpate.console.console import announce, muted, step, table, title
from palpate.contact.estimate import Status
from palpate.errors import InputError
from palpate.evaluation.evaluate import EvaluationReport
from palpate.evaluation.evaluate import evaluate as judged
from palpate.files.atomic import reserve_output
from palpate.files.contacts import read_contacts
from palpate.files.ground_truth import read_ground_truth
from palpate.files.models import read_model
from palpate.setup import load_rig
from palpate.signals.payload import Payload
from palpate.spatial.pose import skew
from palpate_lab.cli.simulate import require_new

if TYPE_CHECKING:
    from palpate_lab.simulation.session import Session

CHAIN = (
    ("What is in the log and in the mesh?", "inspect touches.mcap", "inspect probe.stl"),
    ("Is the arm's clock the sensor's?", "calibrate clock free_motion.mcap --rig rig.toml -o rig.toml"),
    ("Which payload does the sensor carry?", "calibrate payload free_motion.mcap --rig rig.toml -o payload.toml"),
    (
        "Contacts with the probe where the drawing has it.",
        "estimate touches.mcap --rig rig.toml -o contacts_by_drawing.csv",
    ),
    (
        "Where does the probe really sit? Every other touch was at a known mark.",
        "calibrate mounting touches.mcap --rig rig.toml --marks marks.csv -o rig.toml",
    ),
    (
        "Contacts with the probe where it is: as a table, as a log that Foxglove and rerun open, and as a page.",
        "estimate touches.mcap --rig rig.toml -o contacts.csv --report report.html --truth truth.csv",
        "estimate touches.mcap --rig rig.toml -o contacts.mcap",
    ),
    ("When and where was it touched?", "events contacts.csv"),
    ("The touches that were not used, judged.", "evaluate contacts.csv truth.csv"),
)
VIEW = "view touches.mcap --rig rig.toml"
NEEDED = ("rosbags", "jinja2", "matplotlib")  # not in every installation; viser too if the page is served
Row = tuple[str, str, str]
Flag = Annotated[bool, FlagCreatePairsOff]


def demo(
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")] = Path("palpate_demo"),
    view: Flag = False,
    no_view: Flag = False,
    force: Flag = False,
) -> None:
    """Simulate a session, and run every step on it.

    Make up a robot's session, run the whole chain of commands on it, and compare what is found with the truth.

    A probe of 60 x 25 x 40 mm sits on a force/torque sensor, 1.2 mm and 1.5 degrees off its drawing; the arm's clock is
    30 ms behind the sensor's. The arm moves freely, then the probe is touched at 20 marks. Ten of the touches place the
    probe, the other ten judge where contacts are found. On a terminal a page is served then, until Ctrl-C.

    Args:
        output: folder to make: logs, mesh, rig, contacts, report.html.
        view: serve the page without a terminal too.
        no_view: end without the page.
        force: write into a folder that is not empty, such as an earlier demo's.
    """
    shown = view or (sys.stdout.isatty() and not no_view and not muted())
    _require_extras(("viser", *NEEDED) if shown else NEEDED)
    if force:
        reserve_output(output)
    else:
        require_new(output)
    from palpate_lab.simulation.session import simulate_session  # here: with them comes scipy
    from palpate_lab.simulation.session_files import write_session
    from palpate_lab.simulation.session_mcap import write_session_mcap

    session = simulate_session()
    write_session(session, output)
    write_session_mcap(session, output)
    with contextlib.chdir(output):
        for why, *commands in CHAIN:
            step(f"\n# {why}")
            for command in commands:
                _run(command)
    _summarise(session, output)
    if shown:
        with contextlib.chdir(output):
            _run(VIEW)
    else:
        announce(f"to look around: cd {output}; palpate {VIEW}")


def _require_extras(modules: Sequence[str]) -> None:
    """Report all missing packages in one sentence, before any work.

    Raises:
        InputError: one of them is not installed.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise InputError(f"the demo needs {', '.join(missing)}.", hint="pip install 'palpate[all]'")


def _run(command: str) -> None:
    """Run a command in this process as if typed, because starting a process takes longer than most of them."""
    step(f"$ palpate {command}")
    if code := main([*command.split(), *muted()]):
        raise SystemExit(code)


def _summarise(session: Session, folder: Path) -> None:
    """Print short tables that compare the truth with what was found."""
    status = read_contacts(folder / "contacts.csv").estimate.status
    shares = [f"{kind.label} {np.mean(status == kind):.1%}" for kind in Status if np.any(status == kind)]
    step("")
    title(f"what the simulation knows, and what was found -> {folder}")
    table(("", "true", "found"), [_clock(folder), *_payload(session, folder), *_mounting(session, folder)])
    step("")
    reports = [_report(folder, name) for name in ("contacts_by_drawing.csv", "contacts.csv")]
    table(("", "by drawing", "mounting calibrated"), _judged(reports))
    step("")
    announce(f"all {len(status):,} samples: {', '.join(shares)}")
    announce(f"contacts.csv, contacts.mcap, report.html, and all that they came from are in {folder}/")


def _clock(folder: Path) -> Row:
    from palpate_lab.simulation.session_mcap import CLOCK_OFFSET

    found = load_rig(folder / "rig.toml").orientation.offset
    return "clock offset [ms]", f"{1e3 * CLOCK_OFFSET:.1f}", f"{1e3 * found:.1f}"


def _payload(session: Session, folder: Path) -> list[Row]:
    load, found = session.load, read_model(folder / "payload.toml", Payload)
    spread = np.sqrt(np.diag(found.covariance)).reshape(4, 3).max(axis=1)  # weight, force bias, centre, torque bias
    return [
        _figures("mass [kg]", np.array([load.mass]), np.array([found.mass]), spread[0] / found.magnitude, 4),
        _figures("centre of mass [mm]", 1e3 * load.center_of_mass, 1e3 * found.center_of_mass, 1e3 * spread[2], 2),
        _figures("force bias [N]", load.force_bias, found.force_bias, spread[1], 4),
        _figures("torque bias [N m]", load.torque_bias, found.torque_bias, spread[3], 5),
    ]


def _mounting(session: Session, folder: Path) -> list[Row]:
    surface, true = load_rig(folder / "rig.toml").surface, session.true
    if surface is None:
        raise InputError("no longer has a [surface].", where=str(folder / "rig.toml"))
    found, covariance = surface.pose.pose(), np.array(surface.pose_covariance)
    moves = np.concatenate([-skew(found.translation), np.eye(3)], axis=1)  # what a small motion does to the origin
    place = np.sqrt(np.diag(moves @ covariance @ moves.T)).max()
    turn = np.sqrt(np.diag(covariance)[:3].max())
    wanted, got = (np.degrees(pose.rotation_vector()) for pose in (true, found))
    return [
        _figures("probe sits at [mm]", 1e3 * true.translation, 1e3 * found.translation, 1e3 * place, 2),
        _figures("probe turned by [deg]", wanted, got, np.degrees(turn), 2),
    ]


def _judged(reports: list[EvaluationReport]) -> list[Row]:
    places = [report.location for report in reports]
    first, second = (
        ("none", "none") if it is None else (f"{1e3 * it.mean:.2f}", f"{1e3 * it.worst:.2f}") for it in places
    )
    inside = [f"{report.coverage.inside:.0%}" for report in reports]
    return [
        ("touch off by, mean [mm]", first[0], second[0]),
        ("touch off by, worst [mm]", first[1], second[1]),
        ("truth in 95 % ellipse", inside[0], inside[1]),
    ]


def _figures(
    name: str, true: Float[np.ndarray, " n"], found: Float[np.ndarray, " n"], spread: float, digits: int
) -> Row:
    left, right = (", ".join(f"{value:.{digits}f}" for value in values) for values in (true, found))
    return name, left, f"{right} +- {spread:.{digits}f}"


def _report(folder: Path, name: str) -> EvaluationReport:
    return judged(read_contacts(folder / name), read_ground_truth(folder / "truth.csv"))
