"""From forces and places to joint commands."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "control/_arm.py",
        "tests/control/test_arm.py tests/control/test_inverse_kinematics.py",
        ("a joint that slides turns its point", "out[3, i], out[4, i], out[5, i] = 0.0, 0.0, 0.0", "pass"),
        (
            "the Coriolis term is taken once",
            "2.0 * step[r] * rate[i] + axis[r] * change[i]",
            "step[r] * rate[i]",
            "motion",
        ),
        (
            "the axis does not move with its body",
            "step[r] * rate[i] + axis[r] * change[i]",
            "axis[r] * change[i]",
            "motion",
        ),
        ("the centripetal part is left out", "swing[r] + twice[r]", "swing[r]"),
        ("the damping is not squared", "damping * damping if i == j else 0.0", "damping if i == j else 0.0"),
        (
            "what is missed is counted without the damping",
            "damping * damping * math.sqrt(left / asked)",
            "math.sqrt(left / asked)",
        ),
        ("each joint is shortened by itself", "share = min(share, most / abs(step[k]))", "share = most / abs(step[k])"),
        ("a joint brakes too late", "_brakes(up, change)", "up"),
        ("a step that is not finite goes on", "sound = sound and abs(step[k]) < math.inf", "pass"),
        ("what was faster before may stay so", "min(max(move, -most), most)", "move"),
    ),
    *of(
        "io/arm.py",
        "tests/control/test_arm.py",
        ("a joint passed from its child keeps its sign", "signs[:, None] * axes", "axes"),
        (
            "a transform passed from its child is not turned round",
            "fixed @ joint.origin.inverse()",
            "fixed @ joint.origin",
        ),
        ("joints may be named in any order", "tuple(joints) == names", "{*joints} == {*names}"),
    ),
    *of(
        "control/admittance.py",
        "tests/control/test_admittance.py",
        ("a contact along x turns the probe about x", "return -y, x", "return x, -y"),
        ("the damping is left out", "error - self.damping * velocity", "error"),
        ("the wanted force has the sign of the felt one", "force + wanted", "force - wanted"),
        (
            "turns are about the base's axes",
            "rotation[r, 0] * about_x + rotation[r, 1] * about_y",
            "rotation[0, r] * about_x + rotation[1, r] * about_y",
        ),
    ),
    *of(
        "control/stability.py",
        "tests/control/test_stability.py",
        (
            "a command waits a cycle less",
            "position = state[self.delay + 1] if len(self._servo) else state[self.delay]",
            "position = state[self.delay + 1] if len(self._servo) else state[max(0, self.delay - 1)]",
        ),
        ("the servo is twice as quick", "w = 2.0 / self.lag", "w = 4.0 / self.lag"),
        ("a ramp is a step", "[held - rate, rate] if self.ramp else [np.zeros(m), held]", "[np.zeros(m), held]"),
        (
            "the offset is not smoothed",
            "position - ratio * smoothed - estimate[0]",
            "position - ratio * position - estimate[0]",
        ),
        (
            "gains at the edge pass",
            "admittance_radius(robot, admittance, stiffness) < 1.0",
            "admittance_radius(robot, admittance, stiffness) < 1.1",
            "require_stable",
        ),
    ),
]
