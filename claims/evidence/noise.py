"""Noise as sensors have it: are ellipses honest where it is 1/f, hums, is quantised, and where gains are off?

Each log is made forwards: a tare of 2 s, then touches of 1.5 s with as much rest between them, on a smooth ellipsoid,
at 500 Hz. The noise has 0.02 N and 0.001 N m of white noise, and what each row says beside it; noise and its spectrum
are taken from the log by `rest_noise`, as `palpate estimate` does. Judged is one sample of each touch, 0.2 s before its
end, against the point that was touched.
"""

from collections.abc import Iterator

import numpy as np

from claims.evidence.bodies import BODIES, R, mesh_of, touched
from claims.evidence.covariance import NOISE, coverage
from claims.row import Row
from palpate import ForceTorque, Locator, Pose, Recording
from palpate.contact import ContactEstimate, WrenchEstimator
from palpate.signals import Butterworth, Kalman
from palpate.signals.filters import Filter
from palpate.signals.noise import Noise, estimate_noise, rest_noise, wrong_noise
from palpate.signals.recording import FORCE, TORQUE

RATE = 500.0  # Hz
BODY = "ellipsoid 1 : 0.7 : 0.5"
MOUNT = Pose(np.eye(3), [0.0, 0.0, 0.05])  # T_sensor_surface
TARE, TOUCH, COUNT, EARLY = 1000, 750, 12, 100  # samples, touches of a log
FILTERS: tuple[Filter | None, ...] = (None, Kalman(), Butterworth(10.0), Butterworth(10.0, 2, zero_phase=True))
KINDS = {  # corner of the noise as 1/f [Hz], hum of 60 Hz and resolution, in deviations of the white noise
    "white": (0.0, 0.0, 0.0),
    "1/f below 5 Hz": (5.0, 0.0, 0.0),
    "60 Hz hum": (0.0, 1.0, 0.0),
    "quantised": (0.0, 0.0, 2.0),
    "1/f below 5 Hz, 60 Hz hum, quantised": (5.0, 1.0, 1.0),
}


def rows(small: bool) -> Iterator[Row]:
    """The deviation, the ellipses, the warning, the gains."""
    logs = 2 if small else 100
    yield _deviations(2 if small else 50)
    for kind in KINDS:
        for made in FILTERS if not small or kind.startswith("1/f below 5 Hz,") else FILTERS[:1]:
            yield _coverage(kind, made, logs)
    yield _warned(2 if small else 50)
    for stated in (0.01, 0.0):
        yield _gains(stated, logs)


def coloured(count: int, kind: str, rng: np.random.Generator) -> np.ndarray:
    """(count, 6) of noise, not quantised yet: white noise through sqrt(1 + corner/f), and a hum in every channel."""
    corner, hum, _ = KINDS[kind]
    frequency = np.fft.rfftfreq(count, 1 / RATE)
    frequency[0] = np.inf
    shaped = np.fft.rfft(rng.standard_normal((count, 6)), axis=0) * np.sqrt(1 + corner / frequency)[:, None]
    time = np.arange(count)[:, None] / RATE
    wave = hum * 2**0.5 * np.sin(2 * np.pi * (60.0 * time + rng.uniform(0, 1, 6)))
    return (np.fft.irfft(shaped, count, axis=0) + wave) * NOISE


def _quantised(readings: np.ndarray, kind: str) -> np.ndarray:
    step = KINDS[kind][2] * NOISE
    return np.round(readings / step) * step if step.any() else readings


def _log(kind: str, rng: np.random.Generator, matrix: np.ndarray | None = None) -> tuple[Recording, np.ndarray]:
    body = BODIES[BODY]
    points, touches = touched(body, COUNT, rng, force=(2.0, 10.0), pitch=0.2 * R)
    sensed = touches @ MOUNT.wrench_matrix().T @ (np.eye(6) if matrix is None else matrix)
    resting = np.zeros((COUNT, TOUCH, 6))
    loads = np.stack([np.repeat(sensed[:, None], TOUCH, axis=1), resting], axis=1).reshape(-1, 6)
    count = TARE + len(loads)
    zero = rng.normal(0.0, 10.0, 6) * NOISE
    readings = np.concatenate([np.zeros((TARE, 6)), loads]) + coloured(count, kind, rng) + zero
    readings = _quantised(readings, kind)
    return Recording(np.arange(count) / RATE, {FORCE: readings[:, :3], TORQUE: readings[:, 3:]}), points


def _answers(log: Recording, sensor: ForceTorque, made: Filter | None) -> ContactEstimate:
    locator = Locator(mesh_of(BODIES[BODY], 20_000), on=0.5, off=0.3)
    chain = WrenchEstimator(locator, sensor, mount=MOUNT, filter=made, rate=RATE, live=False)
    chain.tare(log.picked(slice(0, TARE)))
    found = ContactEstimate.joined([answer.estimate for answer in chain.stream([log])])
    return found[TARE + TOUCH - EARLY + 2 * TOUCH * np.arange(COUNT)]


def _rested(log: Recording) -> Noise:
    noise = rest_noise(log.wrenches())
    if noise is None:
        raise RuntimeError("the log never rests")
    return noise


def _coverage(kind: str, made: Filter | None, logs: int) -> Row:
    name = "raw" if made is None else made.describe(RATE).split(":")[0]
    slack = 3.5 * (0.05 * 0.95 / (COUNT * logs)) ** 0.5 if logs < 100 else 0.0
    return _held(f"{kind}, {name}", (kind, made), logs, 43, slack)


def _gains(stated: float, logs: int) -> Row:
    """Every entry of the sensor's matrix off by 1 %, drawn anew for each log, whose touches share it."""
    what = f"gains and cross-talk off by 1 %, gain_error = {stated:g}, Butterworth 10 Hz"
    return _held(what, ("white", FILTERS[2]), logs, 46, 0.05 if logs < 100 else 0.0, stated)


def _held(
    what: str, of: tuple[str, Filter | None], logs: int, seed: int, slack: float, stated: float | None = None
) -> Row:
    """Of a kind of noise and a filter; `stated` of gains that are off."""
    rng, found, touched = np.random.default_rng(seed), list[ContactEstimate](), list[np.ndarray]()
    scale, matrix = np.repeat([1.0, 0.05], 3), None  # m: the ratio of the noises, and of the ranges
    for _ in range(logs):
        if stated is not None:
            matrix = np.eye(6) + 0.01 * rng.standard_normal((6, 6)) * scale / scale[:, None]
        log, points = _log(of[0], rng, matrix)
        noise = _rested(log)
        sensor = ForceTorque(noise.deviation, spectrum=noise.spectrum, gain_error=stated or 0.0)
        found.append(_answers(log, sensor, of[1]))
        touched.append(points)
    share, mean = coverage(ContactEstimate.joined(found), np.concatenate(touched))
    met, judged = 0.90 - slack <= share <= 0.97 + slack, stated != 0.0
    got = f"{share:.2%}, {mean:.3f}; {COUNT * logs:,} touches in {logs} logs"
    title = f"{what}: truth in the 95 % ellipse, mean squared distance"
    return Row(title, "90 to 97 %" * judged, got, met if judged else None)


def _deviations(logs: int) -> Row:
    """Touched half of the time: `estimate_noise` against the deviation of the error that was added to the readings."""
    rng, worst = np.random.default_rng(44), 0.0
    for kind in ("white", "60 Hz hum", "quantised"):
        for _ in range(logs):
            log, _ = _log(kind, rng)
            found = estimate_noise(log.wrenches()) or Noise(np.zeros(6), 0)
            _, hum, step = KINDS[kind]
            true = NOISE * (1 + hum**2 + step**2 / 12) ** 0.5
            worst = max(worst, float(np.abs(found.deviation / true - 1).max()))
    what = "`estimate_noise` of logs touched half of the time, white, with a hum, quantised: off the truth at most"
    return Row(what, "20 %", f"{worst:.1%}; {3 * logs} logs", worst <= 0.2)


def _warned(logs: int) -> Row:
    rng, said = np.random.default_rng(45), {0.4: 0, 1.0: 0, 2.5: 0}
    for _ in range(logs):
        seen = _rested(_log("white", rng)[0]).deviation
        for share in said:
            said[share] += wrong_noise(share * NOISE, seen) != ""
    got = ", ".join(f"{share:g} times: {count} of {logs}" for share, count in said.items())
    met = list(said.values()) == [logs, 0, logs]
    return Row("noise stated at 0.4, 1 and 2.5 times the truth: warned", "all, none, all", got, met)
