"""Logs of a robot that follows commands, for `palpate calibrate servo`: integrated at 10 kHz by the bilinear rule."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import bilinear, lfilter

RATE, JOINTS = 10_000, 3  # Hz of the plant


@dataclass(frozen=True)
class ServoLog:
    """A robot and its log.

    Attributes:
        delay, lag, period: [s].
        order: of the lag, 2 (critically damped) or 1.
        ramp: whether the robot interpolates within a period, or steps.
        rate: [Hz] of the log's rows, each with the newest command and the position.
        jitter: [s] standard deviation of the times at which commands are sent.
        hidden: [s] of delays, one for each command.
        lost: share of commands that never come.
        noise: [rad] of encoders.
        seed: of all of it.
        seconds: how long the log is.
    """

    delay: float = 0.021
    lag: float = 0.033
    period: float = 0.02
    order: int = 2
    ramp: bool = True
    rate: float = 500.0
    jitter: float = 0.0
    hidden: float = 0.0
    lost: float = 0.0
    noise: float = 2e-5
    seed: int = 0
    seconds: float = 30.0

    def rows(self, motion: str = "mixed") -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Return times (n,), commands and positions (n, 3), and how many commands were lost; or steady, or still."""
        rng, count = np.random.default_rng(self.seed), int(self.seconds / self.period)
        sent = self.period * np.arange(count)
        sent += np.clip(self.jitter * rng.standard_normal(count), -0.4 * self.period, 0.4 * self.period)
        sent[0] = 0.0
        size, frequency = rng.uniform(0.05, 0.2, (4, JOINTS)), rng.uniform(0.2, 1.5, (4, JOINTS))
        waves = 2.0 * np.pi * (frequency * sent[:, None, None] + rng.uniform(size=(4, JOINTS)))
        commands = np.sum(size * np.sin(waves), axis=1)
        if motion != "mixed":
            commands = np.outer(sent, np.full(JOINTS, 0.1 if motion == "steady" else 0.0))
        kept = rng.random(count) >= self.lost
        kept[0] = True
        begins = sent + self.delay + np.maximum(self.hidden * rng.standard_normal(count), -self.delay)
        time = np.arange(int(self.seconds * RATE)) / RATE
        followed = self._followed(self._line(time, begins[kept], commands[kept]))
        stamps = np.arange(0.0, self.seconds - 1e-9, 1.0 / self.rate)
        newest = np.maximum(np.searchsorted(sent, stamps + 1e-9, side="right") - 1, 0)
        seen = np.stack([np.interp(stamps, time, followed[:, k]) for k in range(JOINTS)], axis=1)
        return stamps, commands[newest], seen + self.noise * rng.standard_normal(seen.shape), int(np.sum(~kept))

    def _line(self, time: np.ndarray, begins: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Where the interpolator is: each command is approached from where it is when the command begins."""
        order, ramp = np.argsort(begins, kind="stable"), self.period if self.ramp else 1e-9
        begins, commands = begins[order], commands[order]
        line, place = np.tile(commands[0], (len(time), 1)), commands[0]
        edges = np.searchsorted(time, np.append(begins, np.inf))
        for k, (start, target) in enumerate(zip(begins, commands, strict=True)):
            share = np.clip((time[edges[k] : edges[k + 1]] - start) / ramp, 0.0, 1.0)
            line[edges[k] : edges[k + 1]] = place + share[:, None] * (target - place)
            after = begins[k + 1] - start if k + 1 < len(begins) else ramp
            place = place + min(1.0, after / ramp) * (target - place)
        return line

    def _followed(self, line: np.ndarray) -> np.ndarray:
        w = self.order / self.lag
        plant = ([w**2], [1.0, 2.0 * w, w**2]) if self.order == 2 else ([w], [1.0, w])
        above, below = (np.asarray(each, dtype=np.float64) for each in bilinear(*plant, fs=RATE))
        return line[0] + np.asarray(lfilter(above, below, line - line[0], axis=0))
