"""Record which sensor of a robot each row of contacts is from, and which link it touches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from palpate.errors import InputError
from palpate.spatial._arrays import INT64, Value, frozen
from palpate.spatial.arguments import frozen_value, integer

EXPECTED = "expected"
"""Name of the feature that is 1 where a sensor is always touched, such as at a foot: its contacts are no events."""


class Origin(NamedTuple):
    """A sensor of a robot and the link whose contacts it measures, by their names; both "" for a rig of one sensor."""

    sensor: str = ""
    link: str = ""


@frozen_value
class Origins(Value):
    """The sensor and the link of each of n rows.

    Attributes:
        index: (n,) index in `among`.
        among: sensors and their links.

    Raises:
        InputError: an index is not in `among`.
    """

    index: Int[np.ndarray, " n"]
    among: tuple[Origin, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", frozen(self.index, dtype=INT64))
        object.__setattr__(self, "among", tuple(Origin(*each) for each in self.among))
        if len(self.index) and not (self.index.min() >= 0 and self.index.max() < len(self.among)):
            raise InputError(f"index must be from 0 to {len(self.among) - 1}, the places in `among`.")

    @classmethod
    def single(cls, origin: Origin, count: int) -> Origins:
        """Make `Origins` of as many rows of one sensor.

        Raises:
            InputError: `count` is not a whole number.
        """
        return cls(np.zeros(integer(count, "count"), dtype=np.int64), (origin,))

    @classmethod
    def of_names(cls, sensors: Sequence[str], links: Sequence[str]) -> Origins:
        """Make `Origins` from the names of each row.

        Raises:
            InputError: there are not as many links as sensors.
        """
        if len(sensors) != len(links):
            raise InputError(f"links must be {len(sensors)} names, one for each sensor, not {len(links)}.")
        pairs = list(map(Origin, sensors, links))
        places = {each: k for k, each in enumerate(dict.fromkeys(pairs))}
        return cls(np.array([places[each] for each in pairs], dtype=np.int64), tuple(places))

    @classmethod
    def joined(cls, parts: Sequence[Origins]) -> Origins:
        """Join `Origins` in order.

        Raises:
            InputError: there are none.
        """
        if not parts:
            raise InputError("parts must be at least one Origins, and is empty.")
        places = {each: k for k, each in enumerate(dict.fromkeys(each for part in parts for each in part.among))}
        moved = [np.array([places[each] for each in part.among], dtype=np.int64)[part.index] for part in parts]
        return cls(np.concatenate(moved), tuple(places))

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, which: slice | np.ndarray) -> Origins:
        """Return the `Origins` of the rows that a slice, mask or array of indices picks."""
        return Origins(self.index[which], self.among)

    @property
    def sensor(self) -> np.ndarray:
        """Name of each row's sensor, (n,) text."""
        return np.array([each.sensor for each in self.among] or [""])[self.index]

    @property
    def link(self) -> np.ndarray:
        """Name of each row's link, (n,) text."""
        return np.array([each.link for each in self.among] or [""])[self.index]

    def rows_of(self, sensor: str) -> Bool[np.ndarray, " n"]:
        """Return a mask (n,) of the rows of one sensor.

        Raises:
            InputError: there is no such sensor.
        """
        known = np.array([each.sensor == sensor for each in self.among], dtype=bool)
        if not known.any():
            names = ", ".join(each.sensor for each in self.among)
            raise InputError(f"there is no sensor {sensor!r} among these contacts, which are of {names or 'none'}.")
        return known[self.index]
