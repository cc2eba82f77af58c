"""`python -m mutants [--count N | --kinds] [--seed N] [--only TEXT] [--jobs N] [--trust] [--list]`: turn on faults.

Faults are made from what stands in the package, by chance. Everything is compiled once; each fault is turned on in a
forked process of its own, which runs the tests of the fault's room until one fails; where none does, those of the laws.
Processes that a test starts have the fault, too. Those of `equivalent.txt` change nothing that can be noticed, and do
not count. With --kinds the faults are those of `kinds.toml`, and the tests of their law must notice each.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from mutants.build import ROOT, import_with_faults
from mutants.fault import Fault, chosen

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
    parser.add_argument("--trust", action="store_true", help="do not try first whether the tests pass without a fault")
    parser.add_argument("--list", action="store_true", help="say what there is and where, and run nothing")
    options = parser.parse_args()
    faults = chosen(options.count, options.seed)
    os.environ["PALPATE_FAULT"] = f"0 {options.count} {options.seed}"
    meant = {k: fault for k, fault in enumerate(faults, start=1) if _meant(k, fault, options.only)}
    if options.list:
        for k, fault in meant.items():
            print(f"{k:4}  {fault.what}")
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.chdir(ROOT)
    import_with_faults(faults)
    if not options.trust and not _sound(sorted({each for fault in meant.values() for each in fault.tests.split()})):
        return 2
    end = time.monotonic() + WALL
    found = _run([(k, fault.tests.split()) for k, fault in meant.items()], faults, options.jobs, end)
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
        _run([(faults.index(fault) + 1, [LAWS]) for fault in missed], faults, options.jobs, end)
    wanted = WANTED if options.count else 1.0
    return int(share < wanted or len(same) > EQUIVALENT * len(tried))


def _sound(tests: list[str]) -> bool:
    """Do the tests pass without any fault? Else nothing is learnt from them."""
    [(code, took, output)] = _run([(0, tests)], [], 1, float("inf"))
    print(
        output if code else "", f"without a fault the tests {'fail' if code else 'pass'}, in {took:.0f} s", flush=True
    )
    return code == 0


def _meant(number: int, fault: Fault, text: str) -> bool:
    return text == str(number) or (not text.isdigit() and text in fault.what)


def _run(
    work: Sequence[tuple[int, list[str]]], faults: list[Fault], jobs: int, end: float
) -> list[tuple[int | None, float, str]]:
    """Of each fault and its tests: exit code of pytest (0: not noticed, None: not tried by `end`), seconds, output."""
    waiting, running = list(enumerate(work)), dict[int, tuple[int, float, Path]]()
    results: list[tuple[int | None, float, str]] = [(None, 0.0, "")] * len(work)
    while running or (waiting and time.monotonic() < end):
        while waiting and len(running) < jobs and time.monotonic() < end:
            at, (number, tests) = waiting.pop(0)
            said = Path(tempfile.mkstemp(prefix="mutant")[1])
            running[_forked(number, tests, said)] = (at, time.monotonic(), said)
        time.sleep(0.05)
        for process, (at, begin, said) in list(running.items()):
            took = time.monotonic() - begin
            done, status = os.waitpid(process, os.WNOHANG)
            if not done and took > LIMIT:
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
    import pytest  # the parent has it already

    from mutants.switch import turn_on

    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        turn_on(number)
        _, *others = os.environ["PALPATE_FAULT"].split()
        os.environ["PALPATE_FAULT"] = " ".join([str(number), *others]) if number else ""
        os.environ["NUMBA_CACHE_DIR"] = f"{os.environ['NUMBA_CACHE_DIR']}-children"  # of what the tests start
        quiet = ["-q", "--no-header", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
        code = pytest.main(["-x", *quiet, *tests])  # the warning: plugins were imported before the fork
        sys.stdout.flush()
    os._exit(int(code))


def _tell(number: int, faults: list[Fault], code: int, took: float, output: str) -> None:
    if number == 0:
        return
    if code in (4, 5):  # a wrong call, no tests
        print(output, file=sys.stderr)
        raise SystemExit(f"pytest did not run for fault {number}: {code}")
    names = [line.split(" ")[1] for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    by = names[0] if names else f"it ended with {code}"
    noticed = "NOT NOTICED" if code == 0 else "noticed"
    said = "" if code == 0 else f"  [{by}]"
    print(f"{number:4}  {noticed:11}  {took:5.1f} s  {faults[number - 1].what}{said}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
