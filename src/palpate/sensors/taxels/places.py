"""Store the place of each taxel of a skin, its covariance and its module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from math import nan

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose

SURFACE_POSE = "surface_pose"  # in the provenance: of the surface in the taxels' frame, x y z [m] qx qy qz qw


@frozen_value
class TaxelPlaces(Value):
    """Places of k taxels in the frame of the link that carries them; NaN: not known.

    Attributes:
        positions: (k, 3) [m]; NaN for an index that has no taxel.
        normals: (k, 3) outward, unit.
        covariance: (k, 3, 3) [m^2] of the positions.
        module: (k,) index of each taxel's module, -1: none.
        pokes: (k,) number of pokes to which each taxel responded; 0: placed by its module.
        relative: (k,) [m] standard deviation (root of the trace) after one rigid motion of the skin is removed.
        reach: [m] standard deviation of the response to a poke over its distance from the taxel.
        configurations: (d, 8) of the arm during pokes: pose of the link in the sensor's frame, x y z [m] and quaternion
            x y z w, and the number of pokes.
        noise: (6,) standard deviations of the wrench of a poke [N, N m]; empty: not known.
        provenance: origin of the places.
        notes: notes for the user, a sentence each.
        ids: (k,) number of each taxel in the names of a log's columns, as the file of the places states it; None: it
            states none. A model does not store it.

    Raises:
        InputError: arrays that are not of k taxels.
    """

    positions: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    module: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    pokes: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    relative: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    reach: float = nan
    configurations: Float[np.ndarray, "d 8"] = field(default_factory=lambda: np.zeros((0, 8)))
    noise: Float[np.ndarray, " six"] = field(default_factory=lambda: np.zeros(0))
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()
    ids: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        count = len(self.positions)
        unknown = {"covariance": nan, "relative": nan, "module": -1, "pokes": 0}
        shapes = {"positions": (3,), "normals": (3,), "covariance": (3, 3), "relative": (), "module": (), "pokes": ()}
        for name, tail in shapes.items():
            given = np.asarray(getattr(self, name))
            if name in unknown and not given.size:
                given = np.full((count, *tail), unknown[name])
            if given.shape != (count, *tail):
                raise InputError(
                    f"{name} must be given for each of {count} taxels, not in shape {given.shape}.", where="taxels"
                )
            array = np.array(given, dtype=np.int64) if name in ("module", "pokes") else frozen(given)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "configurations", frozen(self.configurations, tail=(8,), name="configurations"))
        object.__setattr__(self, "noise", frozen(self.noise, name="noise"))

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def there(self) -> Bool[np.ndarray, " k"]:
        """Return bools (k,), whether each index has a taxel."""
        return np.asarray(np.isfinite(self.positions).all(axis=1), dtype=bool)

    @property
    def modules(self) -> int:
        """Return one more than the largest index of a module."""
        return int(self.module.max(initial=-1)) + 1

    def in_surface(self) -> TaxelPlaces:
        """Return `TaxelPlaces` in the frame of the surface on which they were found, if its pose was recorded.

        `configurations` stay those of the link.

        Raises:
            InputError: the record is not seven numbers.
        """
        if SURFACE_POSE not in self.provenance:
            return self
        try:
            numbers = np.array(self.provenance[SURFACE_POSE].split(), dtype=np.float64).reshape(7)
        except ValueError as problem:
            raise InputError("must be seven numbers, x y z qx qy qz qw.", where=SURFACE_POSE) from problem
        back = Pose.from_quaternion(numbers[3:], numbers[:3]).inverse()
        kept = {name: text for name, text in self.provenance.items() if name != SURFACE_POSE}
        return replace(
            self,
            positions=back.apply(self.positions),
            normals=back.rotate(self.normals),
            covariance=back.rotation @ self.covariance @ back.rotation.T,
            provenance=kept,
        )

    def deviations(self) -> Float[np.ndarray, " k"]:
        """Return each place's standard deviation (k,) [m], the root of its covariance's trace; NaN where not known."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))
