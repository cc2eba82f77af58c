"""`python -m mutants [--count N | --kinds] [--seed N] [--only TEXT] [--jobs N] [--list]`: turn on faults.

Faults are made from what stands in the package, by chance. Everything is compiled once. The tests of the rooms run
without a fault first, which shows which files of tests reach which fault. Then each fault is turned on in a forked
process of its own, which runs those files of the fault's room until a test fails; where none does, those of the laws.
Processes that a test starts have the fault, too. Those of `equivalent.txt` change nothing that can be noticed, and do
not count. With --kinds the faults are those of `kinds.toml`, and the tests of their law must notice each.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Generator, Sequence
from pathlib import Path

import pytest

from mutants.build import ROOT, import_with_faults
from mutants.fault import Fault, chosen
from mutants.switch import reached, reached_into, turn_on

LAWS = "tests/laws"
LIMIT = 900.0  # s: beyond it a fault has made something endless, which is noticed
WALL = 90 * 60.0  # s: no other fault is tried then
WANTED, EQUIVALENT = 0.88, 0.05  # of faults by chance


def main() -> int:
    """0 when enough of the faults are noticed."""
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=120, help="faults by chance")
    parser.add_argument("--kinds", action="store_const", const=0, dest="count", help="faults of the kinds of each law")
    parser.add_argument("--seed", type=int, default=0, help="of what is chosen")
    parser.add_argument("--only", default="", help="faults with this in their file or words, or a number")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--list", action="store_true", help="say what there is and where, and run nothing")
    options = parser.parse_args()
    faults = chosen(options.count, options.seed)
    meant = {k: fault for k, fault in enumerate(faults, start=1) if _meant(k, fault, options.only)}
    if options.list:
        for k, fault in meant.items():
            print(f"{k:4}  {fault.what}")
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.chdir(ROOT)
    import_with_faults(faults)
    end = time.monotonic() + WALL
    folders = {LAWS, *(each for fault in meant.values() for each in fault.tests.split())}
    reaching = _reaching(sorted(folders), options.jobs)
    work = [(k, [name for each in fault.tests.split() for name in reaching[each][k]]) for k, fault in meant.items()]
    found = _run(work, faults, options.jobs, end)
    tried = [(fault, code) for fault, (code, _, _) in zip(meant.values(), found, strict=True) if code is not None]
    unseen = [fault for fault, code in tried if code == 0]
    known = (Path(__file__).parent / "equivalent.txt").read_text(encoding="utf-8")
    same = [fault for fault in unseen if fault.diff in known]
    missed = [fault for fault in unseen if fault.diff not in known]
    counted = len(tried) - len(same)
    share = 1.0 - len(missed) / max(1, counted)
    print(f"\n{counted - len(missed)} of {counted} faults noticed, {share:.1%}; {len(meant) - len(tried)} not tried")
    for words, some in (("equivalent", same), ("not noticed", missed)):
        for fault in some:
            print(f"      {words}: {fault.what}  ({fault.tests})")
    if missed:
        print("\nwhat is not noticed, by the tests of the laws:")
        numbers = [faults.index(fault) + 1 for fault in missed]
        _run([(k, reaching[LAWS][k]) for k in numbers], faults, options.jobs, end)
    wanted = WANTED if options.count else 1.0
    return int(share < wanted or len(same) > EQUIVALENT * len(tried))


def _reaching(folders: list[str], jobs: int) -> dict[str, dict[int, list[str]]]:
    """Run the tests of each folder without a fault, and return which files reach each fault, less tests that fail."""
    begin, found = time.monotonic(), dict[str, dict[int, list[str]]]()
    kept = [Path(tempfile.mkstemp(prefix="reached")[1]) for _ in folders]
    _run([(0, [folder, str(file)]) for folder, file in zip(folders, kept, strict=True)], [], jobs, float("inf"))
    for folder, file in zip(folders, kept, strict=True):
        by_file, failed = json.loads(file.read_text())
        file.unlink()
        found[folder] = defaultdict(list)
        for name, numbers in by_file.items():
            for number in numbers:
                found[folder][number] += [name, *(f"--deselect={each}" for each in failed if each.startswith(name))]
        print(*(f"fails without a fault: {each}\n" for each in failed), sep="", end="")
    print(f"the tests of {len(folders)} folders, without a fault, in {time.monotonic() - begin:.0f} s", flush=True)
    return found


class _Reached:
    """A plugin of pytest that writes which files of tests reach which faults, and which tests fail."""

    def __init__(self, file: Path) -> None:
        self._file, self._by_file, self._failed = file, defaultdict[str, set[int]](set), list[str]()
        reached_into(file.with_suffix(".places"))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Look at what was reached after each test."""
        result = yield
        self._by_file[item.nodeid.partition("::")[0]].update(reached())
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note what fails."""
        if report.failed:
            self._failed.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Write what was found."""
        by_file = {name: sorted(numbers) for name, numbers in self._by_file.items()}
        self._file.write_text(json.dumps([by_file, self._failed]))
        self._file.with_suffix(".places").unlink()


def _meant(number: int, fault: Fault, text: str) -> bool:
    return text == str(number) or (not text.isdigit() and text in fault.what)


def _run(
    work: Sequence[tuple[int, list[str]]], faults: list[Fault], jobs: int, end: float
) -> list[tuple[int | None, float, str]]:
    """Of each fault and its tests: exit code of pytest (0: not noticed, None: not tried by `end`), seconds, output."""
    waiting, running = [each for each in enumerate(work) if each[1][1]], dict[int, tuple[int, float, Path]]()
    results: list[tuple[int | None, float, str]] = [(None if tests else 0, 0.0, "") for _, tests in work]
    for (number, _), (code, took, _) in zip(work, results, strict=True):
        if code == 0:
            _tell(number, faults, code, took, "")
    while running or (waiting and time.monotonic() < end):
        while waiting and len(running) < jobs and time.monotonic() < end:
            at, (number, tests) = waiting.pop(0)
            said = Path(tempfile.mkstemp(prefix="mutant")[1])
            running[_forked(number, tests, said)] = (at, time.monotonic(), said)
        time.sleep(0.05)
        for process, (at, begin, said) in list(running.items()):
            took = time.monotonic() - begin
            done, status = os.waitpid(process, os.WNOHANG)
            if not done and took > LIMIT and work[at][0]:
                os.kill(process, signal.SIGKILL)
            if done:
                code = os.waitstatus_to_exitcode(status)
                results[at] = (code, took, said.read_text(errors="replace"))
                said.unlink()
                del running[process]
                _tell(work[at][0], faults, code, took, results[at][2])
    return results


def _forked(number: int, tests: list[str], said: Path) -> int:
    """The process that turns a fault on and runs its tests."""
    if process := os.fork():
        return process
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        turn_on(number)
        os.environ["PALPATE_FAULT"] = str(number)
        os.environ["NUMBA_CACHE_DIR"] = f"{os.environ['NUMBA_CACHE_DIR']}-children"  # of what the tests start
        quiet = ["-q", "--no-header", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
        if number:
            code = pytest.main(["-x", *quiet, *tests])  # the warning: plugins were imported before the fork
        else:
            folder, file = tests
            code = pytest.main([*quiet, folder], plugins=[_Reached(Path(file))])
        sys.stdout.flush()
    os._exit(0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else int(code))  # all that reach it fail without it


def _tell(number: int, faults: list[Fault], code: int, took: float, output: str) -> None:
    if number == 0:
        return
    if code == 4:  # a wrong call
        print(output, file=sys.stderr)
        raise SystemExit(f"pytest did not run for fault {number}: {code}")
    names = [line.split(" ")[1] for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    by = names[0] if names else f"it ended with {code}"
    noticed = ("NOT NOTICED" if took else "NOT REACHED") if code == 0 else "noticed"
    said = "" if code == 0 else f"  [{by}]"
    print(f"{number:4}  {noticed:11}  {took:5.1f} s  {faults[number - 1].what}{said}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
