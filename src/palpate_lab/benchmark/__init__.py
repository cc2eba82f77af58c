"""A benchmark of contact sensing: tasks with their truth, simulated forwards from a seed."""

from palpate_lab.benchmark.make import PUBLIC_SEED, TASKS, make_benchmark

__all__ = ["PUBLIC_SEED", "TASKS", "make_benchmark"]
