"""From a robot's log to contacts on a probe: the whole chain of commands on a session that is made here.

A probe of 60 x 25 x 40 mm sits on a force/torque sensor, 1.2 mm and 1.5 degrees off its drawing; the arm's clock is
30 ms behind the sensor's. The arm moves freely, then the probe is touched at 20 marks. Ten of the touches place the
probe, the other ten judge where contacts are found. Writes into the folder given (default: demo) and prints what the
simulation knows beside what was found. On a terminal it then serves the page until Ctrl-C; `--no-view` ends at once.
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import numpy as np

from palpate.cli import main as palpate
from palpate.contact.estimate import Status
from palpate.evaluation.evaluate import Report, evaluate
from palpate.io.contacts import read_contacts
from palpate.io.ground_truth import read_ground_truth
from palpate.io.models import read_model
from palpate.io.rig import load_rig
from palpate.sensors.force_torque import Payload
from palpate.simulation.session import Session, simulate_session
from palpate.simulation.session_files import write_session
from palpate.simulation.session_mcap import CLOCK_OFFSET, write_session_mcap
from palpate.spatial.pose import skew

CHAIN = (
    ("What is in the log and in the mesh?", "inspect touches.mcap", "inspect probe.stl"),
    ("Is the arm's clock the sensor's?", "calibrate clock free_motion.mcap --rig rig.toml -o rig.toml"),
    ("What hangs on the sensor?", "calibrate payload free_motion.mcap --rig rig.toml -o payload.toml"),
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


def main(folder: Path, *, view: bool) -> None:
    """Make a session, run the commands on it, compare, and show."""
    session = simulate_session()
    write_session(session, folder)
    write_session_mcap(session, folder)
    with contextlib.chdir(folder):
        for why, *commands in CHAIN:
            print(f"\n# {why}", flush=True)
            for command in commands:
                _run(command)
    print("\n" + "\n".join(summary(session, folder)))
    if view:
        with contextlib.chdir(folder):
            _run(VIEW)
    else:
        print(f"to look around: cd {folder}; palpate {VIEW}")


def _run(command: str) -> None:
    """As if typed, in this process: starting one a command would take longer than most of them."""
    print(f"$ palpate {command}", flush=True)
    if code := palpate(command.split()):
        sys.exit(code)


def summary(session: Session, folder: Path) -> list[str]:
    """The table that a person reads in ten seconds."""
    status = read_contacts(folder / "contacts.csv").estimate.status
    shares = [f"{kind.label} {np.mean(status == kind):.1%}" for kind in Status if np.any(status == kind)]
    return [
        _row("", "true", "found"),
        _row("clock offset [ms]", f"{1e3 * CLOCK_OFFSET:.1f}", f"{1e3 * _offset(folder):.1f}"),
        *_payload(session, folder),
        *_mounting(session, folder),
        "",
        _row("", "by drawing", "mounting calibrated"),
        *_judged([_report(folder, name) for name in ("contacts_by_drawing.csv", "contacts.csv")]),
        "",
        f"all {len(status):,} samples: {', '.join(shares)}",
        f"contacts.csv, contacts.mcap, report.html, and all that they came from are in {folder}/",
    ]


def _offset(folder: Path) -> float:
    return load_rig(folder / "rig.toml").orientation.offset


def _payload(session: Session, folder: Path) -> list[str]:
    load, found = session.load, read_model(folder / "payload.toml", Payload)
    spread = np.sqrt(np.diag(found.covariance)).reshape(4, 3).max(axis=1)  # weight, force bias, centre, torque bias
    return [
        _figures("mass [kg]", np.array([load.mass]), np.array([found.mass]), spread[0] / found.magnitude, 4),
        _figures("centre of mass [mm]", 1e3 * load.center_of_mass, 1e3 * found.center_of_mass, 1e3 * spread[2], 2),
        _figures("force bias [N]", load.force_bias, found.force_bias, spread[1], 4),
        _figures("torque bias [N m]", load.torque_bias, found.torque_bias, spread[3], 5),
    ]


def _mounting(session: Session, folder: Path) -> list[str]:
    surface, true = load_rig(folder / "rig.toml").surface, session.true
    found, covariance = surface.pose.pose(), np.array(surface.pose_covariance)
    moves = np.concatenate([-skew(found.translation), np.eye(3)], axis=1)  # what a small motion does to the origin
    place = np.sqrt(np.diag(moves @ covariance @ moves.T)).max()
    turn = np.sqrt(np.diag(covariance)[:3].max())
    angles = (np.degrees(pose.rotation_vector()) for pose in (true, found))
    return [
        _figures("probe sits at [mm]", 1e3 * true.translation, 1e3 * found.translation, 1e3 * place, 2),
        _figures("probe turned by [deg]", *angles, np.degrees(turn), 2),
    ]


def _judged(reports: list[Report]) -> list[str]:
    located = [report.location for report in reports if report.location]
    return [
        _row("touch off by, mean [mm]", *(f"{1e3 * spread.mean:.2f}" for spread in located)),
        _row("touch off by, worst [mm]", *(f"{1e3 * spread.worst:.2f}" for spread in located)),
        _row("truth in 95 % ellipse", *(f"{report.coverage.inside:.0%}" for report in reports)),
    ]


def _figures(name: str, true: np.ndarray, found: np.ndarray, spread: float, digits: int) -> str:
    left, right = (", ".join(f"{value:.{digits}f}" for value in values) for values in (true, found))
    return _row(name, left, f"{right} +- {spread:.{digits}f}")


def _row(name: str, left: str, right: str) -> str:
    return f"{name:24}{left:>30}   {right}"


def _report(folder: Path, name: str) -> Report:
    found = read_contacts(folder / name)
    return evaluate(found, read_ground_truth(folder / "truth.csv"))


if __name__ == "__main__":
    folders = [name for name in sys.argv[1:] if name != "--no-view"]
    main(Path(folders[0] if folders else "demo"), view="--no-view" not in sys.argv and sys.stdout.isatty())
