"""`python -m tests.conformance [--json] [SENSOR ...]`: the matrix of these sensors, or of all.

PYTHONPATH says of which code: one before `load_rig` too, whose missing calls count as failing.
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

from tests.conformance.matrix import matrix, table
from tests.conformance.sensors import SENSORS

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).with_name("outside")))
    named = [word for word in sys.argv[1:] if word != "--json"]
    entries = list(matrix(tuple(sensor for sensor in SENSORS if not named or sensor.name in named)))
    plain = json.dumps([asdict(entry) for entry in entries]) if "--json" in sys.argv else table(entries)
    sys.stdout.write(plain + "\n")
    sys.exit(any(not entry.good for entry in entries))
