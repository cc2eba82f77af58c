"""Table of the laboratory's commands, which join Palpate's by the entry point `palpate.commands`.

Name of a command -> module, function, and the first paragraph of its docstring; name of a group -> its description.
"""

from __future__ import annotations

__all__ = ["COMMANDS"]

COMMANDS: dict[str, str | tuple[str, str, str]] = {
    "benchmark": "Score any estimator of contacts on simulated tasks",
    "simulate": "Record what is simulated, with its truth",
    "benchmark make": (
        "palpate_lab.cli.benchmark_make",
        "benchmark_make",
        "Make tasks that any estimator of contacts can be scored by: wrenches, logs, frames of a skin, images.",
    ),
    "benchmark score": (
        "palpate_lab.cli.benchmark_score",
        "benchmark_score",
        "Score estimators on a folder of `palpate benchmark make`: yours, Palpate, and the usual ways as peers.",
    ),
    "demo": (
        "palpate_lab.cli.demo",
        "demo",
        "Make up a robot's session, run the whole chain of commands on it, and compare what is found with the truth.",
    ),
    "simulate arena": (
        "palpate_lab.cli.simulate_arena",
        "simulate_arena",
        "Send robots with a soft skin through an arena that they cannot see; record one run, or judge many seeds.",
    ),
    "simulate forearm": (
        "palpate_lab.cli.simulate_forearm",
        "simulate_forearm_command",
        "Record a simulated forearm with a skin and a force/torque sensor at its base, touched at several places.",
    ),
    "simulate load-cells": (
        "palpate_lab.cli.simulate_load_cells",
        "simulate_load_cells",
        "Record a simulated fingertip on four force cells: a run of the bench to calibrate by, and one to estimate.",
    ),
    "simulate marker-ring": (
        "palpate_lab.cli.simulate",
        "simulate_marker_ring",
        "Record a simulated barrel: its calibration run, or touches to judge by; with the truth from its mechanics.",
    ),
    "simulate phantom": (
        "palpate_lab.cli.simulate_phantom",
        "simulate_phantom",
        "Hold a probe on a soft phantom that moves, in a physics engine; record it with its truth.",
    ),
    "simulate pokes": (
        "palpate_lab.cli.simulate_pokes",
        "simulate_pokes",
        "Record a simulated forearm whose taxels are poked in seven poses of the elbow, and touches of it afterwards.",
    ),
}
