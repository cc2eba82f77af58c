"""Define the estimate of a contact: point, force, covariance and status."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from palpate.calls import by_name, called_as
from palpate.errors import InputError
from palpate.spatial._arrays import FLOAT, INT8, INT64, Value, shaped
from palpate.spatial.pose import Pose

if TYPE_CHECKING:
    from palpate.surfaces.surface import SurfaceLike

__all__ = ["CHI2_95", "ROW", "ContactEstimate", "Status"]

CHI2_95 = 5.991464547107979  # 95 % point of chi-square with 2 degrees of freedom, -2 log 0.05


class Status(IntEnum):
    """Outcome of a sample; stored as int8. *Answered* means CONTACT or AMBIGUOUS."""

    CONTACT = 0
    AMBIGUOUS = 1  # answered, but another candidate lies outside the 95 % ellipse of the one given
    NO_CONTACT = 2  # below the lower threshold
    TOO_LIGHT = 3  # something is there, but below the upper threshold: not located
    OFF_SURFACE = 4  # no point of the surface can make this wrench; the nearest point is given
    IMPLAUSIBLE = 5  # located, but the friction or torsion bound is exceeded
    SATURATED = 6  # a channel is at its range
    INVALID = 7  # NaN or infinite
    NO_POSE = 8  # the orientation that compensation needs is missing

    @classmethod
    def _missing_(cls, value: object) -> Status:
        """Return the status for a word, with underscores or spaces; raise an InputError if there is none."""
        for each in cls:
            if isinstance(value, str) and value.replace(" ", "_") == each.label:
                return each
        hint = f"Write palpate.Status.CONTACT, or another of {', '.join(cls.__members__)}."
        given = repr(value)[:40] if isinstance(value, str | int | float | None) else f"a {type(value).__name__}"
        raise InputError(f"{given} is not a status.", hint=hint)

    @property
    def label(self) -> str:
        """Name of the status in files, such as "off_surface"."""
        return self.name.lower()

    @property
    def words(self) -> str:
        """Name of the status for a person: `label` with spaces for underscores."""
        return self.label.replace("_", " ")

    def __str__(self) -> str:
        return self.label

    def __format__(self, spec: str) -> str:
        return format(self.label, spec)

    def __eq__(self, other: object) -> bool:
        return int(self) == (int(Status(other)) if isinstance(other, str) else other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = int.__hash__

    def __bool__(self) -> bool:
        raise InputError(
            "a Status is neither true nor false.",
            hint=f"Write `status == palpate.Status.{self.name}`, or test the contact itself: `if contact`.",
        )


class Statuses(np.ndarray):
    """Codes of `Status`, int8; == and != also take the words used in files."""

    def __eq__(self, other: object) -> Any:
        return np.asarray(self) == (Status(other) if isinstance(other, str) else other)

    def __ne__(self, other: object) -> Any:
        return np.asarray(self) != (Status(other) if isinstance(other, str) else other)


class _Row:
    """Layout of one estimate as a row of float64."""

    point = slice(0, 3)
    normal = slice(3, 6)
    force = slice(6, 9)
    torque = 9
    covariance = slice(10, 19)  # row-major 3 x 3
    residual = 19
    candidates = 20
    status = 21
    length = 22


ROW = _Row
_ROW = (ROW.length,)


@called_as(
    "palpate.locate([0, 0, -5, 0.02, 0, 0], mesh)",
    in_frame="contact.in_frame(palpate.Pose.from_matrix(T_base_surface))",
    plot='contact.plot(palpate.Mesh.load("probe.stl", unit="mm"))',
    position="contact.point",
    magnitude="np.linalg.norm(contact.force, axis=-1)",
    show="contact.plot(mesh)",
    touches="palpate.Contacts.single(times, contact).touches()",
)
@dataclass(frozen=True, eq=False, repr=False)
class ContactEstimate(Value):
    """Contact points, forces and their uncertainty, batched by leading axes, in the surface's frame.

    Attributes:
        point: (*batch, 3) [m] contact point; NaN if there is none.
        normal: (*batch, 3) outward unit normal at the point.
        force: (*batch, 3) [N] on the body.
        torque: (*batch) [N m] about the normal, (M - p x F) . n.
        covariance: (*batch, 3, 3) [m^2] of the point, of rank 2 in the tangent plane; NaN without a noise model.
        residual: (*batch) distance, in standard deviations of the wrench, to the nearest wrench that a contact within
            the friction and torsion bounds can make; 0 inside them.
        candidates: (*batch) number of points within the bounds that explain the wrench.
        status: (*batch) `Status` as int8; for a single estimate (no batch) a `Status`.

    Raises:
        InputError: values that are not real numbers, or a status of another type or shape than the torque's.
    """

    point: Float[np.ndarray, "*batch 3"]
    normal: Float[np.ndarray, "*batch 3"]
    force: Float[np.ndarray, "*batch 3"]
    torque: Float[np.ndarray, "*batch"]
    covariance: Float[np.ndarray, "*batch 3 3"]
    residual: Float[np.ndarray, "*batch"]
    candidates: Int[np.ndarray, "*batch"]
    status: Any  # int8 array or Status: no type checker knows the batch

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            dtype = INT64 if name == "candidates" else FLOAT
            if name != "status" and (type(value) is not np.ndarray or value.dtype != dtype):
                object.__setattr__(self, name, shaped(value, (...,), name, dtype))
        if self.batch and not hasattr(self.status, "dtype"):
            object.__setattr__(self, "status", shaped(self.status, (...,), "status", INT8))
        if not self.batch:
            object.__setattr__(self, "status", Status(int(self.status)))
        elif self.status.shape != self.batch or self.status.dtype != np.int8:
            raise InputError(f"status must be int8 of shape {self.batch}, not {self.status.dtype} {self.status.shape}.")
        else:
            self.status.flags.writeable = False  # the array itself: a view does not lock it
            object.__setattr__(self, "status", self.status.view(Statuses))
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the leading axes; () for a single estimate."""
        return self.torque.shape

    @classmethod
    def from_rows(cls, rows: Float[np.ndarray, "*batch 22"]) -> ContactEstimate:
        """Make a `ContactEstimate` from rows (*batch, 22) laid out as `ROW`.

        Raises:
            InputError: rows of another shape.
        """
        if type(rows) is not np.ndarray or rows.shape[-1:] != _ROW or rows.dtype != FLOAT:
            rows = shaped(rows, (..., ROW.length), "rows")
        if rows.ndim == 1 and rows.item(ROW.candidates) >= 0 and rows.item(ROW.status) >= 0:  # none of them NaN
            return cls._from_row(rows.copy())
        return cls(
            point=rows[..., ROW.point].copy(),
            normal=rows[..., ROW.normal].copy(),
            force=rows[..., ROW.force].copy(),
            torque=np.array(rows[..., ROW.torque]),
            covariance=rows[..., ROW.covariance].reshape(*rows.shape[:-1], 3, 3).copy(),
            residual=np.array(rows[..., ROW.residual]),
            candidates=np.array(rows[..., ROW.candidates], dtype=np.int64),
            status=np.array(rows[..., ROW.status], dtype=np.int8),
        )

    @classmethod
    def _from_row(cls, row: Float[np.ndarray, "22"]) -> ContactEstimate:
        """Make a single estimate of views into `row`, which it takes over: eight copies take 10 us."""
        candidates = np.array(int(row.item(ROW.candidates)), dtype=np.int64)
        row.setflags(write=False)  # and so are its parts
        candidates.setflags(write=False)
        made = object.__new__(cls)
        vars(made).update(
            point=row[ROW.point],
            normal=row[ROW.normal],
            force=row[ROW.force],
            torque=row[ROW.torque, ...],
            covariance=row[ROW.covariance].reshape(3, 3),
            residual=row[ROW.residual, ...],
            candidates=candidates,
            status=Status(int(row.item(ROW.status))),
        )
        return made

    @classmethod
    def joined(cls, parts: Sequence[ContactEstimate]) -> ContactEstimate:
        """Join batches along the first axis, in order.

        Raises:
            InputError: there are none.
            ValueError: a part is a single estimate, without leading axes.
        """
        if not parts:
            raise InputError("parts must be at least one ContactEstimate, and is empty.")
        columns = [part._columns() for part in parts]
        return cls(**{name: np.concatenate([each[name] for each in columns]) for name in columns[0]})

    def reshaped(self, batch: tuple[int, ...]) -> ContactEstimate:
        """Return the same estimates with other leading axes, of the same total size.

        Raises:
            ValueError: another total size.
        """
        axes = len(self.batch)
        return ContactEstimate(
            **{name: value.reshape((*batch, *value.shape[axes:])) for name, value in self._columns().items()}
        )

    def __getitem__(self, which: int | np.integer[Any] | slice | np.ndarray) -> ContactEstimate:
        """Return the estimates that an index, slice, mask or array of indices picks along the first axis.

        Raises:
            TypeError: this is a single estimate.
            IndexError: there is no such estimate.
        """
        if not self.batch:
            raise TypeError("a single estimate cannot be indexed")
        return ContactEstimate(**{name: np.array(value[which]) for name, value in vars(self).items()})

    def __iter__(self) -> Iterator[ContactEstimate]:
        return (self[i] for i in range(len(self.status)))

    def __bool__(self) -> bool:
        """Return whether any estimate is answered (CONTACT or AMBIGUOUS)."""
        return bool(np.any(self.answered))

    def in_frame(self, pose: Pose) -> ContactEstimate:
        """Return the same estimates in another frame; the uncertainty of `pose` is not added.

        Args:
            pose: T_target_source, one or a batch.

        Raises:
            InputError: the argument is no pose, or a batch that does not fit.
        """
        turn = pose.rotation
        return replace(
            self,
            point=pose.apply(self.point),
            normal=pose.rotate(self.normal),
            force=pose.rotate(self.force),
            covariance=turn @ self.covariance @ np.swapaxes(turn, -1, -2),
        )

    def plot(self, surface: SurfaceLike | None = None) -> Any:
        """Return a `Drawing` of points, forces and 95 % ellipses on the body; a notebook shows it, a pointer turns it.

        Args:
            surface: the body, in the frame of these estimates; None: the estimates alone.

        Raises:
            InputError: `surface` is no surface, or a mesh file that cannot be read or has no unit.
            GeometryError: the mesh has no usable facet, or an implicit surface cannot be drawn.
        """
        return by_name("palpate.viewer.notebook.drawing_of_estimates")(self, surface)

    def __repr__(self) -> str:
        if not self.batch:
            point, force = (", ".join(f"{k:.3f}" for k in v) for v in (1e3 * self.point, self.force))
            return f"ContactEstimate({self.status}, point ({point}) mm, force ({force}) N)"
        counts = np.bincount(self.status.ravel(), minlength=len(Status))
        seen = ", ".join(f"{count} {Status(code)}" for code, count in enumerate(counts) if count)
        return f"ContactEstimate({self.batch}: {seen or 'empty'})"

    @property
    def answered(self) -> Any:
        """True if the status is CONTACT or AMBIGUOUS; a mask (*batch) for a batch."""
        return (np.asarray(self.status) if self.batch else self.status) <= Status.AMBIGUOUS

    def _columns(self) -> dict[str, np.ndarray]:
        return {**vars(self), "status": np.asarray(self.status, dtype=np.int8)}
