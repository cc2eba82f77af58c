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
        "control/_arm.py",
        "tests/control/test_inverse_kinematics.py",
        ("what the joints sag is left out", "joints[k] = command[k] + offset[k]", "joints[k] = command[k]"),
        ("the point may turn as fast as it moves", "_bound(e, 3, bounds[2] * dt)", "_bound(e, 3, bounds[1] * dt)"),
        ("the last step is forgotten", "last[k] = following[k] - command[k]", "last[k] = 0.0"),
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
    *of(
        "control/_align.py",
        "tests/control/test_follow.py",
        ("turning the payload has no gyroscopic part", "spent = gyro[i]", "spent = 0.0"),
        (
            "too much force is a surface that is further",
            "(pressing - wanted) / stiffness",
            "(wanted - pressing) / stiffness",
        ),
        ("the lowest point is taken for the tip", "along * local[0] + across * local[1]", "0.0 * along"),
        ("the tip stays on the first axis", "depth * n[i]", "depth * axes[i, 2]"),
    ),
    *of(
        "control/_motion_bank.py",
        "tests/control/test_motion_bank.py",
        ("each filter goes on from its own state", "_mix(old, shares, filters[j])", "None"),
        ("a jump lasts", "settled + (1.0 - settled) * left", "1.0"),
        ("the value cannot jump", "jump * dt", "0.0"),
        ("how likely a reading was counts for nothing", "np.exp(likely[i] - best)", "1.0"),
        ("the spread between filters is left out", "filters[i, k] + apart", "filters[i, k] + 0.0 * apart"),
    ),
    *of(
        "control/_servo.py",
        "tests/control/test_servo_model.py",
        ("a ramp is met as late as a step", "slope = whole / ramp if moving else 0.0", "slope = 0.0"),
        ("the free motion is not damped critically", "change = b * decay - w * free", "change = -w * free"),
        ("the end of a ramp is passed over", "start < middle < end", "False"),
        ("feedback is held against the model now", "abs(times[k] - time) < abs(times[nearest] - time)", "False"),
    ),
    *of(
        "control/servo.py",
        "tests/control/test_servo_model.py",
        ("no command is ever missed", "without < 0.5 * off", "False"),
        (
            "commands after one that was lost are lost too",
            "self._take(later[0].time, later.popleft().target)",
            "later.popleft()",
        ),
        ("only the newest command may be lost", "course.take(each.time, each.target)", "None"),
        ("what was modelled since stays wrong", "self._past[k] = self._course.state[0]", "pass"),
        ("a robot that is slow loses commands", "self._usual**2 + USUAL * (size**2 - self._usual**2)", "FAINT**2"),
    ),
    *of(
        "control/probe_face.py",
        "tests/control/test_probe_face.py",
        ("a light touch presses as deep as any", "volume * ratio > patch", "volume * ratio > 0.5 * patch"),
        ("the centre of pressure is where the force leaves", "float(ahead[near].max()) * np.sin(lean)", "0.0"),
    ),
    *of(
        "control/supervisor.py",
        "tests/control/test_supervisor.py",
        ("saturation is silence", "status == Status.SATURATED and self.state != State.APPROACH", "False"),
        ("a lost contact is never given up", "time - self._since > self.limits.patience", "False"),
        ("what stopped can stop anew", "self.state != State.STOPPED", "True"),
    ),
]
