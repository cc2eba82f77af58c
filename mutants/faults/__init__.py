"""The stated faults, a file a room. A file that moves takes a new path here; a fault that is mended away goes."""

from mutants.fault import Fault
from mutants.faults import calibration, contact, control, evaluation, io, live, sensors, simulation, spatial, surfaces

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *spatial.FAULTS,
    *surfaces.FAULTS,
    *sensors.FAULTS,
    *contact.FAULTS,
    *control.FAULTS,
    *calibration.FAULTS,
    *evaluation.FAULTS,
    *io.FAULTS,
    *live.FAULTS,
    *simulation.FAULTS,
]
