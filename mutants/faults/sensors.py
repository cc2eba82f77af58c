"""Payload, filters, noise."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "sensors/_filters.py",
        "tests/sensors/test_filters.py",
        ("a gap does not start the filter afresh", "step < 0.0 or step > gap", "step < 0.0"),
        ("time that steps back does not", "step < 0.0 or step > gap", "step > gap"),
        ("the start is not at rest", "start[s, 1] * x[c]", "0.0 * x[c]"),
        ("the gain is settled from the start", "gains[min(age[i], len(gains) - 1)]", "gains[len(gains) - 1]"),
        ("a refused sample counts", "age[i] = -1", "age[i] = 0"),
    ),
    *of(
        "sensors/force_torque.py",
        "tests/sensors/test_force_torque.py",
        ("inertia pushes the wrong way", "weight - self.mass * accelerations", "weight + self.mass * accelerations"),
        (
            "the mass's error does not reach the torque",
            "skew(self.center_of_mass) @ jacobian_weight",
            "skew(self.center_of_mass) @ transposed",
        ),
        ("the centre's error is left out", "jacobian[..., 3:, 6:9] = -skew(weight)", "pass"),
        (
            "a reading at its range is not saturated",
            "np.abs(wrenches) >= self.limits",
            "np.abs(wrenches) > self.limits",
        ),
        (
            "the torque is about the wrong point",
            "np.cross(self.center_of_mass, weight)",
            "np.cross(weight, self.center_of_mass)",
        ),
    ),
    *of(
        "sensors/noise.py",
        "tests/sensors tests/cli/test_inspect_spectrum.py",
        (
            "readings that repeat count",
            "readings[:: min(max(held, 1), MOST_HELD)]",
            "readings",
        ),
        ("touches count as noise", "variance <= SPREAD * variance[quiet].mean()", "variance <= np.inf"),
        ("a held press is rest", "resting[k] = False", "resting[k] = True"),
        ("wander is forgotten", "(total - moves * within)[None]", "(0.0 * total)[None]"),
    ),
    *of(
        "sensors/correlation.py",
        "tests/sensors",
        (
            "correlation counted on one side",
            "2.0 * np.sum(pairs * reached, axis=0) - 1.0",
            "np.sum(pairs * reached, axis=0)",
        ),
    ),
    *of(
        "sensors/marker_labels.py",
        "tests/sensors/test_markers.py",
        ("a ring takes what is the next one's", "cost[blob[moved[:, 0] == inmost[marker]]] = limits.missing", "pass"),
    ),
    *of(
        "sensors/markers.py",
        "tests/sensors/test_markers.py",
        ("the ring behind is labelled first", "np.argsort(-self.view.rings)", "np.argsort(self.view.rings)"),
        ("a stray alone is believed at once", "back &= self._alone_away(got, found)", "back[:] = False"),
    ),
    *of(
        "sensors/_markers.py",
        "tests/sensors/test_markers.py",
        (
            "a marker may grow and leave its way at once",
            "(np.log(got[i, 2] / sizes[i]) / _GROWN) ** 2 + np.pi * off / (_OFF * _OFF * rest[i, 0])",
            "0.0",
        ),
        (
            "a stray may pull a marker away",
            "max(area / usual - 1.0, 0.0) * max(shape / usual - 1.0, 0.0) < _PULLED * _PULLED",
            "True",
        ),
    ),
    *of(
        "sensors/_fisheye.py",
        "tests/calibration/test_ring_camera.py",
        ("all rings lie in one plane", "heights[i % len(heights)] - pose[11]", "-pose[11]"),
    ),
    *of(
        "sensors/ring_response.py",
        "tests/calibration/test_ring_response.py",
        ("the wall does not tilt", "share * slope", "0.0 * slope"),
    ),
]
