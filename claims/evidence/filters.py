"""Filters: do they do to a sine what they say, and is the covariance that they leave honest?

Sines go through `WrenchEstimator.stream`, three at once, one on each axis of the force; truth is the formula and,
independently of it, scipy.signal (the Kalman gain from scipy's Riccati equation). Coverage is that of 95 % ellipses of
the last sample of many runs (zero phase: of the middle one), each with its own contact, a start of the filter of its
own, and noise of 0.02 N and 0.001 N m.
"""

from collections.abc import Iterator

import numpy as np
from scipy import linalg, signal

from claims.evidence.bodies import BODIES, R, mesh_of, touched
from claims.evidence.covariance import NOISE, coverage
from claims.row import Row
from palpate import ForceTorque, Locator, Pose, Recording
from palpate.contact import ContactEstimate, WrenchEstimator
from palpate.signals import Butterworth, Kalman
from palpate.signals.filters import Filter
from palpate.signals.recording import FORCE, TORQUE
from palpate.surfaces import plane

RATE = 200.0  # Hz
PAPER = Kalman(1e-6, 2e-4)
ONE_PASS = (PAPER, Kalman(1e-4, 1e-3), Butterworth(15.0), Butterworth(20.0, 4))
ZERO_PHASE = Butterworth(15.0, 2, zero_phase=True)
SHARES = (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0)  # of the -3 dB point
APART = 0.01  # of a frequency: to either side of it, for the slope of the phase
MOUNT = Pose(np.eye(3), [0.0, 0.0, 0.05])  # T_sensor_surface
RUN = 80  # samples, several times what any of these filters remembers
BLOCK = 8192  # samples, as a reader gives them


def rows(small: bool) -> Iterator[Row]:
    yield _said()
    for made in (*ONE_PASS, ZERO_PHASE):
        yield _sines(made, 4.0 if small else 20.0)
    count = 300 if small else 10_000
    for made in ONE_PASS[:2]:
        yield _coverage(made, "contact that walks at random as q/r says", count, True)
    for made in (*ONE_PASS[2:], ZERO_PHASE):
        yield _coverage(made, "steady contact", count, True)
    yield _coverage(PAPER, "steady contact", count, False)


def _said() -> Row:
    said = PAPER.describe(RATE)
    met = "2.3 Hz" in said and "68 ms" in said
    return Row("the paper's setting, as `describe` says it", "2.3 Hz and 68 ms at 200 Hz", said, met)


def _name(made: Filter) -> str:
    return made.describe(RATE).split(":")[0]


# --- gain and delay


def _sines(made: Filter, seconds: float) -> Row:
    """Largest deviations over the frequencies; a delay of zero phase is told in samples."""
    frequencies = made.bandwidth(RATE) * np.array(SHARES)
    gains, delays = np.array([_measured(made, frequency, seconds) for frequency in frequencies]).T
    exact_gains, exact_delays = _response(made, frequencies)
    formula = _off(gains, made.gain(frequencies, RATE)), _late(delays, made.delay(frequencies, RATE))
    library = _off(gains, exact_gains), _late(delays, exact_delays)
    unit = " of a sample" if made.zero_phase else ""
    places = f"{frequencies[0]:.2g} to {frequencies[-1]:.2g} Hz"
    got = f"gain {formula[0]:.1e}, delay {formula[1]:.1e}{unit}; from scipy's {library[0]:.1e}, {library[1]:.1e}{unit}"
    what = f"{_name(made)}: gain and delay of sines at {RATE:g} Hz, {places}, off the formula at most"
    met = max(*formula, *library) <= 0.02
    return Row(what, f"2 %, and of {'a sample' if made.zero_phase else 'the delay'}", got, met)


def _off(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.max(np.abs(found / exact - 1.0)))


def _late(found: np.ndarray, exact: np.ndarray) -> float:
    """Of the delay itself; in samples where there should be none."""
    return float(np.max(np.abs(found) * RATE)) if not np.any(exact) else _off(found, exact)


def _measured(made: Filter, frequency: float, seconds: float) -> tuple[float, float]:
    """Gain and group delay [s], from whole seconds in the middle, far from either end."""
    settled = 10.0  # s
    time = np.arange(round((seconds + 2 * settled) * RATE)) / RATE
    waves = 2 * np.pi * frequency * np.array([1.0, 1.0 - APART, 1.0 + APART])
    sines = np.sin(time[:, None] * waves)
    chain = WrenchEstimator(Locator(plane((0, 0, 0), (0, 0, 1))), ForceTorque(), filter=made, rate=RATE)
    log = Recording(time, {FORCE: sines, TORQUE: np.zeros_like(sines)})
    force = ContactEstimate.joined([found.estimate for found in chain.stream([log])]).force
    inner = (time >= settled) & (time < settled + seconds)
    gains, phases = zip(*(_wave(time[inner], force[inner, k], wave) for k, wave in enumerate(waves)), strict=True)
    turned = np.angle(np.exp(1j * (phases[2] - phases[1])))
    return gains[0], -turned / (waves[2] - waves[1])


def _wave(time: np.ndarray, values: np.ndarray, omega: float) -> tuple[float, float]:
    """Size and phase of size * sin(omega t + phase), by least squares."""
    design = np.stack([np.sin(omega * time), np.cos(omega * time)], axis=1)
    sine, cosine = np.linalg.lstsq(design, values, rcond=None)[0]
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


def _response(made: Filter, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain and delay [s] by scipy."""
    if isinstance(made, Kalman):
        one = np.eye(1)
        prior = linalg.solve_discrete_are(one, one, made.q * one, made.r * one)[0, 0]
        gain = prior / (prior + made.r)
        b, a = np.array([gain]), np.array([1.0, gain - 1.0])
    else:
        b, a = signal.butter(made.order, made.cutoff, fs=RATE)
    size = np.abs(signal.freqz(b, a, worN=frequencies, fs=RATE)[1])
    if made.zero_phase:
        return size**2, np.zeros_like(size)
    return size, signal.group_delay((b, a), w=frequencies, fs=RATE)[1] / RATE


# --- covariance


def _coverage(made: Filter, what: str, count: int, judged: bool) -> Row:
    """Each run is a contact of its own on a smooth ellipsoid; walks are made backwards from the sample judged."""
    rng, body = np.random.default_rng(41), BODIES["ellipsoid 1 : 0.7 : 0.5"]
    points, touches = touched(body, count, rng, force=(2.0, 10.0), pitch=0.2 * R)
    wrenches = np.repeat((touches @ MOUNT.wrench_matrix().T)[:, None], RUN, axis=1)
    if isinstance(made, Kalman) and "walks" in what:
        steps = rng.standard_normal((count, RUN - 1, 6)) * NOISE * (made.q / made.r) ** 0.5
        wrenches[:, :-1] += np.cumsum(steps, axis=1)[:, ::-1]
    wrenches += rng.standard_normal(wrenches.shape) * NOISE
    found = _answers(made, wrenches, RUN // 2 if made.zero_phase else RUN - 1)
    share, mean = coverage(found, points)
    scatter = 3.5 * (0.05 * 0.95 / count) ** 0.5 if count < 10_000 else 0.0  # of few runs
    got = f"{share:.2%}, {mean:.3f}; {count:,} runs, {np.count_nonzero(~found.answered)} not answered"
    name = f"{_name(made)}, {what}: truth in the 95 % ellipse, mean squared distance"
    return Row(name, "93 to 97 %" if judged else "", got, abs(share - 0.95) <= 0.02 + scatter if judged else None)


def _answers(made: Filter, wrenches: np.ndarray, which: int) -> ContactEstimate:
    """Of one sample of each run; before each, one of nothing, a second apart, so that nothing is carried over."""
    count = len(wrenches)
    readings = np.concatenate([np.zeros((count, 1, 6)), wrenches], axis=1)
    time = 2.0 * np.arange(count)[:, None] + np.r_[-1.0, np.arange(RUN) / RATE]
    mesh = mesh_of(BODIES["ellipsoid 1 : 0.7 : 0.5"], 20_000)
    chain = WrenchEstimator(
        Locator(mesh, noise=NOISE, on=0.5, off=0.3), ForceTorque(NOISE), mount=MOUNT, filter=made, rate=RATE
    )
    flat = readings.reshape(-1, 6)
    log = Recording(time.ravel(), {FORCE: flat[:, :3], TORQUE: flat[:, 3:]})
    blocks = (log.picked(slice(start, start + BLOCK)) for start in range(0, len(log), BLOCK))
    found = ContactEstimate.joined([answer.estimate for answer in chain.stream(blocks)])
    return found[np.arange(count) * (RUN + 1) + 1 + which]
