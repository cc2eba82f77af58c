"""Store pokes of a skin: the wrench of each, the responses of taxels, and the link's pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value


@frozen_value
class Pokes(Value):
    """The n pokes of a skin and the m answers of taxels to them.

    Attributes:
        wrench: (n, 6) on the body [N, N m] in the sensor's frame, minus the untouched reading.
        rotation: (n, 3, 3) and origin: (n, 3) [m] of the link in the sensor's frame (T_sensor_link).
        configuration: (n,) index of the arm's configuration.
        starts: (n + 1,) index at which the answers of each poke begin.
        taxel: (m,) index of the taxel of each answer, at most once in a poke.
        response: (m,) reading above the baseline, in any unit, positive.
        taxels: number of taxels of the skin, including those that never answered.
        noise: (6, 6) covariance of a wrench.
        weight: (n,) 1, less where a poke is doubtful, 0: rejected.
        time: (n,) [s], NaN where not known.
        threshold: of a response, below which there are no answers.
        notes: for the user, a sentence each.

    Raises:
        InputError: arrays that do not fit each other, or a taxel that is not below `taxels`.
    """

    wrench: Float[np.ndarray, "n 6"]
    rotation: Float[np.ndarray, "n 3 3"]
    origin: Float[np.ndarray, "n 3"]
    configuration: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " n1"]
    taxel: Int[np.ndarray, " m"]
    response: Float[np.ndarray, " m"]
    taxels: int
    noise: Float[np.ndarray, "6 6"]
    weight: Float[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    threshold: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.wrench)
        shapes = {"wrench": (6,), "rotation": (3, 3), "origin": (3,), "weight": (), "time": ()}
        for name, tail in shapes.items():
            array = frozen(getattr(self, name), name=name)
            if array.shape != (count, *tail):
                raise InputError(
                    f"{name} must be given for each of {count} pokes, not in shape {array.shape}.", where="pokes"
                )
            object.__setattr__(self, name, array)
        for name in ("configuration", "starts", "taxel"):
            array = np.array(getattr(self, name), dtype=np.int64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in ("response", "noise"):
            object.__setattr__(self, name, frozen(getattr(self, name), name=name))
        whole = len(self.taxel) == len(self.response) and len(self.starts) == count + 1
        if not whole or self.starts[0] or self.starts[-1] != len(self.taxel) or len(self.configuration) != count:
            raise InputError(
                f"of {count} pokes, configuration must have {count} entries, and starts {count + 1}, from 0 to the "
                "length of taxel and response.",
                where="pokes",
            )
        if len(self.taxel) and not 0 <= self.taxel.min() <= self.taxel.max() < self.taxels:
            raise InputError(f"taxels of answers must be below {self.taxels}, counted from 0.", where="pokes")

    @classmethod
    def from_table(
        cls,
        wrench: Float[np.ndarray, "n 6"],
        rotation: Float[np.ndarray, "n 3 3"],
        origin: Float[np.ndarray, "n 3"],
        configuration: Int[np.ndarray, " n"],
        responses: Float[np.ndarray, "n k"],
        *,
        noise: Float[np.ndarray, "6 6"],
        threshold: float = 0.0,
        weight: Float[np.ndarray, " n"] | None = None,
        time: Float[np.ndarray, " n"] | None = None,
    ) -> Pokes:
        """Make `Pokes` from one row of responses (n, k) each; those above the threshold are its answers.

        Other arguments are as the attributes; weights are 1 and times NaN if not given.

        Raises:
            InputError: arrays whose shapes do not agree.
        """
        above = responses > threshold
        poke, taxel = np.nonzero(above)
        count, taxels = (int(size) for size in responses.shape)
        response = responses[poke, taxel]
        starts = np.concatenate([[0], np.cumsum(above.sum(axis=1))])
        weights: Float[np.ndarray, " n"] = np.ones(count) if weight is None else weight
        times: Float[np.ndarray, " n"] = np.full(count, np.nan) if time is None else time
        return cls(
            wrench, rotation, origin, configuration, starts, taxel, response, taxels, noise, weights, times, threshold
        )

    def __len__(self) -> int:
        return len(self.wrench)

    @property
    def configurations(self) -> int:
        """Return the number of arm configurations."""
        return int(self.configuration.max(initial=-1)) + 1

    @property
    def poke(self) -> Int[np.ndarray, " m"]:
        """Return the index of the poke of each answer, (m,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.starts))

    def counts(self) -> Int[np.ndarray, " k"]:
        """Return the number of pokes with a positive weight to which each taxel answered, (k,)."""
        return np.bincount(self.taxel[self.weight[self.poke] > 0], minlength=self.taxels)

    def picked(self, rows: Bool[np.ndarray, " n"]) -> Pokes:
        """Return the `Pokes` that a mask (n,) selects; configurations keep their numbers.

        Raises:
            InputError: another length.
        """
        same = ("wrench", "rotation", "origin", "configuration", "weight", "time")
        picked: dict[str, np.ndarray] = {name: getattr(self, name)[rows] for name in same}
        picked |= {name: getattr(self, name)[rows[self.poke]] for name in ("taxel", "response")}
        return replace(self, **picked, starts=np.concatenate([[0], np.cumsum(np.diff(self.starts)[rows])]))
