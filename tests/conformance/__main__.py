"""`python -m tests.conformance [SENSOR ...]`: the matrix of these sensors, or of all; PYTHONPATH says of which code."""

from __future__ import annotations

import sys

from tests.conformance.matrix import matrix, table
from tests.conformance.sensors import SENSORS

if __name__ == "__main__":
    wanted = tuple(sensor for sensor in SENSORS if not sys.argv[1:] or sensor.name in sys.argv[1:])
    entries = list(matrix(wanted))
    sys.stdout.write(table(entries) + "\n")
    sys.exit(any(not entry.good for entry in entries))
