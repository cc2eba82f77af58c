"""`python -m claims [--small] [--only NAME ...]`: measure claims, and write docs/evidence.md and the papers' pages.

NAME is a group (evidence, papers, timings), a theme of a group (papers.probe), a theme of any group (probe), or a
pattern of these. With --small the same functions run on few samples, their rows are printed, and no page is written.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from importlib import import_module

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads cost more than they save

from claims.page import THEMES, machine, renew, table
from claims.row import Row

NAMES = [name for group in THEMES.values() for name in group]


def rows_of(name: str, small: bool) -> Iterator[Row]:
    """Measure a theme: one of `NAMES`."""
    return import_module(f"claims.{name}" + ".rows" * name.startswith("papers.")).rows(small)


def named(only: Sequence[str]) -> list[str]:
    """Return the themes that are asked for; all of them if none is."""
    wanted = [pattern for each in only for pattern in (each, f"{each}.*", f"*.{each}")]
    return [name for name in NAMES if not only or any(fnmatch(name, pattern) for pattern in wanted)]


def measure(name: str, small: bool) -> bool:
    """Measure a theme, into the pages if it is not `small`; return whether every row with a target meets it."""
    begin, rows = time.perf_counter(), list[Row]()
    for row in rows_of(name, small):
        rows.append(row)
        took = time.perf_counter() - begin
        line = f"{took:6.1f} s  {row.verdict.strip('*'):8}  {name}: {row.what}: {row.got}"
        print(line, file=sys.stderr, flush=True)
    if small:
        print(table(("row", "target", "got", ""), [(row.what, row.target, row.got, row.verdict) for row in rows]))
    else:
        renew(name, rows, "; ".join([*machine(), f"{time.perf_counter() - begin:.0f} s"]))
    return all(row.passed is not False for row in rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return 0 when every row that has a target meets it."""
    parser = argparse.ArgumentParser(prog="python -m claims", description=__doc__)
    parser.add_argument("--small", action="store_true", help="few samples; nothing is written")
    parser.add_argument(
        "--only", nargs="+", action="extend", default=[], metavar="NAME", help="groups, themes or patterns of them"
    )
    options = parser.parse_args(arguments)
    names = named(options.only)
    if not names:
        parser.error(f"no claims of that name; there are {', '.join(NAMES)}")
    try:
        return int(not all([measure(name, options.small) for name in names]))
    except KeyboardInterrupt:
        print("\nstopped; what was measured before is written", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
