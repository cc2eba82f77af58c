"""`python -m fuzz [NAME ...] [--minutes N]`: fuzz readers and packets, led by coverage.

Each target runs in a process of its own. It begins with good files, and with the inputs in fuzz/corpus/NAME, which
crashed once. What finds new code is kept in .cache/fuzz/NAME for the next run. An exception that is no `PalpateError`,
a warning, a hang over 10 s or more than 1 GB of memory is a crash, kept in .cache/fuzz/crashes. It needs atheris.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_SELF, getrusage

ROOT = Path(__file__).parent
CACHE = ROOT.parent / ".cache" / "fuzz"
LIMITS = ("-timeout=10", "-rss_limit_mb=4096", "-max_len=1048576", "-print_final_stats=1")

MOST = 1 << 20  # KiB


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
    from fuzz.targets import TARGETS

    seeds = _seeds()
    failed = list[str]()
    for name in options.names or TARGETS:
        grown, crashes = CACHE / name, CACHE / "crashes"
        for folder in (grown, crashes):
            folder.mkdir(parents=True, exist_ok=True)
        begun = seeds / name, ROOT / "corpus" / name
        words = [name, "--in-process", f"-max_total_time={60 * options.minutes:.0f}", *LIMITS]
        words += [f"-artifact_prefix={crashes}/{name}-", str(grown), *(str(each) for each in begun if each.exists())]
        done = subprocess.run([sys.executable, "-m", "fuzz", *words], stderr=subprocess.PIPE, text=True)
        said = [line for line in done.stderr.splitlines() if re.search(r"DONE|Error|ERROR|stat::|crash-", line)]
        print(f"{name}: {'crashed' if done.returncode else 'no crash'}", *said[-8:], sep="\n  ", flush=True)
        failed += [name] if done.returncode else []
    return len(failed)


def _seeds() -> Path:
    """Return the folder of good inputs, written if it is not there."""
    seeds, begun = CACHE / "good", CACHE / "good.part"
    if not seeds.exists():
        from fuzz.seeds import write_seeds

        shutil.rmtree(begun, ignore_errors=True)
        write_seeds(begun)
        begun.rename(seeds)
    return seeds


def _fuzz(name: str, words: list[str]) -> None:
    import atheris

    from fuzz.mutated import changed

    with atheris.instrument_imports(include=["palpate"]):
        from fuzz.targets import FOLDER, TARGETS
    shutil.copytree(_seeds() / "files", FOLDER, dirs_exist_ok=True)
    warnings.filterwarnings("error", category=RuntimeWarning)

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        text = seed % 2 and b"\0" not in data
        return changed(data, seed)[:most] if text else atheris.Mutate(data, most)

    atheris.Setup([sys.argv[0], *words], _sparing(TARGETS[name]), custom_mutator=mutated)
    atheris.Fuzz()


def _sparing(target: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """Return the target, which raises a MemoryError where one input takes 1 GB: all of a run may, as atheris grows."""

    def measured(data: bytes) -> None:
        before = getrusage(RUSAGE_SELF).ru_maxrss
        target(data)
        if (grown := getrusage(RUSAGE_SELF).ru_maxrss - before) > MOST:
            raise MemoryError(f"{grown >> 10} MB for one input")

    return measured


if __name__ == "__main__":
    sys.exit(main())
