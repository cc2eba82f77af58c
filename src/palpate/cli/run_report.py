"""Collect the values of a finished run for its report: those of every sensor, and the additions of its view."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.setup.pipeline import Pipeline
from palpate.setup.view import view_of
from palpate.viewer.run_report import Run
from palpate.viewer.run_summary import RunSummary

__all__ = ["run_of"]


def run_of(
    pipeline: Pipeline, summary: RunSummary, record: Mapping[str, str], output: str, warnings: tuple[str, ...]
) -> Run:
    """Return the values of a run when its log is done, as a `Run`.

    Args:
        pipeline: pipeline that has run.
        summary: summary of its contacts.
        record: inputs with their hashes, options.
        output: name of the file of contacts.
        warnings: warnings shown to the user.
    """
    log, view = pipeline.log, view_of(pipeline.log.kind)
    run = Run(
        log.path.name,
        output,
        f"and turned into contacts as those of {log.kind.called}",
        summary,
        settings=view.settings(pipeline.settings),
        provenance={
            name: text
            for name, text in record.items()
            if name not in {*pipeline.settings, "sensor"} and text != "whole"
        },
        stages={"read": log.seconds, **pipeline.seconds},
        notes=tuple(pipeline.notes()),
        warnings=warnings,
    )
    return view.report(run, log.setup, pipeline.estimator)
