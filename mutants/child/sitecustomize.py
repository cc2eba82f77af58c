"""Imported by every Python that a test starts: it has the fault of its parent, and compiles into a cache of its own."""

import os

if os.environ.get("PALPATE_FAULT"):
    from mutants.build import read_with_faults
    from mutants.fault import chosen
    from mutants.switch import turn_on

    _number, _count, _seed = map(int, os.environ["PALPATE_FAULT"].split())
    read_with_faults(chosen(_count, _seed))
    turn_on(_number)
