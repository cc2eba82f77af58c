"""Contacts over time: the result of every estimator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from numpy.typing import ArrayLike

from palpate.calls import by_name, called_as
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.origins import Origin, Origins
from palpate.errors import InputError
from palpate.spatial._arrays import FLOAT, INT64, Value, shaped
from palpate.spatial.arguments import integer
from palpate.spatial.pose import Pose

if TYPE_CHECKING:
    import polars as pl

    from palpate.contact.events import Events
    from palpate.surfaces.surface import SurfaceLike

_COLUMNS = {"sample": INT64, "time": FLOAT, "identity": INT64}


@called_as(
    'palpate.estimate("log.csv", "rig.toml")',
    __getitem__="contacts[3] or contacts[contacts.answered]",
    in_frame="contacts.in_frame(palpate.Pose.from_matrix(T_base_surface)), or "
    'palpate.estimate("log.csv", "rig.toml", frame="base")',
    touches="contacts.touches(gap=0.05, shortest=0.02)",
    load='palpate.Contacts.load("contacts.mcap")',
    save='contacts.save("contacts.mcap")',
    plot='contacts.plot(palpate.Mesh.load("probe.stl", unit="mm"))',
    position="contacts.point",
    magnitude="np.linalg.norm(contacts.force, axis=-1)",
    events="contacts.touches()",
    show="contacts.plot(mesh)",
    to_csv='contacts.save("contacts.csv")',
)
@dataclass(frozen=True, eq=False)
class Contacts(Value):
    """Contacts in the order of the samples, at least one row per sample, whose status shows if there is none.

    Attributes:
        sample: (n,) row of the log, counted from 0.
        time: (n,) [s], as in the log.
        identity: (n,) number of the contact, constant while it lasts; 0 if there is only one at a time.
        estimate: batch of n estimates: point, force, covariance, status.
        features: name -> (n,) values that a sensor adds, SI (a sheet's row, column, area, ...); NaN without a contact.
        notes: remarks on the log and the sensor, one sentence each.
        origins: sensor and link of each row, where a robot has several; None: all rows are of one sensor.

    Raises:
        InputError: a column does not have one value of its type for each row.
    """

    sample: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    identity: Int[np.ndarray, " n"]
    estimate: ContactEstimate
    features: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()
    origins: Origins | None = None

    def __post_init__(self) -> None:
        for name, dtype in _COLUMNS.items():
            object.__setattr__(self, name, _read_only(getattr(self, name), name, dtype))
        features = {name: _read_only(values, name) for name, values in self.features.items()}
        object.__setattr__(self, "features", MappingProxyType(features))
        count = len(self.sample)
        estimates = {"estimate": self.estimate.status, "estimate's point": self.estimate.point[..., 0]}
        columns = {"time": self.time, "identity": self.identity, **estimates, **features}
        columns |= {} if self.origins is None else {"origins' index": self.origins.index}
        for name, values in columns.items():
            if values.shape != (count,):
                raise InputError(f"{name} must have one value for each of {count} rows, not shape {values.shape}.")

    @classmethod
    def single(cls, time: Float[np.ndarray, " n"], estimate: ContactEstimate, first: int = 0) -> Contacts:
        """Make `Contacts` with one row per sample from times (n,) [s] and a batch of n estimates.

        Samples are counted from `first`; all identities are 0.

        Raises:
            InputError: times that are not (n,) numbers, another number of estimates, or a `first` that is not whole.
        """
        time = shaped(time, (None,), "time")
        sample = integer(first, "first") + np.arange(len(time))
        return cls(sample, time, np.zeros(len(time), dtype=np.int64), estimate)

    @classmethod
    def of_rows(
        cls,
        sample: Int[np.ndarray, " n"],
        time: Float[np.ndarray, " n"],
        rows: Float[np.ndarray, "n width"],
        features: Sequence[str],
    ) -> Contacts:
        """Make `Contacts` from rows (n, width) of a `ContactEstimator`: `ROW`, features, and the identity, if any.

        Raises:
            InputError: rows that are too narrow, or another number of samples or times.
        """
        end = ROW.length + len(features)
        if type(rows) is not np.ndarray or rows.ndim != 2 or rows.shape[1] < end:
            raise InputError(
                f"rows must be an array of shape (n, {end}) or wider, not {getattr(rows, 'shape', rows)!r:.60}."
            )
        columns = {name: rows[:, ROW.length + k].copy() for k, name in enumerate(features)}
        identity = rows[:, end].astype(np.int64) if rows.shape[1] > end else np.zeros(len(rows), dtype=np.int64)
        return cls(sample, time, identity, ContactEstimate.from_rows(rows[:, : ROW.length]), columns)

    def rows(self) -> Float[np.ndarray, "n width"]:
        """Return rows (n, width), the inverse of `of_rows`: `ROW`, features, and always the identity."""
        estimate = self.estimate
        numbers = (estimate.torque[:, None], estimate.covariance.reshape(-1, 9), estimate.residual[:, None])
        whole = np.column_stack([estimate.candidates, estimate.status])
        features = [values[:, None] for values in self.features.values()]
        vectors = (estimate.point, estimate.normal, estimate.force)
        return np.hstack([*vectors, *numbers, whole, *features, self.identity[:, None]])

    @classmethod
    def joined(cls, parts: Sequence[Contacts]) -> Contacts:
        """Join `Contacts` in order; a feature that some do not have is NaN there.

        Raises:
            InputError: there are none.
        """
        if not parts:
            raise InputError("parts must be at least one Contacts, and is empty.")
        if len(parts) == 1:
            return parts[0]
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS}
        estimate = ContactEstimate.joined([part.estimate for part in parts])
        features = {
            name: np.concatenate([part.features.get(name, np.full(len(part), np.nan)) for part in parts])
            for name in dict.fromkeys(name for part in parts for name in part.features)
        }
        notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
        origins = None
        if any(part.origins is not None for part in parts):
            origins = Origins.joined([part._origins() for part in parts])
        return cls(**columns, estimate=estimate, features=features, notes=notes, origins=origins)

    def _origins(self) -> Origins:
        """Return the origins; of one sensor its rows have a blank one."""
        if self.origins is not None:
            return self.origins
        return Origins.single(Origin(), len(self)) if len(self) else Origins(np.zeros(0, dtype=np.int64), ())

    def __len__(self) -> int:
        return len(self.sample)

    def __bool__(self) -> bool:
        """Return whether any row is answered (CONTACT or AMBIGUOUS)."""
        return bool(self.estimate)

    def __iter__(self) -> Iterator[ContactEstimate]:
        return iter(self.estimate)

    @overload
    def __getitem__(self, which: int | np.integer[Any]) -> ContactEstimate: ...
    @overload
    def __getitem__(self, which: slice | np.ndarray) -> Contacts: ...
    def __getitem__(self, which: int | np.integer[Any] | slice | np.ndarray) -> ContactEstimate | Contacts:
        """Return the `ContactEstimate` of one row, or the `Contacts` that a slice, mask or array of indices picks.

        Raises:
            IndexError: there is no such row.
        """
        if isinstance(which, int | np.integer):
            return self.estimate[which]
        columns = {name: getattr(self, name)[which] for name in _COLUMNS}
        features = {name: values[which] for name, values in self.features.items()}
        origins = None if self.origins is None else self.origins[which]
        return replace(self, **columns, estimate=self.estimate[which], features=features, origins=origins)

    @property
    def point(self) -> Float[np.ndarray, "n 3"]:
        """Contact points, (n, 3) [m]; NaN if there is none."""
        return self.estimate.point

    @property
    def normal(self) -> Float[np.ndarray, "n 3"]:
        """Outward unit normals at the points, (n, 3); NaN if there is none."""
        return self.estimate.normal

    @property
    def force(self) -> Float[np.ndarray, "n 3"]:
        """Contact forces on the body, (n, 3) [N]."""
        return self.estimate.force

    @property
    def torque(self) -> Float[np.ndarray, " n"]:
        """Torques about the normals, (n,) [N m]."""
        return self.estimate.torque

    @property
    def covariance(self) -> Float[np.ndarray, "n 3 3"]:
        """Covariances of the points, (n, 3, 3) [m^2]; NaN without a noise model."""
        return self.estimate.covariance

    @property
    def residual(self) -> Float[np.ndarray, " n"]:
        """Distances to the nearest wrenches that a contact can make, (n,) [standard deviations]."""
        return self.estimate.residual

    @property
    def candidates(self) -> Int[np.ndarray, " n"]:
        """Numbers of points that explain each reading, (n,) int64."""
        return self.estimate.candidates

    @property
    def status(self) -> Int8[np.ndarray, " n"]:
        """`Status` codes, (n,) int8; == also takes a status's name in files."""
        return self.estimate.status

    @property
    def answered(self) -> Bool[np.ndarray, " n"]:
        """Mask of the rows whose status is CONTACT or AMBIGUOUS, (n,)."""
        return np.asarray(self.estimate.answered)

    @property
    def located(self) -> Bool[np.ndarray, " n"]:
        """Mask of the rows that have a point and a normal, answered or not, (n,)."""
        return np.asarray(np.isfinite(np.hstack([self.estimate.point, self.estimate.normal])).all(axis=1))

    @property
    def sensor(self) -> np.ndarray:
        """Name of the robot's sensor that each row is from, (n,) text; "" for a rig of one sensor."""
        return self._origins().sensor

    @property
    def link(self) -> np.ndarray:
        """Name of the robot's link that each row is on, (n,) text; "" for a rig of one sensor."""
        return self._origins().link

    def of(self, sensor: str) -> Contacts:
        """Return the `Contacts` of one sensor of a robot.

        Raises:
            InputError: there is no such sensor.
        """
        return self[self._origins().rows_of(sensor)]

    def strongest(self) -> Int[np.ndarray, " s"]:
        """Return the row with the largest force of each sample, its first row if none has a force, (s,) int."""
        force, sample = np.linalg.norm(self.estimate.force, axis=1), self._samples()
        order = np.lexsort((-np.where(np.isfinite(force), force, -1.0), sample))
        _, first = np.unique(sample[order], return_index=True)
        return order[first]

    def _samples(self) -> Int[np.ndarray, " n"]:
        """Return a number for each row that is unique to its sample, also if several sensors count theirs."""
        return self.sample if self.origins is None else self.sample * len(self.origins.among) + self.origins.index

    def with_estimate(self, estimate: ContactEstimate) -> Contacts:
        """Return `Contacts` with the same rows and another batch of n estimates.

        Raises:
            InputError: another number of estimates.
        """
        return replace(self, estimate=estimate)

    def noted(self, notes: Sequence[str]) -> Contacts:
        """Return `Contacts` with the same rows and other notes."""
        return replace(self, notes=tuple(notes))

    def in_frame(self, pose: Pose) -> Contacts:
        """Return `Contacts` with the same rows in another frame, as `ContactEstimate.in_frame`.

        The base frame needs the sensor's poses in the log: `palpate.estimate(log, rig, frame="base")`.

        Args:
            pose: T_target_source, one, or one per row.

        Raises:
            InputError: the argument is no pose, or another number of poses.
        """
        return self.with_estimate(self.estimate.in_frame(pose))

    def touches(self, *, gap: float = 0.05, shortest: float = 0.02, speed: float = 0.5) -> Events:
        """Return the touches as `Events`: start, end, point, peak force and more of each.

        Args:
            gap: [s] between answered samples of one identity that ends a touch, if a sample is missing between.
            shortest: [s]; a touch that lasts less is left out.
            speed: [m/s]; a point that moves faster, and by more than 5 standard deviations, is of another touch.
        """
        return by_name("palpate.contact.touch_finder.find_touches")(self, gap=gap, shortest=shortest, speed=speed)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Contacts:
        """Return the `Contacts` in a file that `save` or `palpate estimate` wrote.

        Raises:
            InputError: the file cannot be read or holds no contacts, or a row in it is invalid.
        """
        return by_name("palpate.files.contacts.read_contacts")(path)

    def save(self, path: str | PathLike[str]) -> None:
        """Write every row to a .csv, .parquet or .mcap file.

        Raises:
            InputError: another suffix, or a path that cannot be written to.
        """
        by_name("palpate.files.contacts.write_contacts")(path, self)

    def to_polars(self) -> pl.DataFrame:
        """Return a polars `DataFrame` with the columns of files of contacts; null for NaN.

        Raises:
            InputError: the process was forked from one in which polars had started its threads.
        """
        return by_name("palpate.contact.table.to_frame")(self)

    def to_pandas(self) -> Any:
        """Return a pandas `DataFrame` with the columns of `to_polars`.

        Raises:
            InputError: pandas is not installed; or as for `to_polars`.
        """
        try:
            frame = by_name("pandas.DataFrame")
        except ImportError as problem:
            hint = "Run pip install pandas, or write contacts.to_polars()."
            raise InputError("to_pandas needs pandas, which does not load.", hint=hint) from problem
        return frame(self.to_polars().to_dict(as_series=False))

    def plot(self, surface: SurfaceLike | None = None) -> Any:
        """Return a `Drawing` of the numbered touches on the body, which a notebook shows and a pointer turns.

        Args:
            surface: the body, in the frame of these contacts; None: the touches alone.

        Raises:
            InputError: no surface, or a mesh file that cannot be read or has no unit.
            GeometryError: the mesh has no usable facet, or an implicit surface cannot be drawn.
        """
        return by_name("palpate.viewer.notebook.drawing_of_touches")(self, surface)

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the rows of each status, and the touches."""
        return by_name("palpate.viewer.notebook.table_of")(self)

    def __repr__(self) -> str:
        if not len(self):
            return "Contacts(no rows)"
        counts = np.bincount(self.status, minlength=len(Status))
        seen = ", ".join(f"{count:,} {Status(code)}" for code, count in enumerate(counts) if count)
        samples = len(np.unique(self._samples()))
        several = "" if samples == len(self) else f" of {samples:,} samples"
        known = self.time[np.isfinite(self.time)]
        span = f", {known.min():.3f} to {known.max():.3f} s" if len(known) else ""
        return f"Contacts({len(self):,} rows{several}{span}: {seen})"


def _read_only(values: ArrayLike, name: str, dtype: np.dtype[Any] = FLOAT) -> np.ndarray:
    """Return the array if it is read-only and owns its data, else a read-only copy."""
    if type(values) is not np.ndarray or values.dtype != dtype:
        values = shaped(values, (...,), name, dtype)
    if values.flags.writeable or values.base is not None:
        values = values.copy()
        values.flags.writeable = False
    return values
