"""Make single wrenches with the torsion of a soft finger, forwards from points of exact surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_lab.benchmark.bodies import TouchedBody, box, ellipsoid, torus, ultrasound_probe
from palpate_lab.benchmark.task import MadeTask, TaskTruth, write_body, write_table
from palpate_lab.simulation.contacts import touch_wrenches

FORCE, FRICTION, PITCH = (2.0, 20.0), 0.5, 0.003  # N; tan; m
COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
FULL, SMALL = 300, 15


@dataclass(frozen=True)
class WrenchTask:
    """A task of single touches on one body.

    Attributes:
        body: function that makes the body with n points on it.
        about: short description of the body.
        noise: standard deviation of force and torque of a reading [N, N m].
    """

    body: Callable[[int, np.random.Generator], TouchedBody]
    about: str
    noise: tuple[float, float]

    def __call__(self, folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
        """Make the task in a folder, and write its readings."""
        count = SMALL if small else FULL
        made = self.body(count, rng)
        exact = touch_wrenches(made.points, made.normals, rng, force=FORCE, tan_theta=FRICTION, pitch=PITCH)
        noisy = exact + np.repeat(self.noise, 3) * rng.standard_normal(exact.shape)
        write_body(folder / "body.stl", made.vertices, made.faces)
        write_table(folder / "readings.csv", dict(zip(COLUMNS, noisy.T, strict=True)), digits=9)
        truth = TaskTruth.of(np.arange(count), made.points, exact[:, :3], np.zeros(0))
        return MadeTask(
            "wrench",
            f"{self.about}, touched at one place at a time: {FORCE[0]:g} to {FORCE[1]:g} N, leaning within the "
            "friction, with a torque about the normal",
            "of the mesh",
            count,
            1,
            {"readings.csv": "a wrench a row; its number from 0 is the sample", "body.stl": "the body, in metres"},
            truth,
            {
                "noise": {"force": self.noise[0], "torque": self.noise[1]},
                "friction": FRICTION,
                "torsion": round(PITCH * (1.0 + FRICTION**2), 6),  # m: |torque| / |F . n| of |h| |F|^2 / (F . n)^2
            },
        )


WRENCH_TASKS = {
    "ellipsoid": WrenchTask(ellipsoid, "an ellipsoid of 60 x 40 x 24 mm, convex", (0.0, 0.0)),
    "ellipsoid-noise": WrenchTask(ellipsoid, "an ellipsoid of 60 x 40 x 24 mm, convex", (0.05, 0.002)),
    "torus": WrenchTask(torus, "a torus of 80 mm with a tube of 20 mm, not convex", (0.02, 0.0005)),
    "box": WrenchTask(box, "a box of 60 x 40 x 24 mm with sharp edges", (0.02, 0.0005)),
    "probe": WrenchTask(ultrasound_probe, "a T-shaped ultrasound probe 150 mm out of its sensor", (0.02, 0.0005)),
}
