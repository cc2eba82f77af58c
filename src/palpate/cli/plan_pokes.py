"""`palpate plan pokes`: where to poke a skin next, and how many pokes more it takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import Positional, arg

from palpate.calibration.taxels import Priors
from palpate.calibration.taxels.plan import Candidates, Plan, candidates, known_after, plan_pokes
from palpate.calibration.taxels.units import Units, fitted, single
from palpate.cli.calibrate_taxels import found_pokes
from palpate.cli.console import lines, note, title
from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import FileOption, Output
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.rig import load_rig
from palpate.io.rig.pokes import RigPokes
from palpate.io.taxel_files import read_taxel_places
from palpate.sensors.pokes import Pokes
from palpate.sensors.taxel_modules import ModuleLayout
from palpate.sensors.taxel_places import TaxelPlaces
from palpate.spatial.pose import Pose

__all__ = ["plan_pokes_command"]

RigArgument = Annotated[Positional[Path], arg(metavar="RIG")]
File = Annotated[Path, arg(metavar="FILE")]
_COLUMNS = ("configuration", "taxel", "x", "y", "z", "dx", "dy", "dz", "worst")


def plan_pokes_command(
    rig: RigArgument,
    /,
    skin: File,
    output: Output,
    log: FileOption = None,
    wanted: Annotated[float, arg(metavar="X")] = 2e-3,
    pokes: Annotated[int, arg(metavar="N")] = 100,
) -> None:
    """Say which pokes shrink the largest deviation of a taxel most, one after the other, until it is small enough.

    Args:
        rig: as of the calibration, with [pokes].
        skin: places that were found so far.
        output: next.csv to write: configuration, taxel, place [m] and direction of the force in the link's frame, and
            the largest deviation [m] after it.
        log: of the pokes made so far: it says in which configurations the arm was, and what was poked in each. The one
            that the skin was made from, if it is not given and lies beside the skin.
        wanted: largest deviation of a taxel (root of the trace) that is good enough [m].
        pokes: to plan at most.
    """
    setup = load_rig(rig)
    table = setup.pokes or RigPokes()
    places = read_taxel_places(skin)
    made_from = _log(places, skin) if log is None else log
    keep_inputs(output, (rig, skin, made_from, *setup.files().values()))
    if not (wanted >= 0 and pokes >= 1):
        raise InputError("wanted must not be negative, and pokes positive.", where="--wanted, --pokes")
    if setup.surface is not None:
        import_mesh_reader()
    surface = None if setup.surface is None else setup.surface.load(setup.folder)
    made = found_pokes(made_from, setup, places)
    layout = ModuleLayout.of(places)
    units = fitted(layout, places.positions, surface) if layout.modules else single(places.positions, surface)
    first = np.unique(made.configuration, return_index=True)[1]
    poses, priors = Pose(made.rotation[first], made.origin[first]), Priors(**table.priors.stated())
    options = candidates(units, poses, made.noise)
    deviations = None if table.start is None else units.each(priors.start, priors.start_angle)
    count = len(poses.translation)
    known = known_after(units, options, _times(made, options), priors, count, deviations)
    plan = plan_pokes(units, known, options, wanted=wanted, pokes=pokes)
    _write(output, options, plan)
    title(f"{rig} -> {output}")
    lines(_figures(made, units, plan, wanted))
    note(_advice(plan, wanted))


def _log(places: TaxelPlaces, skin: Path) -> Path:
    """What places were made from, as they say themselves."""
    name = places.provenance.get("pokes", "").rsplit(" ", 1)[0]
    path = skin.parent / name
    if not name or not path.is_file():
        raise InputError(
            "nothing says in which configurations the arm was, and what was poked so far.",
            where=str(skin),
            hint="Name the log of the pokes: --log FILE.",
        )
    return path


def _times(made: Pokes, options: Candidates) -> Float[np.ndarray, " c"]:
    """How often each candidate was made: that of the nearest direction, on the taxel that answered most."""
    times = np.zeros(len(options.taxel))
    outward = -np.einsum("nij,ni->nj", made.rotation, made.wrench[:, :3])  # of the link
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    for k in np.flatnonzero(made.weight > 0).tolist():
        rows = slice(*made.starts[k : k + 2])
        strongest = made.taxel[rows][int(np.argmax(made.response[rows]))]
        fit = np.flatnonzero((options.taxel == strongest) & (options.configuration == made.configuration[k]))
        if len(fit):
            times[fit[int(np.argmin(options.direction[fit] @ outward[k]))]] += made.weight[k]
    return times


def _write(path: Path, options: Candidates, plan: Plan) -> None:
    rows = [",".join(_COLUMNS)]
    for k, worst in zip(plan.chosen.tolist(), plan.worst[1:].tolist(), strict=True):
        numbers = (*options.point[k], *options.direction[k], worst)
        rows.append(f"{options.configuration[k]},{options.taxel[k]}," + ",".join(f"{value:.6g}" for value in numbers))
    write_text(path, "\n".join([*rows, ""]))


def _figures(made: Pokes, units: Units, plan: Plan, wanted: float) -> list[tuple[str, str]]:
    return [
        ("so far", f"{len(made)} pokes in {made.configurations} configurations, {len(units.taxels)} taxels"),
        ("worst taxel", f"{1e3 * plan.worst[0]:.2f} mm now, {1e3 * plan.worst[-1]:.2f} mm after {plan.needed} pokes"),
        ("wanted", f"{1e3 * wanted:.2f} mm"),
    ]


def _advice(plan: Plan, wanted: float) -> list[str]:
    if plan.reached and not plan.needed:
        return ["it is enough: no poke more is needed"]
    if plan.reached:
        return [f"{plan.needed} pokes more, and every taxel is known to {1e3 * wanted:.2f} mm"]
    gained = 1e3 * (plan.worst[0] - plan.worst[-1])
    return [
        f"{plan.needed} pokes are not enough: they gain {gained:.2f} mm; plan more with --pokes, or poke in other "
        "configurations, or start from CAD"
    ]
