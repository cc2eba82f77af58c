"""`python -m fuzz [NAME ...] [--minutes N]`: fuzz readers and packets, led by coverage.

Each target runs in a process of its own. It begins with good files, and with the inputs in fuzz/corpus/NAME, which
crashed once. What finds new code is kept in .cache/fuzz/NAME for the next run. An exception that is no `PalpateError`,
a hang over 10 s or more than 1 GB of memory is a crash, whose input is kept in .cache/fuzz/crashes. It needs atheris.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent
CACHE = ROOT.parent / ".cache" / "fuzz"
LIMITS = ("-timeout=10", "-rss_limit_mb=1024", "-max_len=1048576", "-print_final_stats=1")


def main() -> int:
    """Return 0 if no target crashed."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("names", nargs="*", help="targets; all without")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each target")
    parser.add_argument("--in-process", action="store_true", help=argparse.SUPPRESS)
    options, more = parser.parse_known_args()
    if options.in_process:
        _fuzz(options.names[0], more)
        return 0
    from claims.evidence.good_files import write_good
    from fuzz.targets import SEEDS, TARGETS

    seeds = CACHE / "seeds"
    if not seeds.exists():
        seeds.mkdir(parents=True)
        with contextlib.redirect_stdout(io.StringIO()):
            write_good(seeds)
    shutil.copy(ROOT.parent / "claims" / "evidence" / "robots" / "wrist.urdf", seeds)
    failed = list[str]()
    for name in options.names or TARGETS:
        grown, crashes = CACHE / name, CACHE / "crashes"
        for folder in (grown, crashes):
            folder.mkdir(parents=True, exist_ok=True)
        for seed in SEEDS.get(name, ()):
            shutil.copy(seeds / seed, grown)
        kept = ROOT / "corpus" / name
        words = [name, "--in-process", f"-max_total_time={60 * options.minutes:.0f}", *LIMITS]
        words += [f"-artifact_prefix={crashes}/{name}-", str(grown), *([str(kept)] if kept.exists() else [])]
        done = subprocess.run([sys.executable, "-m", "fuzz", *words], stderr=subprocess.PIPE, text=True)
        said = [line for line in done.stderr.splitlines() if re.search(r"DONE|Error|ERROR|stat::|crash-", line)]
        print(f"{name}: {'crashed' if done.returncode else 'no crash'}", *said[-8:], sep="\n  ", flush=True)
        failed += [name] if done.returncode else []
    return len(failed)


def _fuzz(name: str, words: list[str]) -> None:
    import atheris

    with atheris.instrument_imports(include=["palpate"]):
        from fuzz.targets import TARGETS
    atheris.Setup([sys.argv[0], *words], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
