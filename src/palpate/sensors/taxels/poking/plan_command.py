"""Define `palpate plan pokes`, which plans the next pokes of a skin and their number."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from palpate.console.console import lines, note, title
from palpate.console.options import Output
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.poking import Priors
from palpate.sensors.taxels.poking.plan import Plan, PossiblePokes, after_calibration, plan_pokes
from palpate.setup import load_rig
from palpate.setup.pokes import RigPokes

__all__ = ["plan_pokes_command"]

_COLUMNS = "configuration,taxel,x,y,z,dx,dy,dz,worst"


def plan_pokes_command(
    rig: Annotated[Positional[Path], arg(metavar="RIG")],
    /,
    skin: Annotated[Path, arg(metavar="FILE")],
    output: Output,
    wanted: Annotated[float, arg(metavar="X")] = 2e-3,
    pokes: Annotated[int, arg(metavar="N")] = 100,
) -> None:
    """Propose where to poke a skin next.

    Say which pokes shrink the largest deviation of a taxel most, one after the other, until it is small enough.

    Args:
        rig: as of the calibration, with [pokes].
        skin: places found so far, as `palpate calibrate taxels` wrote them (.toml).
        output: next.csv to write: configuration, taxel, place [m] and direction of the force in the link's frame, and
            the largest deviation [m] after it.
        wanted: largest deviation of a taxel (root of the trace) that is good enough [m].
        pokes: largest number of pokes to plan.

    Raises:
        InputError: a file that cannot be read or written, a number out of range, or a skin that states no pokes.
    """
    setup = load_rig(rig)
    table = setup.pokes or RigPokes()
    keep_inputs(output, (rig, skin, *setup.files().values()))
    if not (wanted >= 0 and pokes >= 1):
        raise InputError("wanted must not be negative, and pokes must be positive.", where="--wanted, --pokes")
    surface = None if setup.surface is None else setup.surface.load(setup.folder)
    places = read_taxel_places(skin)
    priors = Priors(**table.priors.stated())
    units, known, options = after_calibration(places, surface, priors, start=table.start is not None)
    plan = plan_pokes(units, known, options, wanted=wanted, pokes=pokes)
    _write(output, options, plan)
    title(f"{rig} -> {output}")
    more = len(plan.chosen)
    lines(
        [
            ("so far", f"{places.configurations[:, 7].sum():.0f} pokes in {len(places.configurations)} configurations"),
            ("worst taxel", f"{1e3 * plan.worst[0]:.2f} mm now, {1e3 * plan.worst[-1]:.2f} mm after {more} pokes"),
            ("wanted", f"{1e3 * wanted:.2f} mm"),
        ]
    )
    note([_advice(plan, wanted)])


def _write(path: Path, options: PossiblePokes, plan: Plan) -> None:
    rows = [",".join(_COLUMNS)]
    for k, worst in zip(plan.chosen.tolist(), plan.worst[1:].tolist(), strict=True):
        numbers = (*options.point[k], *options.direction[k], worst)
        rows.append(f"{options.configuration[k]},{options.taxel[k]}," + ",".join(f"{value:.6g}" for value in numbers))
    write_text(path, "\n".join([*rows, ""]))


def _advice(plan: Plan, wanted: float) -> str:
    more = len(plan.chosen)
    if plan.reached:
        enough = f"with {more} more pokes every taxel is known to {1e3 * wanted:.2f} mm"
        return enough if more else "the pokes so far are enough: no more are needed"
    gained = 1e3 * (plan.worst[0] - plan.worst[-1])
    return (
        f"{more} more pokes are not enough: they gain {gained:.2f} mm; plan more with --pokes, or poke in other "
        "configurations, or start from CAD"
    )
