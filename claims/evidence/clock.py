"""Clock and inertia: poses whose stamps are off, slow poses under quick wrenches, arms that move.

Truth is `claims.evidence.moving`: orientation, position and acceleration in closed form, forces by Newton and Euler.
A load of 0.5 kg hangs 45 mm off the sensor; noise is 0.02 N, and 0.01 degrees and 0.1 mm for poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from claims.evidence.moving import Swing, moving_wrenches
from claims.row import Row
from palpate import Payload, Recording
from palpate.calibration.clock import identify_offset, suspected_offset
from palpate.signals.motion import Motion
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, POSITION, TORQUE, UNSTEADY
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.pose_track import PoseTrack
from palpate_lab.simulation.session import GRAVITY, Load

LOAD = Load(0.5, np.array([0.002, -0.001, 0.045]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3]))
PAYLOAD = Payload(LOAD.mass * GRAVITY, LOAD.force_bias, LOAD.center_of_mass, LOAD.torque_bias)
NOISE = np.array([0.02] * 3 + [0.001] * 3)  # N, N m
PLACE, TURN = 1e-4, np.radians(0.01)  # m, rad: noise of the poses
OFFSET = 0.040  # s
SWAYS = {  # what half a kilogram of this reads
    "slow and wide, 0.3 m at 0.4 Hz": Swing(sway=(0.3, 0.3, 0.3), sway_rate=(0.4, 0.41, 0.39)),
    "quick and short, 0.05 m at 1 Hz": Swing(sway=(0.05, 0.05, 0.05), sway_rate=(1.0, 1.03, 0.97)),
}


@dataclass(frozen=True)
class Motions:
    """Swings about three axes: amplitudes [rad] and rates [Hz] drawn evenly from these."""

    name: str
    swing: tuple[float, float]
    rate: tuple[float, float]

    def draw(self, rng: np.random.Generator) -> Swing:
        return Swing(swing=tuple(rng.uniform(*self.swing, 3)), swing_rate=tuple(rng.uniform(*self.rate, 3)))


USUAL = Motions("17 to 34 degrees at 0.1 to 0.25 Hz", (0.3, 0.6), (0.10, 0.25))
QUICK = Motions("the same at 0.25 to 0.5 Hz", (0.3, 0.6), (0.25, 0.5))


def rows(small: bool) -> Iterator[Row]:
    """20 motions of 30 s, as the issue has them, then quicker ones; inertia."""
    count, lasting = (1, 10.0) if small else (20, 30.0)
    yield from _clock(USUAL, count, lasting, True)
    yield from _clock(QUICK, count, lasting, False)
    yield from _far(2 if small else 40)
    yield from _inertia(8.0 if small else 60.0)


def _far(count: int) -> Iterator[Row]:
    """Poses at 100 Hz that are 0.1 to 1 s off, and on time, of an arm that is touched for 1 s in every 4."""
    rng, hinted, near, wrong = np.random.default_rng(62), 0, 0, 0
    for k in range(count):
        time = np.arange(round(30.0 * 500)) / 500
        swing, late = (USUAL if k % 2 else QUICK).draw(rng), rng.uniform(0.1, 1.0) * rng.choice([-1.0, 1.0])
        wrenches = moving_wrenches(LOAD, swing.at(time)) + rng.normal(size=(len(time), 6)) * NOISE
        wrenches[:, 2] -= np.where(time % 4.0 > 3.0, 5.0, 0.0)
        posed = np.arange(-2.0, 32.0, 0.01)
        stamped = _noisy(swing.at(posed).quaternion, rng)
        for offset in (late, 0.0):
            track = PoseTrack(offset=-offset)
            track.add(posed, stamped)
            quaternions = track.at(time)[0]
            hint = suspected_offset(time, wrenches, quaternions, PAYLOAD)
            hinted, wrong = hinted + (offset != 0.0 and hint != 0.0), wrong + (offset == 0.0 and hint != 0.0)
            if offset:
                found = identify_offset(time, wrenches, time, quaternions, payload=PAYLOAD)
                near += abs(found.offset - offset) <= 0.02
    what = f"{count} logs with poses 0.1 to 1 s off, touched a quarter of the time"
    yield Row(f"{what}: a hint at `calibrate clock`", "all", f"{hinted}", hinted == count)
    yield Row(f"{what}: offset within 20 ms", ">= 95 %", f"{near / count:.1%}", near >= 0.95 * count)
    yield Row(f"{count} logs on one clock: hints", "0", f"{wrong}", wrong == 0)


def _clock(motions: Motions, count: int, lasting: float, judged: bool) -> Iterator[Row]:
    """Offsets found without knowing the payload; residuals with it."""
    rng = np.random.default_rng(61)
    errors, scores, left = [], [], []
    for _ in range(count):
        time, wrenches, stamps, quaternions = _log(motions.draw(rng), lasting, rng)
        found = identify_offset(time, wrenches, stamps, quaternions)
        errors.append(found.offset - OFFSET)
        scores.append(errors[-1] / found.deviation)
        left.append(_left(time, wrenches, PoseTrack(offset=found.offset), stamps, quaternions))
        left[-1] += _left(time, wrenches, PoseTrack(), stamps, quaternions)[1:]
    worst, score = np.abs(errors).max(), np.sqrt(np.mean(np.square(scores)))
    name = f"poses at 10 Hz, 40 ms late, under 1 kHz wrenches, {motions.name}"
    got = f"{1e3 * worst:.2f} ms at worst of {count}; rms {1e3 * np.sqrt(np.mean(np.square(errors))):.2f} ms, which is"
    got += f" {score:.2f} of the stated deviation"
    yield Row(f"{name}: offset found", "within 2 ms" if judged else "", got, worst <= 2e-3 if judged else None)
    weight, whole, late = np.max(left, axis=0)
    typical = np.median(left, axis=0)
    got = f"{whole:.3f} at most, median {typical[1]:.3f}; weight only: {weight:.3f}, {typical[0]:.3f}"
    got += f"; with the offset taken as 0: {late:.1f}"
    what = f"{name}: residual force over the noise, weight and inertia from these poses"
    yield Row(what, "<= 1.2" if judged else "", got, whole <= 1.2 if judged else None)


def _log(swing: Swing, lasting: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Times and wrenches of a free sensor at 1 kHz; stamps and quaternions at 10 Hz, stamped early by OFFSET."""
    time = np.arange(round(lasting * 1000)) / 1000
    wrenches = moving_wrenches(LOAD, swing.at(time)) + rng.normal(size=(len(time), 6)) * NOISE
    posed = np.arange(-1.0, lasting + 1.0, 0.1) + rng.uniform(0.0, 0.1)
    return time, wrenches, posed - OFFSET, _noisy(swing.at(posed).quaternion, rng)


def _noisy(quaternions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    turned = Rotation.from_rotvec(rng.normal(0.0, TURN, (len(quaternions), 3)))
    return (Rotation.from_quat(quaternions) * turned).as_quat()


def _left(
    time: np.ndarray, wrenches: np.ndarray, track: PoseTrack, stamps: np.ndarray, quaternions: np.ndarray
) -> list[float]:
    """What compensation leaves of a free sensor, over the noise: of weight only, and of inertia too."""
    track.add(stamps, quaternions, np.zeros((len(stamps), 3)))  # the sensor turns about its origin
    quaternion, position = track.at(time)
    channels = {FORCE: wrenches[:, :3], TORQUE: wrenches[:, 3:], ORIENTATION: quaternion, POSITION: position}
    log = Recording(time, channels)
    return [_residual(log)[0], _residual(log, "poses")[0]]


# --- inertia


def _inertia(lasting: float) -> Iterator[Row]:
    """The same motion without accelerations, with those of its poses, and with an accelerometer's."""
    for name, swing in SWAYS.items():
        log, felt = _moving(swing, lasting)
        what = f"{name} ({felt:.1f} m/s^2 rms), poses at 100 Hz"
        alone = _residual(log)
        ways = {"poses": "accelerations from poses", "imu": "from an accelerometer (0.01 m/s^2 noise)"}
        for source, way in ways.items():
            force, normalised = _residual(log, source)
            got = f"{force:.2f} ({normalised:.2f} of what is stated; weight only {alone[0]:.0f})"
            yield Row(f"{what}, {way}: residual force over the noise", "", got)
        got = f"{_residual(log, 'none')[1]:.2f}"
        yield Row(f"{what}, no acceleration: residual over its widened deviation", "about 1", got)
    log, _ = _moving(Swing(start=1e9), lasting)
    got = f"{_residual(log, 'none')[1]:.2f}"
    yield Row("at rest, no acceleration: residual over its deviation", "about 1", got)


def _moving(swing: Swing, lasting: float) -> tuple[Recording, float]:
    """Wrenches at 500 Hz, an accelerometer, poses between which rows run straight; rms acceleration of an axis."""
    rng = np.random.default_rng(67)
    time = np.arange(round(lasting * 500)) / 500
    course = swing.at(time)
    wrenches = moving_wrenches(LOAD, course) + rng.normal(size=(len(time), 6)) * NOISE
    posed = np.arange(-0.2, lasting + 0.2, 0.01)
    there, track = swing.at(posed), PoseTrack()
    track.add(posed, _noisy(there.quaternion, rng), there.position + rng.normal(0.0, PLACE, (len(posed), 3)))
    quaternion, position = track.at(time)
    felt = course.in_sensor(course.acceleration - GRAVITY) + rng.normal(0.0, 0.01, (len(time), 3))
    channels = {FORCE: wrenches[:, :3], TORQUE: wrenches[:, 3:], ORIENTATION: quaternion, POSITION: position}
    return Recording(time, {**channels, ACCELERATION: felt}), float(np.sqrt(np.mean(course.acceleration**2)))


def _residual(log: Recording, source: str | None = None) -> tuple[float, float]:
    """Rms force along an axis over the noise, and over what is stated; None: nothing is known of the motion."""
    if source is None:
        kept = {name: values for name, values in log.channels.items() if name != ACCELERATION}
        log = replace(log, channels=kept)
    else:
        options = {"lever": LOAD.center_of_mass, "gravity": PAYLOAD.gravity}
        (log,) = Motion(source, **options).stream(iter([log]))
    rotations = rotation_from_quaternion(log.channels[ORIENTATION])
    force = PAYLOAD.compensate(log.wrenches(), rotations, log.channels.get(ACCELERATION))[0][:, :3]
    unsteady = log.channels.get(UNSTEADY, np.zeros((len(log), 1)))
    stated = np.sqrt(NOISE[0] ** 2 + (LOAD.mass * unsteady) ** 2)
    return float(np.sqrt(np.mean(force**2)) / NOISE[0]), float(np.sqrt(np.mean((force / stated) ** 2)))
