"""From a robot's log to contacts on a probe: `palpate demo`, into demo/ unless its options say otherwise."""

from __future__ import annotations

import sys

from palpate.cli import main

if __name__ == "__main__":
    sys.exit(main(["demo", "-o", "demo", "--force", *sys.argv[1:]]))
