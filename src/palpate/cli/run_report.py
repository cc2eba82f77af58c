"""A finished run as values for its report: what every sensor has, and a section of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from palpate.cli.report_advice import wrench_advice
from palpate.cli.report_settings import force_torque, load_cells, taxels, wrench_method, wrench_settings
from palpate.cli.run_summary import RunSummary
from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.io.pipeline import Pipeline
from palpate.sensors.compensation import Compensation
from palpate.sensors.load_cell_array import LoadCellArray
from palpate.viewer.run_report import Run
from palpate.viewer.taxels import cell_mesh

__all__ = ["run_of"]


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
    run = Run(
        log.path.name,
        output,
        f"and turned into contacts as those of {log.kind.called}",
        summary.downsampled,
        settings=tuple((name, str(value)) for name, value in pipeline.facts.items() if value is not None),
        provenance=record,
        stages={"read": log.seconds, **pipeline.seconds},
        touches=summary.touches(),
        notes=tuple(pipeline.notes()),
        warnings=warnings,
    )
    if isinstance(estimator, WrenchEstimator):
        return _of_wrenches(run, pipeline, estimator)
    return _of_taxels(run, pipeline, estimator) if isinstance(estimator, TaxelEstimator) else run


def _of_wrenches(run: Run, pipeline: Pipeline, estimator: WrenchEstimator) -> Run:
    """Located on a surface, with a section of the sensor."""
    rig, smooth, sensor = pipeline.log.rig, estimator.filter, estimator.sensor
    drawn, rate = estimator.locator.surface.drawn(), estimator.rate
    filtered = "none" if smooth is None or rate is None else smooth.describe(rate)
    payload = sensor.payload if isinstance(sensor, Compensation) else None
    mounted = rig.surface is not None and rig.surface.pose_covariance is not None
    held = [("the payload's", payload is not None), ("the mounting's", mounted)]
    held.append(("the calibration's", isinstance(sensor, LoadCellArray)))
    run = replace(
        run,
        method=wrench_method(rig, payload=payload is not None),
        body=(drawn.vertices, drawn.faces),
        settings=wrench_settings(rig, estimator.locator, sensor.noise, filtered),
        uncertainties=("the sensor's noise", *(f"{name} uncertainty" for name, there in held if there)),
    )
    if isinstance(sensor, LoadCellArray):
        left_out = (1 + np.flatnonzero(~sensor.sound)).tolist()
        section = load_cells(sensor.cells, left_out=left_out, said=sensor.notes(), faults=sensor.doubts())
        return replace(run, sections=(section,))
    if not isinstance(sensor, Compensation):
        return run
    radius = run.kept.median_radius
    advice = wrench_advice(rig, payload=payload is not None, filtered=smooth is not None, radius=radius)
    return replace(run, sections=(force_torque(rig, payload, estimator.mount),), advice=advice)


def _of_taxels(run: Run, pipeline: Pipeline, estimator: TaxelEstimator) -> Run:
    """On a body of cells."""
    rig, body, health = pipeline.log.rig, estimator.body, estimator.health
    shape = (body.rows, body.columns) if body.rows else None
    drawn = cell_mesh(body.positions, body.normals, body.areas, shape)
    if rig.surface is not None:
        mesh = rig.surface.load(rig.folder).drawn()
        drawn = (mesh.vertices, mesh.faces)
    facts = [("cells", f"{len(body)}, of which {int(body.usable.sum())} are used")]
    if health is not None:
        facts.append(("at rest", f"{np.median(health.baseline):.3g}, noise {np.median(health.noise):.2g} (medians)"))
        facts.append(("dead, stuck", f"{int(health.dead.sum())}, {int(health.stuck.sum())}"))
    section = taxels(run.downsample.contacts, tuple(facts), shape, () if health is None else health.notes)
    return replace(
        run,
        body=drawn,
        uncertainties=("the cells' noise", "where in a cell a touch may be"),
        sections=(section,),
    )
