"""One log of readings, followed by Palpate, and by what is usual."""

from functools import cache
from typing import NamedTuple

import numpy as np

from claims.papers.drift.world import BODY, NOISE, PLACE, RATE
from palpate.contact.drift_gate import ContactShape, Jump
from palpate.contact.drift_tracker import DriftTracker
from palpate.contact.locate import Locator
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals.drift import Drift
from palpate.signals.payload import Payload
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE, Recording
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import ZeroState
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh

TARE = 100  # samples at the start
FACETS = 2000
SLOWNESS = 10.0  # s, of the exponential averages
GATE = 0.22  # N, 5.5 deviations of a sample: below it the gated one follows


class Followed(NamedTuple):
    """A window a row: time, zero (n, 6), coefficient (n, q), covariance, status; and the jumps that were met."""

    time: np.ndarray
    zero: np.ndarray
    coefficient: np.ndarray
    covariance: np.ndarray
    status: np.ndarray
    jumps: list[Jump]


@cache
def shape() -> ContactShape:
    vertices, faces = BODY.mesh(FACETS)
    mesh = Mesh.from_arrays(vertices + PLACE, faces, smooth=True)
    return ContactShape(Locator(mesh, noise=NOISE), Placement(Pose.identity()))


def follow(
    time: np.ndarray,
    readings: np.ndarray,
    drift: Drift,
    touched: np.ndarray | None = None,
    smooth: bool = False,
    alone: bool = False,
    payload: Payload | None = None,
    orientation: np.ndarray | None = None,
    temperature: np.ndarray | None = None,
) -> Followed:
    """By the windows of Palpate; `touched` (n,) is what a skin says, `temperature` (n,) [K]."""
    channels = {FORCE: readings[:, :3], TORQUE: readings[:, 3:]}
    if orientation is not None:
        channels[ORIENTATION] = orientation
    log = Recording(time, channels)
    sensor = Compensation(ForceTorque(NOISE), payload)
    sensor.tare(log.picked(slice(0, TARE)))
    follower = DriftTracker(sensor, drift, shape(), alone=alone, smooth=smooth)
    times, states = list[float](), list[ZeroState]()
    for cut in follower.pieces(time):
        follower.enter(float(time[cut.start]), np.nan if temperature is None else float(temperature[cut.start]))
        middle = float(time[cut].mean())
        times.append(middle)
        if not smooth:
            states.append(follower.at(middle))
        skin = None if touched is None else bool(touched[cut].any())
        follower.add(time[cut], sensor.kept(log.picked(cut)), skin)
    follower.finish()
    if smooth:
        states = list(follower.settled())
    zero, coefficient, covariance = (np.array([state[k] for state in states]) for k in range(3))
    return Followed(np.array(times), zero, coefficient, covariance, follower.history().status, follower.gate.jumps)


def one_tare(time: np.ndarray, readings: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(n, 6) at times: the mean of the start, for ever."""
    return np.repeat(readings[:TARE].mean(axis=0)[None], len(at), axis=0)


def exponential(time: np.ndarray, readings: np.ndarray, at: np.ndarray, gated: bool) -> np.ndarray:
    """(n, 6) at the times of windows: an exponential average of them, of those with little force where it is gated."""
    count = round(RATE / 10)
    means = readings[: len(readings) // count * count].reshape(-1, count, 6).mean(axis=1)
    zero, share, out = readings[:TARE].mean(axis=0), 0.1 / SLOWNESS, np.empty((len(means), 6))
    for k, mean in enumerate(means):
        out[k] = zero
        if not gated or np.linalg.norm((mean - zero)[:3]) < GATE:
            zero = zero + share * (mean - zero)
    return out[np.minimum(np.searchsorted(np.arange(1, len(means) + 1) * 0.1, at), len(means) - 1)]
