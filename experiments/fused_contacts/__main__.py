"""`python -m experiments.fused_contacts [--seeds N] [--small]`: forces of several contacts, into README.md.

--seeds is how many times all is drawn anew (the page says the mean, and the extremes where there are several). With
--small it is a few touches, printed, and nothing is written. Ends with 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads cost more than they save

from experiments.fused_contacts.page import Check, page
from experiments.fused_contacts.study import Sizes

__all__ = ["main"]

FOLDER = Path(__file__).parent
SMALL = Sizes(bodies=2, touches=10, searched=1, searches=4)


def main() -> int:
    """0 when every target is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.fused_contacts", description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="times that all is drawn anew")
    parser.add_argument("--small", action="store_true", help="a few touches; printed, and nothing is written")
    asked = parser.parse_args()
    begin = time.process_time()
    checks = list[Check]()
    text = page(SMALL if asked.small else Sizes(), range(500, 500 + asked.seeds), checks)
    text += f"\nIt took {time.process_time() - begin:.0f} s of one core.\n"
    if asked.small:
        print(text)
        return 0
    (FOLDER / "README.md").write_text(text, encoding="utf-8")
    print("\n".join(f"missed: {check.what}: {check.got}" for check in checks if not check.met) or "every target is met")
    return 0 if all(check.met for check in checks) else 1


if __name__ == "__main__":
    sys.exit(main())
