"""A fingertip on four force cells: voltages are calibrated on a bench, and become contacts."""

import numpy as np

import palpate
from palpate.sensors.load_cells import LoadCellArray
from palpate.surfaces import EllipticCylinder
from palpate_lab.simulation import BENCHES

# The bench slides a ball over the fingertip, with a reference sensor below: one run to calibrate, one to judge.
bench = BENCHES["rigid"]
known, used = bench.run(0, thin=50), bench.run(1, thin=50)

surface = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)  # or a mesh
found = palpate.identify_load_cells(known.time, known.voltages, known.force, known.position, surface)

array = LoadCellArray(found.cells, seconds=1.5)  # of each start that are untouched
fingertip = palpate.WrenchEstimator(palpate.Locator(surface, noise=array.noise), array)

log = palpate.Recording(used.time, {"voltage": used.voltages})
fingertip.tare(log.picked(used.time < 1.5))
contacts = palpate.Contacts.joined(list(fingertip.stream([log])))  # each later start has its own zero

touched = contacts.answered & used.loaded
off = np.linalg.norm(contacts.point[touched] - used.point[touched], axis=1)
print(f"{touched.sum()} of {used.loaded.sum()} touched samples are answered")
print(f"off by {1e6 * np.median(off):.0f} um (median), forces of up to {np.abs(contacts.force[touched]).max():.1f} N")
