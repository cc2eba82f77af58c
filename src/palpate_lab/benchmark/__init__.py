"""A benchmark of contact sensing: tasks with their truth, made forwards from a stated seed."""

from palpate_lab.benchmark.make import PUBLIC_SEED, TASKS, make_benchmark

__all__ = ["PUBLIC_SEED", "TASKS", "make_benchmark"]
