"""What is touched and where the sensor sits on it, as values: the [surface] of a rig, its files read once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.setup.surface import RigSurface
from palpate.spatial.pose import Pose
from palpate.surfaces import Surface

__all__ = ["Link"]


@dataclass(frozen=True)
class Link:
    """A link of a robot, with the sensors' frame on it.

    Attributes:
        stated: the [surface] of the rig; None where a skin alone is the body.
        folder: where relative paths start.
    """

    stated: RigSurface | None
    folder: Path

    @property
    def mount(self) -> Pose:
        """T_sensor_surface; the identity where there is no surface."""
        return Pose.identity() if self.stated is None else self.stated.pose.pose()

    @property
    def mount_covariance(self) -> Float[np.ndarray, "6 6"] | None:
        """Of the mounting's (rotation vector [rad], translation [m]); None where it is not known."""
        stated = None if self.stated is None else self.stated.pose_covariance
        return None if stated is None else np.asarray(stated, dtype=np.float64)

    @property
    def placement(self) -> float:
        """[m] that touches err by beside what their wrenches explain."""
        return 0.0 if self.stated is None else self.stated.placement

    @property
    def settings(self) -> dict[str, object]:
        """What is in force of the surface, for the record beside a result."""
        return {} if self.stated is None else {"crease": self.stated.crease}

    @property
    def name(self) -> str:
        """What was touched, in a word."""
        if self.stated is None:
            return "the body"
        if self.stated.urdf is not None:
            return f"{self.stated.link} of {Path(self.stated.urdf).name}"
        kind = self.stated.kind.replace("_", " ")
        return Path(str(self.stated.mesh)).name if kind == "mesh" else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"

    def surface(self) -> Surface:
        """Return what is touched, read once for all links of the same files.

        Raises:
            InputError: the rig has no [surface], or a file of it cannot be read.
            GeometryError: there is nothing usable in it.
        """
        return self._surface

    @cached_property
    def _surface(self) -> Surface:
        if self.stated is None:
            raise InputError("the rig has no [surface].", where="rig")
        files = [path for path in self.stated.files(self.folder).values() if path.is_file()]
        stamps = tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in files)
        return _read(self.stated, self.folder, stamps)


@lru_cache(maxsize=1)
def _read(stated: RigSurface, folder: Path, stamps: tuple[tuple[int, int], ...]) -> Surface:
    """Read a surface; `stamps` of its files tell whether they are still the same."""
    return stated.load(folder)
