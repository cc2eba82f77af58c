"""`python -m experiments.probe [--small]`: press, locate, compare; writes README.md and the figures.

With --small the page is printed and nothing is written. Ends with 1 where a figure is not what expected.toml says.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from pathlib import Path

from experiments.probe.page import page
from experiments.probe.run import Results, measure

__all__ = ["differences", "main"]

HERE = Path(__file__).parent


def main() -> int:
    """0 when every figure is as expected."""
    parser = argparse.ArgumentParser(prog="python -m experiments.probe", description=__doc__)
    parser.add_argument("--small", action="store_true", help="the same on few samples, in seconds; nothing is written")
    small = parser.parse_args().small
    begin = time.perf_counter()
    results = measure(
        small, lambda text: print(f"{time.perf_counter() - begin:6.1f} s  {text}", file=sys.stderr, flush=True)
    )
    text = page(results, time.perf_counter() - begin)
    if small:
        print(text)
    else:
        from experiments.probe.figures import draw

        draw(results, HERE)
        (HERE / "README.md").write_text(text, encoding="utf-8")
    wrong = differences(results, small)
    print("\n".join(wrong) or "every figure as expected", file=sys.stderr)
    return int(bool(wrong))


def differences(results: Results, small: bool) -> list[str]:
    """A sentence for each figure that is not as `expected.toml` has it."""
    expected = tomllib.loads((HERE / "expected.toml").read_text(encoding="utf-8"))
    found, said = results.values(), []
    for kind, part in expected.items():
        slack = part["small" if small else "full"]
        for name, value in part["figures"].items():
            if name not in found:
                said.append(f"{name}: not measured any more")
            elif abs(found[name] - value) > slack:
                said.append(f"{name}: {found[name]:.4g}, expected {value:g} +- {slack:g} ({kind})")
    known = {name for part in expected.values() for name in part["figures"]}
    return said + [f"{name}: {value:.4g}, not in expected.toml" for name, value in found.items() if name not in known]


if __name__ == "__main__":
    sys.exit(main())
