"""Define `palpate calibrate taxels`, which finds the place of each taxel from pokes, and `palpate plan pokes`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.console import Quantity, lines, note, progress, title, wait
from palpate.console.options import FileOption, Log, NameOption, Output, RigFile, Scalar, require_positive
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.logs import contents
from palpate.sensors.taxels.files import of_taxels
from palpate.sensors.taxels.modules import LAYOUTS, ModuleLayout
from palpate.sensors.taxels.place_formats import read_taxel_places, require_suffix, write_taxel_places
from palpate.sensors.taxels.places import SURFACE_POSE, TaxelPlaces
from palpate.sensors.taxels.poking import Priors, TaxelCalibration, calibrate_taxels
from palpate.sensors.taxels.poking.activations import Block
from palpate.sensors.taxels.poking.evaluate_command import is_taxel_file
from palpate.sensors.taxels.poking.files import WRENCH, holds_pokes, open_pokes, read_pokes
from palpate.sensors.taxels.poking.module_placement import common_layout, place_modules
from palpate.sensors.taxels.poking.plan import Plan, PossiblePokes, after_calibration, plan_pokes
from palpate.sensors.taxels.poking.plausibility import believed
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.segmentation import PokeSearch, find_pokes
from palpate.sensors.taxels.section import SkinSection
from palpate.setup import load_rig
from palpate.setup.pokes import RigPokes
from palpate.setup.setup import Setup
from palpate.setup.tables import RigPose
from palpate.setup.wrench_table import RigForceTorque
from palpate.signals.recording import Recording
from palpate.surfaces import Surface

_COLUMNS = "configuration,taxel,x,y,z,dx,dy,dz,worst"


@dataclass(frozen=True)
class CalibrateTaxels(Calibration):
    """Find where each taxel sits, from the wrenches of pokes.

    Begin with a second in which nothing touches; poke with a small tip, a second each, over the whole skin, with pauses
    between; move the arm and poke again, in three configurations or more.

    Args:
        log: of wrenches, taxels and joint states, /tf or poses; or a table with one row a poke: configuration, fx,fy,
            fz,tx,ty,tz, qx,qy,qz,qw,x,y,z of the link in the sensor's frame, t0,t1,...; or places of taxels from
            another source, to which modules are fitted.
        rig: TOML with [skin], [force_torque], [pokes] and, as a rule, [surface].
        output: places of the taxels: .toml (all that is known), .txt (iCub), .csv or .urdf.
        method: modules: rigid modules of known layout, with the errors of sensor and robot; taxels: single taxels, with
            bias and frames; surface, weighted, free: as published, each taxel separately.
        start: file of expected places (CAD), in place of the rig's.
        layout: of modules, in place of the rig's: ring12, triangle10, triangle10+2, or a file of taxels, of one module
            or of all.
        spacing: distance between neighbouring taxels of a module [m], to which the layout is scaled (default: the
            layout's; if it is a known one and the pokes or places contradict it, theirs).
        threshold: reading above the baseline at which a taxel answers (default: found from its noise).
    """

    log: Log
    rig: RigFile
    output: Output
    method: Annotated[Literal["modules", "taxels", "surface", "weighted", "free"], arg(metavar="NAME")] = "modules"
    start: FileOption = None
    layout: NameOption = None
    spacing: Scalar = None
    threshold: Scalar = None

    @cached_property
    def reads(self) -> dict[str, Path]:
        """Return a dict of name -> path of the input files: pokes, rig and, if given, start and layout.

        Raises:
            InputError: the rig cannot be read.
        """
        stated = self.stated.pokes
        start = self.start or (None if stated is None or stated.start is None else self.stated.folder / stated.start)
        layout = None if self.layout is None or self.layout in LAYOUTS else Path(self.layout)
        named = {"pokes": self.log, "rig": self.rig, "start": start, "layout": layout}
        return {name: path for name, path in named.items() if path is not None}

    def identify(self) -> CalibrationResult:
        """Find taxels from pokes, or fit modules to places from another source; return a `CalibrationResult`.

        Raises:
            InputError: a bad file, option or suffix, or residuals that no places explain.
            NotIdentifiable: too few pokes.
            GeometryError: the file of the surface has no usable surface.
        """
        require_suffix(self.output)
        require_positive(self.threshold, "--threshold")
        require_positive(self.spacing, "--spacing")
        if self.spacing is not None and self.method != "modules":
            raise InputError("needs --method modules: single taxels have no layout.", where="--spacing")
        setup = self.stated.resolve()
        table = setup.pokes or RigPokes()
        setup = replace(setup, pokes=replace(table, threshold=self.threshold or table.threshold))
        surface = _in_link(setup)
        found = self._placed(setup, surface) if is_taxel_file(self.log) else self._poked(setup, surface)
        if setup.link.stated is None or setup.link.stated.pose == RigPose():
            return found
        said = "taxels are in the link's frame, in which [surface] pose has the mesh"
        lost = "" if self.output.suffix.lower() == ".toml" else ": only a .toml keeps that for other commands"
        return replace(found, notes=[*found.notes, said + lost])

    def write(self, found: CalibrationResult) -> None:
        """Write the places of the taxels with their provenance and notes to `output`.

        Raises:
            InputError: the file cannot be written.
            OSError: an input cannot be read for its digest.
        """
        stated: dict[str, object] = {"layout": self.layout, "spacing": self.spacing}
        pose = self.stated.surface.pose if self.stated.surface is not None else RigPose()
        if pose != RigPose():
            stated[SURFACE_POSE] = " ".join(repr(float(each)) for each in (*pose.xyz, *pose.quaternion_xyzw))
        record = self.record(method=self.method, **{name: each for name, each in stated.items() if each is not None})
        notes = (*found.model.notes, *found.notes)
        write_taxel_places(self.output, replace(found.model, provenance=record, notes=notes))

    def _poked(self, setup: Setup, surface: Surface | None) -> CalibrationResult:
        start = self.reads.get("start")
        places = None if start is None else read_taxel_places(start)
        pokes, table = _pokes(self.log, setup, places), setup.pokes or RigPokes()
        modules, said = (
            _layout(self.layout, setup, pokes if places is None else places) if self.method == "modules" else (None, [])
        )
        if self.spacing is not None:
            modules = ModuleLayout.of(places, bent=True) if modules is None and places is not None else modules
            modules = None if modules is None else modules.spaced(self.spacing)
        wait("loading the compiled loops (the first time they are compiled, which takes a while) ...")
        found = calibrate_taxels(
            pokes,
            method=self.method,
            surface=surface if self.method not in ("free", "weighted") else None,
            start=places,
            layout=modules,
            priors=Priors(**table.priors.stated()),
            rescale=self._rescaled(setup),
        )
        return CalibrationResult(
            _figures(pokes, found),
            found.places,
            notes=[*pokes.notes, *said, *found.notes],
            warnings=found.warnings,
            next=_next(setup, self.output, surface),
        )

    def _placed(self, setup: Setup, surface: Surface | None) -> CalibrationResult:
        if self.method != "modules":
            raise InputError(
                "must be modules, as the input is places of taxels and not a log of pokes.", where="--method"
            )
        places = read_taxel_places(self.log)
        modules, said = _layout(self.layout, setup, places)
        if self.spacing is not None:
            spacing = self.spacing
            modules = common_layout(places, surface, spacing=spacing) if modules is None else modules.spaced(spacing)
        found = place_modules(places, modules, surface, rescale=self._rescaled(setup))
        figures = [*of_taxels(found.places), ("spacing", str(found.spacing))]
        return CalibrationResult(figures, found.places, notes=[*said, *found.notes], warnings=found.warnings)

    def _rescaled(self, setup: Setup) -> bool:
        """Return whether the data may change the spacing: of a known layout, if none is stated."""
        named = self.layout or (setup.pokes.layout if setup.pokes is not None else None)
        return self.spacing is None and named in LAYOUTS


def _in_link(setup: Setup) -> Surface | None:
    """Return the rig's [surface] at its pose in the link's frame, in which the taxels are; None: there is none."""
    if setup.link.stated is None:
        return None
    surface = setup.link.surface()
    return surface if setup.link.stated.pose == RigPose() else surface.transformed(setup.link.mount)


def _pokes(log: Path, setup: Setup, start: TaxelPlaces | None) -> Pokes:
    """Return the pokes of a table, or those found in a log."""
    table, there = setup.pokes or RigPokes(), setup.sensors.get(WRENCH)
    wrench = RigForceTorque() if there is None else there.table
    noise, limits = wrench.noise, wrench.range
    if holds_pokes(list(contents(log).names)):
        covariance = None if noise is None else np.diag(noise.six() ** 2)
        return believed(read_pokes(log, threshold=table.threshold or 0.0, noise=covariance), start=start)
    if SkinSection.name not in setup.sensors:
        hint = "Add a [skin] with count = N, or taxels = FILE, and with the place of their readings in the log."
        raise InputError("the rig does not state the taxels of the log.", where="rig", hint=hint)
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

    found = find_pokes(counted(), search)
    torn = [said for said in (wrenches.torn, frames.torn) if said]
    said = dict.fromkeys((*torn, *wrenches.notes(), *frames.notes(), *found.notes))
    return replace(found, notes=tuple(said))


def _layout(name: str | None, setup: Setup, known: TaxelPlaces | Pokes) -> tuple[ModuleLayout | None, list[str]]:
    """Return the layout of the modules that exist, by name or file; None for that of the start; and notes."""
    chosen = name or (setup.pokes.layout if setup.pokes is not None else None)
    if chosen is None:
        return None, []
    taxels = known.taxels if isinstance(known, Pokes) else len(known)
    if chosen not in LAYOUTS:
        path = Path(chosen) if name is not None else setup.link.folder / chosen
        if not path.exists():
            hint = f"Use {', '.join(LAYOUTS)}, or a file of taxels."
            raise InputError(f"{chosen!r} is not known.", where="layout", hint=hint)
        read = read_taxel_places(path)
        if len(read) == taxels or read.modules > 1:
            return ModuleLayout.of(read, bent=True), []
        one = replace(read, module=np.where(read.there, 0, -1))
        places = ModuleLayout.of(one, bent=True).places
    else:
        places = LAYOUTS[chosen]
    count, left = divmod(taxels, len(places))
    if left:
        raise InputError(
            f"{taxels} taxels cannot be divided into modules of {len(places)}, as in {chosen}.", where="layout"
        )
    whole = ModuleLayout.repeated(places, count)
    answered = known.counts() if isinstance(known, Pokes) else known.there
    there = np.bincount(whole.module, answered, minlength=count)[whole.module] > 0
    there = there & np.isfinite(whole.places).all(axis=1)
    kept = np.unique(whole.module[there])
    absent = np.setdiff1d(np.arange(count), kept).tolist()
    flat = np.where(there[:, None], whole.places, np.nan)
    layout = ModuleLayout(flat, np.where(there, np.searchsorted(kept, whole.module), -1))
    said = f"modules {', '.join(map(str, absent[:12]))} never answered: they are left out, as if they did not exist"
    return layout, [said] if absent and isinstance(known, Pokes) else []


def _figures(pokes: Pokes, found: TaxelCalibration) -> list[tuple[str, object]]:
    rejected, weighed = int((pokes.weight == 0).sum()), int(((pokes.weight > 0) & (pokes.weight < 1)).sum())
    counted = {"found": len(pokes), "used": found.used, "rejected": rejected, "weighed down": weighed}
    answers = len(pokes.taxel) / max(len(pokes), 1)
    deviation = np.sqrt(np.diag(pokes.noise))
    said = f"{1e3 * deviation[:3].max():.3g} mN, {1e3 * deviation[3:].max():.3g} N mm of a poke's wrench"
    return [
        ("pokes", Quantity(", ".join(f"{count} {what}" for what, count in counted.items()), counted)),
        ("configurations", f"{pokes.configurations}"),
        ("answers", f"{answers:.1f} taxels a poke, above {pokes.threshold:.3g}"),
        ("noise", f"{said}; residuals are {found.noise:.2f} times what is explained"),
        *of_taxels(found.places),
        *([("spacing", str(found.spacing))] if found.spacing is not None else []),
        *(
            [("size", f"+- {100 * found.size_deviation:.2g} % of the skin's")]
            if np.isfinite(found.size_deviation)
            else []
        ),
        *([("left out", str(found.validation))] if found.validation.parts else []),
        *_nuisances(found),
    ]


def _nuisances(found: TaxelCalibration) -> list[tuple[str, object]]:
    """Return the largest error of each kind of sensor and robot error."""
    if not found.nuisances:
        return []
    frames, common, bias, cross = (found.nuisances[name] for name in ("frames", "common", "bias", "cross_talk"))
    turns = [
        f"up to {_most(each[..., :3], 1e3)} mm, {_most(each[..., 3:], 180 / np.pi)} degrees"
        for each in (frames, common)
    ]
    same = max(float(np.abs(block).max()) for block in (cross[:3, :3], cross[3:, 3:]))
    return [
        ("frame of each configuration", Quantity(turns[0], frames)),
        ("frame of all", Quantity(turns[1], common)),
        ("bias", Quantity(f"up to {_most(bias[:, :3], 1.0)} N, {_most(bias[:, 3:], 1e3)} N mm", bias)),
        ("cross-talk", Quantity(f"up to {100 * same:.2g} % among forces, or among torques", cross)),
    ]


def _most(rows: np.ndarray, scale: float) -> str:
    return f"{scale * float(np.linalg.norm(rows, axis=-1).max()):.3g}"


def _next(setup: Setup, output: Path, surface: Surface | None) -> list[str]:
    said = [f'name it in the rig: taxels = "{output.name}" under [skin]']
    if surface is None:
        said.append("add the link's mesh as [surface] to know the taxels better")
    if setup.pokes is not None and setup.pokes.start is None:
        said.append("write start = FILE in [pokes], with their places by CAD, to make places absolute")
    return said


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
        GeometryError: the file of the surface has no usable surface.
    """
    setup = load_rig(rig)
    table = setup.pokes or RigPokes()
    keep_inputs(output, (rig, skin, *setup.files().values()))
    if not (wanted >= 0 and pokes >= 1):
        raise InputError("wanted must not be negative, and pokes must be positive.", where="--wanted, --pokes")
    surface = _in_link(setup.resolve())
    places = read_taxel_places(skin)
    priors = Priors(**table.priors.stated())
    units, known, options = after_calibration(places, surface, priors, start=table.start is not None)
    plan = plan_pokes(units, known, options, wanted=wanted, pokes=pokes)
    _write_plan(output, options, plan)
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


def _write_plan(path: Path, options: PossiblePokes, plan: Plan) -> None:
    rows = [_COLUMNS]
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
