"""`python -m tests.cost COMMIT...`: CPU time of `make test` in empty checkouts of commits, beside that of the first.

Making the environment does not count; compiling does, ahead of time and during the tests. Tests of both commits are
those with the same file name, name and parameters, in whatever folder. PYTEST_ADDOPTS="tests/contact" runs a part.
pytest loads this file in each checkout, to count each test.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CACHE = ROOT / ".cache" / "cost"
OURS = ("PALPATE_", "NUMBA_", "PYTHONPATH", "PYTEST_", "VIRTUAL_ENV", "MAKE")  # unknown to an empty checkout


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, bool | None, bool | None]:
    """Note what a test takes, with what it starts."""
    begin = _cpu()
    try:
        return (yield)
    finally:
        with Path(os.environ["COST"], str(os.getpid())).open("a", encoding="utf-8") as file:
            file.write(f"{_cpu() - begin:.3f} {item.nodeid}\n")


def _cpu() -> float:
    """Return the CPU time of this process and of those that it waited for [s]."""
    return sum(os.times()[:4])


def measured(commit: str) -> tuple[float, dict[str, float]]:
    """Return the CPU time of `make test` [s], and of each test by its file's name, its own and its parameters."""
    tree, each = CACHE / "palpate", CACHE / "each"
    shutil.rmtree(CACHE, ignore_errors=True)
    each.mkdir(parents=True)
    shutil.copy(__file__, CACHE / "count_each.py")
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(tree)], check=True)
    subprocess.run(["git", "checkout", "--quiet", commit], check=True, cwd=tree)
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith(OURS)}
    subprocess.run(["make", ".venv/.ready"], check=True, cwd=tree, env=surroundings)
    options = f"-p count_each {os.environ.get('PYTEST_ADDOPTS', '')}"
    surroundings |= {"COST": str(each), "PYTHONPATH": str(CACHE), "PYTEST_ADDOPTS": options}
    begin = _cpu()
    subprocess.run(["make", "test"], check=False, cwd=tree, env=surroundings)  # a test that fails takes time, too
    lines = [line for file in each.iterdir() for line in file.read_text(encoding="utf-8").splitlines()]
    tests = {test.rpartition("/")[2]: float(took) for took, test in (line.split(" ", 1) for line in lines)}
    return _cpu() - begin, tests


def main(commits: list[str]) -> None:
    """Print a line a commit, when it is measured."""
    first: dict[str, float] = {}
    for commit in commits:
        total, tests = measured(commit)
        first = first or tests
        both = tests.keys() & first.keys()
        here, there = (sum(side[test] for test in both) for side in (tests, first))
        print(f"{commit}: {total:.0f} s of CPU, {len(tests)} tests, {sum(tests.values()):.0f} s in them;", end=" ")
        print(f"in {len(both)} tests that {commits[0]} has, too, {here:.0f} s here and {there:.0f} s there", flush=True)


if __name__ == "__main__":
    names = subprocess.check_output(["git", "rev-parse", *sys.argv[1:]], text=True, cwd=ROOT).split()
    main([name[:8] for name in names])
