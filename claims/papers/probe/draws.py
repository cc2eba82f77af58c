"""What goes wrong between the probe's surface and the estimate, one cause at a time or together, seeded by cause.

A *build* is one assembly of sensor, connector and probe, with its marks drawn on by one housing. Each cause has dice of
its own, so that what it does alone is what it does among the others.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from claims.papers.probe import assumed
from palpate import Kalman, Pose

CAUSES = ("noise, single reading", "noise, filtered", "sensor", "payload", "mesh", "assembly", "marking")
FILTERED = float(Kalman().recursion(assumed.RATE).share[-1])  # what the filter leaves of white noise, as a variance


@dataclass(frozen=True)
class Draws:
    """The causes for `builds` builds, on one probe.

    Args:
        builds: how many.
        seed: of all dice.
    """

    builds: int
    seed: int

    def sensed(self, wrenches: np.ndarray, causes: Collection[str], case: int) -> np.ndarray:
        """Wrenches on the probe -> what the estimator is given, both (builds, marks, repeats, 6)."""
        shape = wrenches.shape
        if "assembly" in causes:
            wrenches = np.einsum("bij,bmrj->bmri", self._assembly().wrench_matrix(), wrenches)
        if "sensor" in causes:
            scale = assumed.RANGE[:, None] / assumed.RANGE
            wrong = assumed.SENSOR * scale * self._dice("sensor").standard_normal((self.builds, 6, 6))
            wrenches = wrenches + np.einsum("bij,bmrj->bmri", wrong, wrenches)
        if "payload" in causes:
            wrenches = wrenches + self._payload(shape[:-1], case)
        for name, share in (("noise, single reading", 1.0), ("noise, filtered", FILTERED)):
            if name in causes:
                noise = self._dice("noise", case).standard_normal(shape) * assumed.NOISE
                wrenches = wrenches + np.sqrt(share) * noise
        return wrenches

    def missed(self, count: int, repeats: int, causes: Collection[str], case: int) -> np.ndarray:
        """By how much [m] the tip's axis misses the nominal mark, (builds, marks, repeats, 2) in the tangent plane."""
        if "marking" not in causes:
            return np.zeros((self.builds, count, repeats, 2))
        drawn, pressed = self._dice("marking"), self._dice("marking", case + 1)
        housing = drawn.uniform(-assumed.PRINTED, assumed.PRINTED, (self.builds, 1, 1, 2))
        hole = drawn.uniform(-assumed.PRINTED, assumed.PRINTED, (self.builds, count, 1, 2))
        dot = drawn.uniform(-assumed.PEN, assumed.PEN, (self.builds, count, 1, 2))
        return housing + hole + dot + pressed.uniform(-assumed.PEN, assumed.PEN, (self.builds, count, repeats, 2))

    def worse_payload(self, wrenches: np.ndarray) -> np.ndarray:
        """Instead of all causes: the weight misjudged as on the real recording of payload/, a press at a time."""
        share = assumed.WORSE_RESIDUE * assumed.WEIGHT / np.sqrt(3)
        force = share * self._dice("worse").standard_normal((*wrenches.shape[:-1], 3))
        return wrenches + np.concatenate([force, np.cross([0.0, 0.0, assumed.CENTRE], force)], axis=-1)

    def _dice(self, cause: str, case: int = 0) -> np.random.Generator:
        return np.random.default_rng([self.seed, sum(map(ord, cause)), case])

    def _assembly(self) -> Pose:
        """T_sensor_probe for each build, next to the identity: each fit is off at both of its ends."""
        ends = self._dice("assembly").uniform(-assumed.PRINTED, assumed.PRINTED, (self.builds, len(assumed.FITS), 2, 3))
        turns = (ends[..., 1, :] - ends[..., 0, :]) / assumed.CLAMP  # about some axis each, the order means nothing
        shifts = ends.mean(axis=-2)
        whole = Pose(np.broadcast_to(np.eye(3), (self.builds, 3, 3)), np.zeros((self.builds, 3)))
        for fit, height in enumerate(assumed.FITS):
            about = np.array([0.0, 0.0, height])
            rotation = Rotation.from_rotvec(turns[:, fit]).as_matrix()
            whole = whole @ Pose(rotation, about - rotation @ about + shifts[:, fit])
        return whole

    def _payload(self, shape: tuple[int, ...], case: int) -> np.ndarray:
        """Drift, a turned weight and what the noise left in the payload model; once a press (a mark of a build)."""
        dice = self._dice("payload", case)
        once = (*shape[:2], 1)
        drift = assumed.DRIFT * dice.standard_normal((*once, 6))
        model = assumed.NOISE / np.sqrt(assumed.ZEROING) * dice.standard_normal((shape[0], 1, 1, 6))
        turned = assumed.WEIGHT * assumed.ORIENTATION * dice.standard_normal((*once, 3))
        weight = np.concatenate([turned, np.cross([0.0, 0.0, assumed.CENTRE], turned)], axis=-1)
        return np.broadcast_to(drift + model + weight, (*shape, 6))
