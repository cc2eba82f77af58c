"""Errors as rows of a table, on the screen and in reports."""

from __future__ import annotations

import numpy as np

from palpate.evaluation.evaluate import Report

__all__ = ["HEADER", "error_rows"]

HEADER = ("", "mean", "median", "95 %", "worst", "count")


def error_rows(report: Report) -> list[tuple[str, ...]]:
    """What, mean, median, 95 %, worst and count, each with its unit; none where nothing was compared."""
    what, degrees = "location of touches [mm]" if report.touches else "location [mm]", 180 / np.pi
    summaries = (
        (what, report.location, 1e3),
        ("normal [deg]", report.normal, degrees),
        ("force [N]", report.force, 1.0),
        ("force direction [deg]", report.force_angle, degrees),
    )
    return [
        (name, *(f"{scale * value:.3f}" for value in (of.mean, of.median, of.p95, of.worst)), f"{of.count:,}")
        for name, of, scale in summaries
        if of is not None
    ]
