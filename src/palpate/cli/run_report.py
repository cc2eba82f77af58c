"""A finished run as values for its report: what every sensor has, and a section of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf

import numpy as np
from jaxtyping import Bool, Float

from palpate.cli.page_layers import body_of
from palpate.cli.report_advice import wrench_advice
from palpate.contact.contacts import Contacts
from palpate.contact.fused_estimator import FusedEstimator
from palpate.contact.locate import Locator
from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.io.models import MODELS
from palpate.io.pipeline import Pipeline
from palpate.io.rig.force_torque import ForceTorqueSection
from palpate.io.rig.setup import Setup
from palpate.io.units import measured
from palpate.sensors.compensation import Compensation
from palpate.sensors.force_torque import Payload
from palpate.sensors.load_cell_array import LoadCellArray
from palpate.sensors.load_cells import LoadCells
from palpate.sensors.zero_filter import ZeroStatus
from palpate.spatial.pose import Pose, skew
from palpate.surfaces.mesh import Mesh
from palpate.viewer.maps import sheet_map
from palpate.viewer.report import Section, percent, picture
from palpate.viewer.run_report import Run
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.samples import sheet_places
from palpate.viewer.taxels import cell_mesh
from palpate.viewer.zero_plot import zeros

__all__ = ["force_torque", "load_cells", "run_of", "taxels", "wrench_settings"]

Facts = tuple[tuple[str, str], ...]
OF_WRENCHES = ("crease", "noise_source")  # settings that `wrench_settings` does not have
_SETTINGS = {  # of estimators, as rigs name them -> in words, by how much they are multiplied, and in which unit
    "on": ("a contact begins at", 1.0, "deviations of the noise"),
    "off": ("a contact ends at", 1.0, "deviations of the noise"),
    "sure": ("two peaks are two contacts from", 1.0, "deviations between them"),
    "share": ("and from", 1e2, "% of the lower peak"),
    "unequal": ("gains of cells differ by", 1e2, "%"),
    "drift": ("the rest is followed within", 1.0, "s"),
    "walk": ("drift of the rest", 1.0, "counts/√s"),
    "reach": ("from frame to frame a contact moves by", 1e3, "mm at most"),
    "speed": ("and at", 1e3, "mm/s at most"),
    "patience": ("a lost contact is waited for", 1.0, "s"),
    "apart": ("two contacts are at least", 1.0, "° from each other"),
    "dropped": ("markers left out of a frame", 1.0, "at most"),
    "shift": ("a neighbour shifts a contact by", 1.0, "°"),
    "wide": ("widths differ by", 1.0, "deviations of the calibration's"),
    "tangential": ("tangential force", 1e2, "% of the normal force (one standard deviation)"),
    "gain": ("error of the skin's gain", 1e2, "% (one standard deviation)"),
    "floor": ("and of its force", 1.0, "N (one standard deviation)"),
    "alarm": ("false alarms", 1e2, "%"),
    "turns": ("the prior is updated", 1.0, "times"),
    "crease": ("edges are sharp from", 1.0, "°"),
}


def run_of(
    pipeline: Pipeline, summary: RunSummary, record: Mapping[str, str], output: str, warnings: tuple[str, ...]
) -> Run:
    """All that is known of a run when its log is done.

    Args:
        pipeline: that has run.
        summary: of its contacts.
        record: inputs with their hashes, options.
        output: name of the file of contacts.
        warnings: that were said to the user.
    """
    estimator, log = pipeline.estimator, pipeline.log
    names = OF_WRENCHES if isinstance(estimator, WrenchEstimator) else pipeline.facts
    run = Run(
        log.path.name,
        output,
        f"and turned into contacts as those of {log.kind.called}",
        summary,
        settings=tuple(_setting(name, pipeline.facts[name]) for name in names if pipeline.facts.get(name) is not None),
        provenance={
            name: text for name, text in record.items() if name not in {*pipeline.facts, "sensor"} and text != "whole"
        },
        stages={"read": log.seconds, **pipeline.seconds},
        notes=tuple(pipeline.notes()),
        warnings=warnings,
    )
    if isinstance(estimator, WrenchEstimator):
        return _of_wrenches(run, log.setup, estimator)
    if isinstance(estimator, FusedEstimator):
        return _of_both(run, log.setup, estimator)
    if isinstance(estimator, TaxelEstimator):
        return _of_taxels(run, log.setup, estimator)
    surface = body_of(log.setup)  # of a marker ring: a cylinder where the rig has no surface
    drawn = None if surface is None else surface.drawn()
    return run if drawn is None else replace(run, body=(drawn.vertices, drawn.faces))


def _setting(name: str, value: object) -> tuple[str, str]:
    """Return a setting's name in words, and its value with its unit."""
    words, scale, unit = _SETTINGS.get(name, (name.replace("_", " "), 1.0, ""))
    if value == inf:
        return words, "never"
    return words, f"{scale * value:g} {unit}".strip() if isinstance(value, int | float) else str(value)


def _of_wrenches(run: Run, setup: Setup, estimator: WrenchEstimator) -> Run:
    """Located on a surface, with a section of the sensor."""
    smooth, sensor, rate = estimator.filter, estimator.sensor, estimator.rate
    filtered = "none" if smooth is None or rate is None else smooth.describe(rate)
    payload = sensor.payload if isinstance(sensor, Compensation) else None
    held = [("the payload's", payload is not None), ("the mounting's", setup.link.mount_covariance is not None)]
    held.append(("the calibration's", isinstance(sensor, LoadCellArray)))
    compensated = f"compensated {'without' if payload is None else 'with'} a payload model"
    drawn, method = estimator.locator.surface.drawn(), setup.estimate.method.replace("_", " ")
    run = replace(
        run,
        method=f"{compensated}, and located on {setup.link.name} by the {method} method",
        body=(drawn.vertices, drawn.faces),
        settings=(*wrench_settings(setup, estimator.locator, sensor.noise, filtered), *run.settings),
        uncertainties=("the sensor's noise", *(f"{name} uncertainty" for name, there in held if there)),
    )
    zero = zero_section(estimator)
    if isinstance(sensor, LoadCellArray):
        left_out = (1 + np.flatnonzero(~sensor.sound)).tolist()
        section = load_cells(sensor.cells, left_out=left_out, said=sensor.notes(), faults=sensor.doubts())
        return replace(run, sections=(section, *zero))
    if not isinstance(sensor, Compensation):
        return replace(run, sections=zero)
    radius = run.kept.median_radius
    advice = wrench_advice(setup, payload=payload is not None, filtered=smooth is not None, radius=radius)
    return replace(run, sections=(force_torque(setup, payload, estimator.mount), *zero), advice=advice)


def zero_section(estimator: WrenchEstimator | FusedEstimator) -> tuple[Section, ...]:
    """How the zero went, where it was followed; nothing where it was not."""
    history = estimator.zero_history()
    if history is None or not len(history.time):
        return ()
    held: Bool[np.ndarray, " n"] = history.status != ZeroStatus.FREE
    drawn = zeros(history.time, history.zero, history.deviation, held)
    caption = (
        "How far the zero has gone since the start, with 95 % bands. Below, green: followed, as nothing touched; grey: "
        "held, as something touched or may have, while the band grows."
    )
    facts = (
        ("held", f"{percent(float(np.mean(held)))} of the time"),
        ("unsure", f"at most by {_spread(history.deviation)} (one standard deviation of one channel)"),
    )
    return (Section("Zero", pictures=(picture(drawn, caption),), facts=facts),)


def _spread(deviation: Float[np.ndarray, "n m"]) -> str:
    """The largest, of forces and torques or of voltages."""
    most = np.max(deviation, axis=0)
    if len(most) != 6:
        return f"{1e3 * float(most.max()):.2g} mV"
    return f"{float(most[:3].max()):.2g} N and {1e3 * float(most[3:].max()):.2g} N mm"


def _of_taxels(run: Run, setup: Setup, estimator: TaxelEstimator) -> Run:
    """On a body of cells."""
    body, health = estimator.body, estimator.health
    shape = (body.rows, body.columns) if body.rows else None
    drawn = cell_mesh(body)
    if setup.link.stated is not None:
        mesh = setup.link.surface().drawn()
        drawn = (mesh.vertices, mesh.faces)
    facts = [("cells", f"{len(body)}, of which {int(body.usable.sum())} are used")]
    if health is not None:
        facts.append(
            (
                "at rest",
                f"{np.median(health.baseline):.3g} counts, noise {np.median(health.noise):.2g} counts (medians)",
            )
        )
        facts.append(("dead, stuck", f"{int(health.dead.sum())}, {int(health.stuck.sum())}"))
    section = taxels(run.kept.contacts, tuple(facts), shape, () if health is None else health.notes)
    uncertainties = ("the cells' noise", "where in a cell a touch may be")
    return replace(run, body=drawn, uncertainties=uncertainties, sections=(section,))


def _of_both(run: Run, setup: Setup, estimator: FusedEstimator) -> Run:
    """Felt by a skin, with forces that a force/torque sensor sums up."""
    run = _of_taxels(run, setup, estimator.taxels)
    return replace(
        run,
        method="and places are the skin's, forces those that explain skin and wrench within friction",
        uncertainties=(*run.uncertainties, "the wrench's noise", "what the skin's forces are off by"),
        sections=(*run.sections, *zero_section(estimator)),
    )


def wrench_settings(
    setup: Setup, locator: Locator, noise: Float[np.ndarray, "6 6"] | None, filtered: str = "none"
) -> Facts:
    """What the answers of any sensor of wrenches depend on, defaults included.

    Args:
        setup: with the options of the command line in it.
        locator: on the surface.
        noise: covariance of a reading.
        filtered: the filter in words.
    """
    surface = locator.surface
    facets = f", {len(surface.faces):,} facets" if isinstance(surface, Mesh) else ""
    facts = [
        ("method", setup.estimate.method.replace("_", " ")),
        ("friction, at most", f"{setup.estimate.friction:g} (tangent of the angle between force and normal)"),
        ("torsion, at most", f"{1e3 * setup.estimate.torsion:g} mm (torque about the normal over normal force)"),
        ("a contact", f"begins at {locator.on:.3g} N, ends at {locator.off:.3g} N"),
        ("noise of a reading", "not known" if noise is None else _noise(np.sqrt(np.diag(noise)))),
        ("filter", filtered),
        ("surface", f"{setup.link.name}{facets}, {1e3 * surface.size:.4g} mm across"),
    ]
    if setup.estimate.tare is not None:
        facts.append(("tare", f"over the first {setup.estimate.tare:g} s"))
    return tuple(facts)


def _noise(deviation: np.ndarray) -> str:
    return f"{deviation[:3].max():.3g} N and {deviation[3:].max():.3g} N m (one standard deviation, largest axis)"


def force_torque(setup: Setup, payload: Payload | None, mount: Pose) -> Section:
    """Payload and mounting with their standard deviations, axes and orientation."""
    none = [("payload", "none: wrenches are taken as they are")]
    facts = none if payload is None else list(MODELS["payload"].summary(payload))
    facts += _mounting(mount, setup.link.mount_covariance)
    wrench, orientation = setup.of(ForceTorqueSection).table, setup.orientation
    facts.append(("wrench", f"in the {wrench.frame}'s frame, logged axes {', '.join(wrench.axes)}"))
    if orientation.topic is not None or orientation.base is not None or orientation.offset:
        gap = f"gaps of up to {orientation.max_gap:g} s are interpolated"
        facts.append(("orientation", f"clock offset {1e3 * orientation.offset:g} ms; {gap}"))
    return Section("Payload and mounting", facts=tuple(facts))


def _mounting(pose: Pose, covariance: Float[np.ndarray, "6 6"] | None) -> list[tuple[str, str]]:
    place, turn = 1e3 * pose.translation, np.degrees(pose.rotation_vector())
    if covariance is None:
        stated = (("mounting", place, "mm"), ("turned by", turn, "deg"))
        return [
            (name, f"({', '.join(f'{v:z.2f}' for v in three)}) {unit}, not calibrated") for name, three, unit in stated
        ]
    moves = np.concatenate([-skew(pose.translation), np.eye(3)], axis=1)  # what a small motion does to the origin
    deviation = 1e3 * np.sqrt(np.diag(moves @ covariance @ moves.T).clip(min=0))
    turned = np.degrees(np.sqrt(np.diag(covariance)[:3].clip(min=0)))
    return [("mounting", measured(place, deviation, "mm")), ("turned by", measured(turn, turned, "deg"))]


def load_cells(cells: LoadCells, *, left_out: Sequence[int], said: Sequence[str], faults: Sequence[str]) -> Section:
    """Cells that are not used, the zero, what is wrong, and from which force on a contact is located.

    Args:
        cells: the model.
        left_out: numbers from 1 of cells that are not used.
        said: of the zero and the smallest force, a sentence each.
        faults: that were found, a sentence each.
    """
    noise = np.sqrt(np.diag(cells.noise))
    unused = ", ".join(f"cell {number}" for number in left_out)
    facts = (
        ("cells", f"{cells.cells}, calibrated with {cells.samples:,} samples"),
        ("left out", unused or "none"),
        ("noise", f"{1e3 * noise.mean():.3g} mV of a reading (one standard deviation, mean of the channels)"),
        ("drift of the zero", f"{1e3 * cells.drift * noise.mean():.3g} mV (one standard deviation)"),
        ("soft layer", "none" if cells.indentation is None else f"{1e3 * cells.indentation.depth:.3g} mm deep at 1 N"),
    )
    return Section("Load cells", facts=facts, points=(*said, *faults, *cells.notes))


def taxels(contacts: Contacts, facts: Facts, shape: tuple[int, int] | None = None, said: Sequence[str] = ()) -> Section:
    """Cells at rest and dead, and where on the unrolled sheet contacts were.

    Args:
        contacts: downsampled; with features row and column where the taxels are a sheet.
        facts: of the body of cells, such as how many are dead.
        shape: rows and columns of the sheet.
        said: of its health, a sentence each.
    """
    places, pictures = sheet_places(contacts), ()
    if shape is not None and places is not None:
        force = np.linalg.norm(contacts.force, axis=1)
        rows = np.flatnonzero(contacts.located & np.isfinite(places[:, 0]))
        rows = rows[np.argsort(force[rows], kind="stable")]  # the strongest on top
        if len(rows):
            drawn = sheet_map(places[rows], force[rows], "force [N]", shape)
            pictures = (picture(drawn, "Where contacts were on the unrolled sheet, and how hard."),)
    return Section("Taxels", facts=facts, points=tuple(said), pictures=pictures)
