"""Table of the laboratory's commands, which join Palpate's by the entry point `palpate.commands`.

Name of a command -> module, function, and the first paragraph of its docstring; name of a group -> its description.
"""

from __future__ import annotations

COMMANDS: dict[str, str | tuple[str, str, str]] = {
    "benchmark": "Score contact estimators on simulated tasks",
    "simulate": "Simulate a sensor, with its ground truth",
    "benchmark make": (
        "palpate_lab.cli.benchmark_make",
        "benchmark_make",
        "Make benchmark tasks: wrenches, logs, skin frames, images.",
    ),
    "benchmark score": (
        "palpate_lab.cli.benchmark_score",
        "benchmark_score",
        "Score estimators and their peers on benchmark tasks.",
    ),
    "demo": (
        "palpate_lab.cli.demo",
        "demo",
        "Simulate a session, and run every step on it.",
    ),
    "simulate arena": (
        "palpate_lab.cli.simulate_arena",
        "simulate_arena",
        "Simulate robots that find their way by touch.",
    ),
    "simulate forearm": (
        "palpate_lab.cli.simulate_forearm",
        "simulate_forearm_command",
        "Simulate a forearm with a skin and a force/torque sensor.",
    ),
    "simulate hand": (
        "palpate_lab.cli.simulate_robot",
        "simulate_hand",
        "Simulate a hand with five fingertips, which grasps and is pushed.",
    ),
    "simulate humanoid": (
        "palpate_lab.cli.simulate_robot",
        "simulate_humanoid",
        "Simulate a torso with two arms, twelve patches of skin and two force/torque sensors.",
    ),
    "simulate load-cells": (
        "palpate_lab.cli.simulate_load_cells",
        "simulate_load_cells",
        "Simulate a fingertip or a plate on load cells.",
    ),
    "simulate marker-ring": (
        "palpate_lab.cli.simulate",
        "simulate_marker_ring",
        "Simulate a marker ring.",
    ),
    "simulate phantom": (
        "palpate_lab.cli.simulate_phantom",
        "simulate_phantom",
        "Simulate a probe held on a moving soft phantom.",
    ),
    "simulate pokes": (
        "palpate_lab.cli.simulate_pokes",
        "simulate_pokes",
        "Simulate a forearm whose taxels are poked.",
    ),
}
