"""Touches in a series of contacts: start, end, force and point of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from types import MappingProxyType, SimpleNamespace

import numpy as np
from jaxtyping import Float, Int

from palpate.calls import called_as
from palpate.contact.origins import Origin, Origins
from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value, takes_arrays

__all__ = ["Events", "largest_deviation"]

_OTHER = ("features", "paths", "origins")  # fields that are not arrays


@called_as("contacts.touches()[0]", contacts="contacts[(contacts.time >= touch.start) & (contacts.time <= touch.end)]")
class Touch(SimpleNamespace):
    """A single touch of `Events`: the same attributes, numbers and vectors, its `path` and its `duration` [s]."""


@frozen_value
class Events(Value):
    """Touches of one identity each, in the order in which they began; two at once are two touches.

    Attributes:
        start: (k,) [s] of the first answered sample.
        end: (k,) [s] of the last.
        point: (k, 3) [m] of a sample near the mean of the touch's strong part: of the points in `paths` whose 0.1 s
            reach 0.8 of the largest force, the nearest to their mean, weighted by one over the trace of the covariance.
        covariance: (k, 3, 3) [m^2] of that point.
        normal: (k, 3) outward unit normal there.
        peak_force: (k,) [N] largest length of the force.
        peak_time: (k,) [s] time of the largest force.
        mean_force: (k,) [N] mean length of the force.
        slid: (k,) [m] largest distance of the point, averaged over 0.1 s, from the first such average.
        samples: (k,) number of answered samples.
        ambiguous: (k,) share of them whose status is AMBIGUOUS.
        identity: (k,) of the contact; 0 if a sensor has one at a time.
        paths: k arrays (m, 4): time [s] and point [m] of the sample nearest to the mean of each 0.1 s of a touch.
        features: name -> (k,) value that the sensor adds, in the sample with the largest force; NaN if it has none.
        origins: sensor and link of each touch, where a robot has several sensors; None: all are of one.

    Raises:
        InputError: arrays of other or different shapes.
    """

    start: Float[np.ndarray, " k"]
    end: Float[np.ndarray, " k"]
    point: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]
    normal: Float[np.ndarray, "k 3"]
    peak_force: Float[np.ndarray, " k"]
    peak_time: Float[np.ndarray, " k"]
    mean_force: Float[np.ndarray, " k"]
    slid: Float[np.ndarray, " k"]
    samples: Int[np.ndarray, " k"]
    ambiguous: Float[np.ndarray, " k"]
    identity: Int[np.ndarray, " k"]
    paths: Sequence[Float[np.ndarray, "_ 4"]]
    features: Mapping[str, Float[np.ndarray, " k"]] = field(default_factory=lambda: {})
    origins: Origins | None = None

    def __post_init__(self) -> None:
        features = MappingProxyType({name: frozen(values) for name, values in self.features.items()})
        paths = tuple(frozen(path) for path in self.paths)
        for name, value in vars(self).items():
            made = {"features": features, "paths": paths, "origins": self.origins}
            object.__setattr__(self, name, made[name] if name in made else frozen(value, dtype=value.dtype))

    @classmethod
    def joined(cls, parts: Sequence[Events]) -> Events:
        """Join `Events` of several sensors in the order in which the touches began.

        Raises:
            InputError: there are none.
        """
        if not parts:
            raise InputError("parts must be at least one Events, and is empty.")
        order: np.ndarray = np.argsort(np.concatenate([part.start for part in parts]), kind="stable")
        arrays = {
            name: np.concatenate([getattr(part, name) for part in parts])[order]
            for name in vars(parts[0])
            if name not in _OTHER
        }
        paths: list[np.ndarray] = [path for part in parts for path in part.paths]
        features = {
            name: np.concatenate([part.features.get(name, np.full(len(part), np.nan)) for part in parts])[order]
            for name in dict.fromkeys(name for part in parts for name in part.features)
        }
        known = [part.origins for part in parts if part.origins is not None]
        origins = Origins.joined(known)[order] if len(known) == len(parts) else None
        return cls(**arrays, paths=tuple(paths[int(k)] for k in order), features=features, origins=origins)

    def with_origin(self, origin: Origin) -> Events:
        """Return the same `Events` as those of one sensor of a robot."""
        kept = {name: getattr(self, name) for name in vars(self) if name != "origins"}
        return Events(**kept, origins=Origins.single(origin, len(self)))

    @property
    def sensor(self) -> np.ndarray:
        """Name of the robot's sensor that felt each touch, (k,) text; "" for a rig of one sensor."""
        return np.full(len(self), "") if self.origins is None else self.origins.sensor

    @property
    def link(self) -> np.ndarray:
        """Name of the robot's link that was touched, (k,) text; "" for a rig of one sensor."""
        return np.full(len(self), "") if self.origins is None else self.origins.link

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, which: int) -> Touch:
        """Return one `Touch`: numbers and vectors by the same names, and its duration [s].

        Raises:
            IndexError: there is no touch with this index.
        """
        columns = {name: value[which] for name, value in vars(self).items() if name not in _OTHER}
        columns |= {"sensor": str(self.sensor[which]), "link": str(self.link[which])}
        features = {name: value[which] for name, value in self.features.items()}
        duration = self.end[which] - self.start[which]
        return Touch(**columns, path=self.paths[which], features=features, duration=duration)

    @property
    def deviation(self) -> Float[np.ndarray, " k"]:
        """Largest standard deviation of each point in any direction, (k,) [m]; NaN if not known."""
        return largest_deviation(self.covariance)


@takes_arrays
def largest_deviation(covariance: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, " k"]:
    """Return the largest standard deviation in any direction, (k,) [m], of covariances (k, 3, 3) [m^2]; NaN of NaN.

    Raises:
        InputError: covariances of another shape.
    """
    known = np.isfinite(covariance).all(axis=(1, 2))
    largest = np.full(len(covariance), np.nan)
    largest[known] = np.sqrt(np.linalg.eigvalsh(covariance[known])[:, -1].clip(min=0))
    return largest
