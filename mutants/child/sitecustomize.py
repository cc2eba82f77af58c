"""Imported by every Python that a test starts: it has the fault of its parent."""

import os

if os.environ.get("PALPATE_FAULT"):
    from mutants.switch import turn_on

    turn_on(int(os.environ["PALPATE_FAULT"]))
