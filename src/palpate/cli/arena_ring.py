"""TEMPORARY stand-in of helper h2's room: what a robot's skin says, from the engine with the sensor's errors."""

from __future__ import annotations
from typing import Protocol
import numpy as np

__all__ = ["RingSense", "Sense"]

class Sense(Protocol):
    frame: np.ndarray
    def feel(self, time, truth, dark=False): ...

class RingSense:
    def __init__(self, unit, ring, seed, images=False, torn=False):
        self._rng = np.random.default_rng(seed); self.torn = torn
        self.frame = np.zeros((480, 640, 3), np.uint8)
    def feel(self, time, truth, dark=False):
        if dark: return None
        rows = sorted(([a, f] for a, f, *_ in truth.tolist() if f > 0.05), key=lambda r: -r[1])
        kept = []
        for a, f in rows:
            for k in kept:
                if abs((a - k[0] + np.pi) % (2*np.pi) - np.pi) < np.radians(25):
                    w = k[1] + f; k[0] += f/w*((a-k[0]+np.pi)%(2*np.pi)-np.pi); k[1] = w; break
            else: kept.append([a, f])
        out = np.array(kept).reshape(-1, 2)
        out = out + self._rng.standard_normal(out.shape)*[np.radians(1), 0.1]
        return out[out[:, 1] > 0.2]
