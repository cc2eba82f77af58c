"""`palpate calibrate taxels`: from pokes to where each taxel of a skin sits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from palpate.calibration.taxels import Priors, TaxelCalibration, calibrate_taxels
from palpate.calibration.taxels.answers import Block
from palpate.calibration.taxels.believe import believed
from palpate.calibration.taxels.find import PokeSearch, find_pokes
from palpate.calibration.taxels.place import place_modules
from palpate.cli.console import Figure, counting, lines, note, progress, title, wait
from palpate.cli.evaluate_taxels import is_taxel_file
from palpate.cli.options import FileOption, Log, Output, RigFile, Scalar
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.logs import contents
from palpate.io.models import provenance
from palpate.io.models.taxels import of_taxels
from palpate.io.poke_files import holds_pokes, read_pokes
from palpate.io.rig import load_rig
from palpate.io.rig.force_torque import ForceTorqueSection
from palpate.io.rig.poke_log import open_pokes
from palpate.io.rig.pokes import RigPokes
from palpate.io.rig.setup import Setup
from palpate.io.rig.skin import SkinSection
from palpate.io.rig.tables import RigForceTorque
from palpate.io.taxel_files import SUFFIXES, read_taxel_places, write_taxel_places
from palpate.sensors.pokes import Pokes
from palpate.sensors.recording import Recording
from palpate.sensors.taxel_modules import LAYOUTS, ModuleLayout
from palpate.sensors.taxel_places import TaxelPlaces
from palpate.surfaces import Surface

__all__ = ["calibrate_taxels_command"]

METHOD = Literal["modules", "taxels", "surface", "weighted", "free"]


def calibrate_taxels_command(
    log: Log,
    /,
    rig: RigFile,
    output: Output,
    method: Annotated[METHOD, arg(metavar="NAME")] = "modules",
    start: FileOption = None,
    layout: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    threshold: Scalar = None,
) -> None:
    """Find where each taxel of a skin sits, from the wrenches of pokes in several arm configurations.

    Begin with a second in which nothing touches; poke with a small tip, a second each, over the whole skin, with pauses
    between; move the arm and poke again, in three configurations or more.

    Args:
        log: of wrenches, taxels and joint states, /tf or poses; or a table with one row a poke: configuration, fx,fy,
            fz,tx,ty,tz, qx,qy,qz,qw,x,y,z of the link in the sensor's frame, t0,t1,...; or places of taxels that were
            found elsewhere, which modules are laid on.
        rig: TOML with [skin], [force_torque], [pokes] and, as a rule, [surface].
        output: where they sit: .toml (all that is known), .txt (iCub), .csv or .urdf.
        method: modules: rigid modules of known layout, with the errors of sensor and robot; taxels: each for itself,
            with bias and frames; surface, weighted, free: as published, each for itself.
        start: file of where they are thought to be (CAD), in place of the rig's.
        layout: of modules, in place of the rig's: ring12, triangle10, triangle10+2, or a file of taxels.
        threshold: above its rest, at which a taxel answers; found where it is not given.
    """
    stated = load_rig(rig)
    if output.suffix.lower() not in SUFFIXES:
        hint = f"Use {', '.join(SUFFIXES)}."
        raise InputError(f"cannot write places of taxels as {output.suffix!r}.", where=str(output), hint=hint)
    table = _over(stated.pokes or RigPokes(), threshold)
    begun = start or (None if table.start is None else stated.folder / table.start)
    keep_inputs(output, (log, rig, begun, *stated.files().values()))
    setup = replace(stated.resolve(), pokes=table)
    surface = None if setup.link.stated is None else setup.link.surface()
    if is_taxel_file(log):
        _place(log, setup, method, layout, (output, rig, surface))
        return
    places = None if begun is None else read_taxel_places(begun)
    pokes = _pokes(log, setup, places)
    modules, said = _layout(layout, setup, places, pokes) if method == "modules" else (None, [])
    wait("loading the compiled loops (the first time they are compiled, which takes a while) ...")
    found = calibrate_taxels(
        pokes,
        method=method,
        surface=surface if method not in ("free", "weighted") else None,
        start=places,
        layout=modules,
        priors=Priors(**table.priors.stated()),
    )
    record = provenance({"pokes": log, "rig": rig, "start": begun}, {"method": method, "layout": layout})
    notes = (*found.places.notes, *pokes.notes, *found.notes)
    write_taxel_places(output, replace(found.places, provenance=record, notes=notes))
    title(f"{log} -> {output}")
    lines(_figures(pokes, found))
    note([*pokes.notes, *said, *found.notes])
    note([*found.doubts, *_one_configuration(pokes, found)], kind="warning")
    note(_next(setup, output, surface))


def _place(path: Path, setup: Setup, method: str, layout: str | None, rest: tuple[Path, Path, Surface | None]) -> None:
    """Places in place of pokes: modules are laid where their taxels come nearest to them."""
    output, rig_file, surface = rest
    if method != "modules":
        raise InputError("places of taxels can only be made better as those of modules.", where="--method")
    places = read_taxel_places(path)
    modules, said = _layout(layout, setup, places, None)
    found = place_modules(places, modules, surface)
    record = provenance({"places": path, "rig": rig_file}, {"method": method, "layout": layout})
    write_taxel_places(output, replace(found.places, provenance=record, notes=(*found.places.notes, *found.notes)))
    title(f"{path} -> {output}")
    lines(of_taxels(found.places))
    note([*said, *found.notes])
    note(found.doubts, kind="warning")


def _over(table: RigPokes, threshold: float | None) -> RigPokes:
    try:
        return table if threshold is None else replace(table, threshold=threshold)
    except ValueError as problem:
        raise InputError(f"{problem}.", where="--threshold") from problem


def _pokes(log: Path, setup: Setup, start: TaxelPlaces | None) -> Pokes:
    """Return the pokes of a table, or those found in a log."""
    table, wrench = setup.pokes or RigPokes(), RigForceTorque()
    if ForceTorqueSection.name in setup.sensors:
        wrench = setup.of(ForceTorqueSection).table
    noise, limits = wrench.noise, wrench.range
    if holds_pokes(list(contents(log).names)):
        covariance = None if noise is None else np.diag(noise.six() ** 2)
        return believed(read_pokes(log, threshold=table.threshold or 0.0, noise=covariance), start=start)
    if SkinSection.name not in setup.sensors:
        hint = "Add a [skin] with count = N, or taxels = FILE, and where the log keeps their readings."
        raise InputError("the rig does not say what the taxels of the log are.", where="rig", hint=hint)
    bits, curves = setup.of(SkinSection).table.bits, setup.of(SkinSection).intensity
    search = PokeSearch(
        threshold=table.threshold,
        pose=None if table.pose is None else table.pose.pose(),
        top=2.0**bits - 1.0 if bits else np.inf,
        falling=curves is not None and curves.curves[0].falling,
        limits=None if limits is None else limits.six(),
        start=start,
    )
    wrenches, frames, parts = open_pokes(log, setup)

    def counted() -> Iterator[Recording | Block]:
        done = 0
        for part in parts:
            if isinstance(part, Recording):
                done += len(part)
                progress(done, wrenches.position / max(wrenches.size, 1))
            yield part

    with counting():
        found = find_pokes(counted(), search)
    torn = [said for said in (wrenches.torn, frames.torn) if said]
    said = dict.fromkeys((*torn, *wrenches.notes(), *frames.notes(), *found.notes))
    return replace(found, notes=tuple(said))


def _layout(
    name: str | None, setup: Setup, start: TaxelPlaces | None, pokes: Pokes | None
) -> tuple[ModuleLayout | None, list[str]]:
    """Of the modules: by name or file; None: that of the start. Without a start those that never answered are left out.

    Raises:
        InputError: no such layout, or it does not fit the taxels.
    """
    chosen = name or (setup.pokes.layout if setup.pokes is not None else None)
    if chosen is None:
        return None, []
    if chosen not in LAYOUTS:
        path = Path(chosen) if name is not None else setup.link.folder / chosen
        if not path.exists():
            hint = f"Use {', '.join(LAYOUTS)}, or a file of taxels."
            raise InputError(f"there is no layout {chosen!r}.", where="layout", hint=hint)
        return ModuleLayout.of(read_taxel_places(path), bent=True), []
    places = LAYOUTS[chosen]
    taxels = len(start or ()) if pokes is None else pokes.taxels
    count, left = divmod(taxels, len(places))
    if left:
        raise InputError(f"{taxels} taxels are not modules of {len(places)}, as {chosen} has them.", where="layout")
    whole = ModuleLayout.repeated(places, count)
    there = np.ones(taxels, dtype=bool) if start is None else start.there
    if start is None and pokes is not None:
        there = _answered(whole, pokes)
    flat, module = np.where(there[:, None], whole.places, np.nan), np.where(there, whole.module, -1)
    known = np.isfinite(flat).all(axis=1)
    kept = np.unique(module[known & (module >= 0)])
    module = np.where(known, np.searchsorted(kept, module), -1)
    absent = sorted(set(range(count)) - set(kept.tolist()))
    said = f"modules {', '.join(map(str, absent[:12]))} never answered: they are left out, as if they were not there"
    return ModuleLayout(flat, module), [said] if absent and start is None else []


def _answered(layout: ModuleLayout, pokes: Pokes) -> np.ndarray:
    """Taxels of modules of which one at least answered."""
    count = np.bincount(layout.module, pokes.counts(), minlength=layout.modules)
    return count[layout.module] > 0


def _figures(pokes: Pokes, found: TaxelCalibration) -> list[tuple[str, object]]:
    rejected, weighed = int((pokes.weight == 0).sum()), int(((pokes.weight > 0) & (pokes.weight < 1)).sum())
    counted = {"found": len(pokes), "used": found.used, "rejected": rejected, "weighed down": weighed}
    answers = len(pokes.taxel) / max(len(pokes), 1)
    deviation = np.sqrt(np.diag(pokes.noise))
    said = f"{1e3 * deviation[:3].max():.3g} mN, {1e3 * deviation[3:].max():.3g} N mm of a poke's wrench"
    facts: list[tuple[str, object]] = [
        ("pokes", Figure(", ".join(f"{count} {what}" for what, count in counted.items()), counted)),
        ("configurations", f"{pokes.configurations}"),
        ("answers", f"{answers:.1f} taxels a poke, above {pokes.threshold:.3g}"),
        ("noise", f"{said}; residuals are {found.noise:.2f} times what is explained"),
        *of_taxels(found.places),
    ]
    return [*facts, *_nuisances(found)]


def _nuisances(found: TaxelCalibration) -> list[tuple[str, object]]:
    """The largest of each kind of error of sensor and robot."""
    said = list[tuple[str, object]]()
    for name, words in (("frames", "of each configuration"), ("common", "of all")):
        if (value := found.nuisances.get(name)) is not None and value.size:
            six = value.reshape(-1, 6)
            text = f"up to {_most(six[:, :3], 1e3)} mm, {_most(six[:, 3:], 180 / np.pi)} degrees"
            said.append((f"frame {words}", Figure(text, value)))
    if (value := found.nuisances.get("bias")) is not None and value.size:
        text = f"up to {_most(value[:, :3], 1.0)} N, {_most(value[:, 3:], 1e3)} N mm"
        said.append(("bias", Figure(text, value)))
    if (value := found.nuisances.get("cross_talk")) is not None and value.size:
        same = max(float(np.abs(value[:3, :3]).max()), float(np.abs(value[3:, 3:]).max()))
        said.append(("cross-talk", Figure(f"up to {100 * same:.2g} % among forces, or among torques", value)))
    return said


def _most(rows: np.ndarray, scale: float) -> str:
    return f"{scale * float(np.linalg.norm(rows, axis=-1).max(initial=0.0)):.3g}"


def _one_configuration(pokes: Pokes, found: TaxelCalibration) -> list[str]:
    """What the paper's methods cannot tell then; the others say it themselves."""
    if pokes.configurations > 1 or any("one arm configuration" in doubt for doubt in found.doubts):
        return []
    return [
        "there is one arm configuration only: the sensor's bias and the error of the link's frame cannot be told from "
        "a shift of all taxels"
    ]


def _next(setup: Setup, output: Path, surface: Surface | None) -> list[str]:
    said = [f'name it in the rig: taxels = "{output.name}" under [skin]']
    if surface is None:
        said.append("with the link's mesh as [surface] the taxels are known better")
    if setup.pokes is not None and setup.pokes.start is None:
        said.append("start = FILE of where they are by CAD, in [pokes], makes places absolute")
    return said
