"""Locate contacts on a surface from wrenches."""

from __future__ import annotations

import copy
from collections.abc import Callable
from threading import Lock
from typing import Any, cast
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact import _settings as at
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.indentation import Indentation
from palpate.errors import InputError
from palpate.spatial._arrays import FLOAT, INT8, Value, require_batch, require_out, shaped
from palpate.spatial.arguments import frozen_value, number, takes_arrays
from palpate.spatial.shown import vector
from palpate.spatial.uncertain import noise_covariance
from palpate.spatial.wrench import Wrench
from palpate.surfaces.surface import Surface, SurfaceLike, as_surface

WORSE = 0.05  # of a touch's samples
_END = 32  # answered samples at the end of a touch, as many as a branch remembers
_MANY, _BLOCK = 4_000, 100_000  # wrenches for which it is worth while to sort them, and how many at a time
_LARGE = 2**19  # bytes of a surface that a core does not keep at hand
_WRENCH, _ROW = (6,), (ROW.length,)
_ANY = np.full(1, -1, np.int8)  # of one sample no status is known beforehand
ON, OFF = 5.5, 3.0  # standard deviations of the force; noise alone exceeds the first once in a million samples
METHODS = ("soft_finger", "wrench_axis")


@frozen_value
class Candidates(Value):
    """All contacts that one wrench can have on a surface, best first.

    Attributes:
        point: (k, 3) [m].
        normal: (k, 3) outward.
        torque: (k,) [N m] about the normal.
        friction: (k,) tan of the angle between -force and normal.
        plausible: (k,) whether it is within the friction and torsion bounds.
    """

    point: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    torque: Float[np.ndarray, " k"]
    friction: Float[np.ndarray, " k"]
    plausible: Bool[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False

    def __repr__(self) -> str:
        places = ", ".join(vector(1e3 * point, 1) for point in self.point[:3])
        more = f" and {len(self.point) - 3} more" if len(self.point) > 3 else ""
        plausible = f"{np.count_nonzero(self.plausible)} of {len(self.point)} plausible"
        return f"Candidates({plausible}{': ' if places else ''}{places}{more}{' mm' if places else ''})"


@called_as(
    'palpate.Locator("probe.stl", unit="mm", noise=(0.02, 0.001))',
    run="locator.run([[0, 0, -5, 0.02, 0, 0]])",
    candidates="locator.candidates([0, 0, -5, 0.02, 0, 0])",
    locate="locator.run([[0, 0, -5, 0.02, 0, 0]])",
)
class Locator:
    """Locator of contacts on one surface, whose tree and loops are prepared at construction.

    Args:
        surface: a `Surface`, such as a `Mesh`; a mesh of trimesh; or the path of a mesh file.
        method: "soft_finger" (the `probe` paper's model: force and a torque about the normal) or "wrench_axis" (Bicchi
            1993: where the line of action meets the surface).
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].
        noise: standard deviations of force and torque, or of each of the six numbers, or a 6 x 6 covariance, force
            first [N, N m]; None: covariances are NaN unless given with the wrenches.
        on, off: force [N] at which a contact begins, and below which it ends. None for both: 5.5 and 3 standard
            deviations of the force by its covariance in that sample; without noise only zero force is no contact.
        indentation: depth at which the force acts below a soft layer on the surface; None: the surface is rigid.
        accuracy: [m] 3-D standard deviation above which the answer is TOO_LIGHT; None: no limit.
        unit: of a mesh file's numbers: m, cm, mm, um or in.

    Raises:
        InputError: an unknown method; friction or accuracy that is not positive, or negative torsion; thresholds that
            are not 0 <= off <= on; an invalid noise; no surface, or a mesh file that cannot be read or has no unit.
        GeometryError: a mesh without usable facets.
    """

    @takes_arrays
    def __init__(
        self,
        surface: SurfaceLike,
        method: str = "soft_finger",
        friction: float = 1.0,
        torsion: float = 5e-3,
        noise: ArrayLike | None = None,
        on: float | None = None,
        off: float | None = None,
        indentation: Indentation | None = None,
        accuracy: float | None = None,
        unit: str | None = None,
    ) -> None:
        from palpate.contact import _kernel  # compiled: loaded when first needed

        surface = as_surface(surface, unit)
        if method not in METHODS:
            raise InputError(f"unknown method {method!r}.", hint=f"Use one of {', '.join(METHODS)}.")
        if not (friction > 0 and torsion >= 0):
            raise InputError(f"friction ({friction}) must be > 0 and torsion ({torsion}) >= 0.")
        if accuracy is not None and not accuracy > 0:
            raise InputError(f"accuracy ({accuracy}) must be > 0 m.")
        self.surface, self.method, self.friction, self.torsion = surface, method, float(friction), float(torsion)
        self.noise = None if noise is None else noise_covariance(noise)
        self.indentation, self.accuracy, self._given = indentation, accuracy, (on, off)
        self.on, self.off = _thresholds(self.noise, on, off)
        prepared = surface.prepared()
        self._arguments = prepared.arguments
        soft, noisy = float(method == "soft_finger"), float(self.noise is not None)
        gate = (-ON, -OFF) if on is None and off is None else (self.on, self.off)
        self._settings = np.array(
            [*prepared.centre, prepared.scale, soft, self.friction, self.torsion, *gate, noisy]
            + ([0.0, 1.0] if indentation is None else [indentation.depth, indentation.exponent])
            + [accuracy or 0.0, soft * prepared.edged]
        )
        self._noisy = self._settings.copy()  # with covariances beside the wrenches
        self._noisy[at.NOISY] = 1.0
        self._noises = np.zeros((1, 6, 6)) if self.noise is None else _writable(self.noise[None])
        self._state, self._wrench = _state(None), np.zeros((1, 6))
        self._first_free: Callable[..., int] = _kernel.first_free
        self._many = self._bound()
        wrench = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        self(wrench, self.empty())
        self.candidates(wrench)
        self.run(np.zeros((1, 6)))
        self.reset()

    def __copy__(self) -> Locator:
        return copy.deepcopy(self)  # a shallow one would share its memory of the last contact

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in ("_arguments", "_many", "_first_free")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        from palpate.contact import _kernel

        vars(self).update(state)
        self._arguments = self.surface.prepared().arguments
        self._many, self._first_free = self._bound(), _kernel.first_free

    def _bound(self) -> Callable[..., Any]:
        """Return the compiled loop for these settings on this surface; callers check the arrays of each call."""
        from palpate.contact import _kernel

        own = *self._arguments, self._settings, self._state
        return _kernel.estimate_many.compiled_for(self._wrench, self._noises, _ANY, *own, True, self.empty(1))

    @staticmethod
    def empty(*batch: int) -> Float[np.ndarray, "*batch 22"]:
        """Return rows (*batch, 22) of NaN to write into, laid out as `ROW`; see `ContactEstimate.from_rows`."""
        return np.full((*batch, ROW.length), np.nan)

    def with_noise(self, noise: Float[np.ndarray, "6 6"]) -> Locator:
        """Return a new `Locator` with this covariance (6, 6) of a wrench [N, N m], force first, and the other settings.

        The thresholds `on` and `off` follow from the noise, unless they were given when this locator was made.

        Raises:
            InputError: the noise is no covariance.
        """
        bounds = self.friction, self.torsion
        return Locator(self.surface, self.method, *bounds, noise, *self._given, self.indentation, self.accuracy)

    @takes_arrays
    def least_forces(self, covariances: Float[np.ndarray, "n 6 6"] | None) -> Float[np.ndarray, " k"]:
        """Return the force [N], (n,) or (1,), at which a contact begins along the least certain axis.

        Args:
            covariances: (n, 6, 6) of wrenches [N, N m], force first; None: the noise.

        Raises:
            InputError: covariances have another shape.
        """
        if covariances is None or self._given != (None, None):
            return np.array([self.on])
        return np.maximum(self.on, ON * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)[:, :3].max(axis=1)))

    def compiled(self, known: bool) -> tuple[Any, ...]:
        """Return the arguments with which a compiled loop locates the wrenches that it makes, as a tuple.

        They are the covariance of a wrench, (1, 6, 6), zeros if unknown; the arguments of the prepared surface; the
        settings (s,); and the Locator's memory (t,), which the loop changes.

        Args:
            known: the loop has a covariance for each wrench: the first array is then empty, (0, 6, 6).
        """
        noises = np.empty((0, 6, 6)) if known else self._noises
        return noises, *self._arguments, self._noisy if known else self._settings, self._state

    def reset(self, previous: ArrayLike | None = None) -> None:
        """Forget the last contact and the hysteresis, or set the last contact to a point (3,) [m].

        Raises:
            InputError: the point is not three numbers.
        """
        self._state[:] = _state(previous)

    def __call__(self, wrench: ArrayLike, out: np.ndarray | None = None) -> None:
        """Locate one wrench into `out`, and keep hysteresis and last contact; float64 arrays are not copied.

        Args:
            wrench: (6,) [N, N m] in the surface's frame, force first.
            out: (22,), a row of `empty()`.

        Raises:
            InputError: other shapes, or an `out` that cannot be written into, or none.
        """
        if out is None:
            hint = "Write locator.run(wrench), or out = locator.empty() and locator(wrench, out)."
            raise InputError("out is missing.", hint=hint)
        if type(out) is not np.ndarray or out.shape != _ROW or out.dtype != FLOAT or not out.flags.carray:
            require_out(out, _ROW)
        if type(wrench) is not np.ndarray or wrench.shape != _WRENCH or wrench.dtype != FLOAT:
            wrench = shaped(wrench, _WRENCH, "wrench")
        self._wrench[:] = wrench  # the one array type that was compiled for
        rows = out.reshape(1, ROW.length)
        self._many(self._wrench, self._noises, _ANY, *self._arguments, self._settings, self._state, True, rows)

    def run(
        self,
        wrenches: ArrayLike,
        covariances: ArrayLike | None = None,
        statuses: ArrayLike | None = None,
        sequential: bool = True,
        previous: ArrayLike | None = None,
    ) -> ContactEstimate:
        """Return the `ContactEstimate` (*batch) of wrenches; keep hysteresis and last contact, also from call to call.

        Args:
            wrenches: (*batch, 6) [N, N m] in the surface's frame, force first, in the order of time.
            covariances: (*batch, 6, 6), or (6, 6) for all, instead of the Locator's noise.
            statuses: (*batch) a `Status` known beforehand, or -1 for a sample to locate.
            sequential: False locates each sample separately and does not change the Locator's memory.
            previous: (3,) [m] the last contact, for every sample; only if not sequential.

        Raises:
            InputError: other shapes, numbers that are not real, or `previous` with `sequential`.
        """
        if sequential and previous is not None:
            raise InputError(
                "previous is only possible with sequential=False: otherwise the Locator remembers the last contact."
            )
        wrenches = shaped(wrenches, (..., 6), "wrenches")
        batch = wrenches.shape[:-1]
        if not batch and covariances is None and statuses is None:
            return self._single(wrenches, self._state if sequential else _state(previous))
        noises, settings = self._noises, self._settings
        if covariances is not None:
            each = shaped(covariances, (..., 6, 6), "covariances")
            if each.ndim > 2:
                require_batch(each, batch, "covariances")
                each = np.broadcast_to(each, (*batch, 6, 6))
            noises, settings = _writable(each.reshape(-1, 6, 6)), self._noisy
        known = np.full(batch, -1, np.int8) if statuses is None else shaped(statuses, batch, "statuses", INT8)
        rows = self.empty(*batch)
        state = self._state if sequential else _state(previous)
        flat = wrenches.reshape(-1, 6), noises, known.reshape(-1)
        out = rows.reshape(-1, ROW.length)
        if not sequential and len(out) >= _MANY and self._arguments[1].nbytes > _LARGE:
            self._sorted(*flat, settings, state, out)
        else:
            self._many(*flat, *self._arguments, settings, state, sequential, out)
        return ContactEstimate.from_rows(rows)

    def locate_one(
        self, wrench: ArrayLike, covariance: ArrayLike | None = None, previous: ArrayLike | None = None
    ) -> ContactEstimate:
        """Return the `ContactEstimate` of one wrench, as `run` with `sequential=False`, but faster.

        The Locator's memory is neither used nor changed, so that threads may share the Locator.

        Args:
            wrench: (6,) [N, N m] in the surface's frame, force first; NaN gives the status `INVALID`.
            covariance: (6, 6) of the wrench, instead of the Locator's noise.
            previous: (3,) [m] the last contact point, or None.

        Raises:
            InputError: other shapes, or numbers that are not real.
        """
        known = None if covariance is None else shaped(covariance, (6, 6), "covariance")
        return self._single(shaped(wrench, _WRENCH, "wrench"), _state(previous), known)

    def _sorted(
        self,
        wrenches: Float[np.ndarray, "n 6"],
        noises: Float[np.ndarray, "k 6 6"],
        known: Int8[np.ndarray, " n"],
        settings: Float[np.ndarray, " s"],
        state: Float[np.ndarray, " t"],
        out: Float[np.ndarray, "n 22"],
    ) -> None:
        """Locate each wrench separately, sorted by place in space: the same results sooner."""
        centre, scale = settings[at.CENTRE : at.CENTRE + 3], float(settings[at.SCALE])
        for first in range(0, len(out), _BLOCK):
            block = slice(first, first + _BLOCK)
            order = first + in_space(wrenches[block], centre, scale)
            each = noises if len(noises) == 1 else noises[order]
            found = self.empty(len(order))
            self._many(wrenches[order], each, known[order], *self._arguments, settings, state.copy(), False, found)
            out[order] = found

    def _single(
        self,
        wrench: Float[np.ndarray, "6"],
        state: Float[np.ndarray, " s"],
        covariance: Float[np.ndarray, "6 6"] | None = None,
    ) -> ContactEstimate:
        """Locate one wrench, in a fifth of the time that `run` takes for a batch."""
        noises, settings = self._noises, self._settings
        if covariance is not None:
            noises, settings = covariance[None], self._noisy
        rows = np.empty((1, ROW.length))
        self._many(wrench[None], noises, _ANY, *self._arguments, settings, state, True, rows)
        return ContactEstimate.from_rows(rows[0])

    @property
    def memory(self) -> Float[np.ndarray, " s"]:
        """State after the last sample, (s,), not a copy: hysteresis, last contact, branches of the touch."""
        return self._state

    @staticmethod
    def no_contact() -> Float[np.ndarray, " s"]:
        """Return a new memory (s,) for `run_into`, as it is after any sample without contact."""
        return _state(None)

    def first_free(self, wrenches: ArrayLike, covariances: ArrayLike | None, statuses: ArrayLike) -> int:
        """Return the index of the first sample without contact, whatever came before; -1 if there is none.

        A sequence can be cut after it.

        Args:
            wrenches: (n, 6) [N, N m] in the surface's frame, force first.
            covariances: (n, 6, 6), or None for the Locator's noise.
            statuses: (n,) int8, a `Status` known beforehand or -1.

        Raises:
            InputError: other shapes.
        """
        wrenches, noises, statuses, settings = self._sequence(wrenches, covariances, statuses)
        return self._first_free(wrenches, noises, statuses, settings)

    def run_into(
        self,
        wrenches: ArrayLike,
        covariances: ArrayLike | None,
        statuses: ArrayLike,
        out: np.ndarray,
        memory: Float[np.ndarray, " s"] | None = None,
    ) -> None:
        """Locate wrenches in sequence, like `run`, into rows of `empty()`; contiguous writable arrays are not copied.

        Args:
            wrenches: (n, 6) [N, N m] in the surface's frame, force first.
            covariances: (n, 6, 6), or None for the Locator's noise.
            statuses: (n,) int8, a `Status` known beforehand or -1.
            out: (n, 22).
            memory: from `no_contact` or an earlier call, used and changed instead of the Locator's.

        Raises:
            InputError: other shapes, or an `out` or `memory` that cannot be written into.
        """
        require_out(out, (None, ROW.length))
        wrenches, noises, statuses, settings = self._sequence(wrenches, covariances, statuses, len(out))
        state = self._state if memory is None else memory
        if memory is not None:
            require_out(memory, self._state.shape, "memory")
        self._many(wrenches, noises, statuses, *self._arguments, settings, state, True, out)

    def _sequence(
        self, wrenches: ArrayLike, covariances: ArrayLike | None, statuses: ArrayLike, count: int | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return wrenches (n, 6), noises, statuses (n,) and settings as the compiled loops take them."""
        wrenches = shaped(wrenches, (count, 6), "wrenches")
        count = len(wrenches)
        statuses = shaped(statuses, (count,), "statuses", INT8)
        if covariances is None:
            return wrenches, self._noises, statuses, self._settings
        return wrenches, shaped(covariances, (count, 6, 6), "covariances"), statuses, self._noisy

    def follow_back(
        self,
        wrenches: ArrayLike,
        covariances: ArrayLike | None,
        statuses: ArrayLike,
        rows: Float[np.ndarray, "n 22"],
    ) -> None:
        """Locate the rows of one touch again, from its end to its start, near the contact that was believed at the end.

        The end is the sample with the largest force among the last 32 answered ones, of those of half that force with
        CONTACT if there are any, and of these with residual 0, whose wrench has a contact there; rows after it stay. If
        most of the 32 are AMBIGUOUS, the rows remain so, and all are located near the place that the force meets first
        at the end. All rows stay if more samples would become implausible. The Locator's memory is kept.

        Args:
            wrenches: (n, 6) of the touch, in the surface's frame.
            covariances: (n, 6, 6), or None for the Locator's noise; without either, nothing is done.
            statuses: (n,) int8, a `Status` known beforehand or -1.
            rows: (n, 22) as `run_into` wrote them; changed.

        Raises:
            InputError: other shapes, or `rows` that cannot be written into.
        """
        if self.noise is None and covariances is None:
            return  # without noise no branch was ever told from another
        require_out(rows, (None, ROW.length), "rows")
        wrenches, noises, statuses, settings = self._sequence(wrenches, covariances, statuses, len(rows))
        answered = np.flatnonzero(rows[:, ROW.status] <= Status.AMBIGUOUS)
        if not len(answered):
            return
        late = answered[-_END:]
        sure: Bool[np.ndarray, " k"] = rows[late, ROW.status] == Status.CONTACT
        located, pressed = rows[late, ROW.residual] == 0.0, np.linalg.norm(rows[late, ROW.force], axis=1)
        strong = pressed >= 0.5 * pressed.max()  # a touch ends with its weakest samples, which noise may put elsewhere
        count = int(late[np.lexsort((pressed, located, sure, strong))[-1]]) + 1
        open_end = np.count_nonzero(sure) < 0.5 * len(sure)
        state = _state(None if open_end else rows[count - 1, ROW.point])
        state[at.TOUCHING] = state[at.FOLLOW] = 1.0
        begin = max(0, count - 1 - _END)
        last = len(rows) - 1 if open_end else count - 1
        order = np.r_[count - 1 : begin : -1, begin:last, last:-1:-1]
        if covariances is not None:
            noises = noises[order]
        back = self.empty(len(order))
        self._many(wrenches[order], noises, statuses[order], *self._arguments, settings, state, True, back)
        back = back[-last - 1 :]
        before = rows[:, ROW.status].copy()
        worse = back[:, ROW.status] == Status.IMPLAUSIBLE
        if np.count_nonzero(worse) > np.count_nonzero(before[: last + 1] == Status.IMPLAUSIBLE) + WORSE * len(back):
            return
        rows[: last + 1] = back[::-1]
        if open_end:
            several = (rows[:, ROW.candidates] > 1) | (before == Status.AMBIGUOUS)
            rows[several & (rows[:, ROW.status] == Status.CONTACT), ROW.status] = Status.AMBIGUOUS

    def candidates(self, wrench: ArrayLike) -> Candidates:
        """Return all contacts that one wrench (6,) [N, N m], force first, can have, as `Candidates`.

        Those within the bounds come first, then in order along the force; none if it has no force, or NaN.

        Raises:
            InputError: the wrench is not six numbers.
        """
        from palpate.surfaces import _bvh, _kernels

        wrench = shaped(wrench, _WRENCH, "wrench")
        centre, scale = self._settings[at.CENTRE : at.CENTRE + 3], self._settings[at.SCALE]
        force, moment = wrench[:3], wrench[3:]
        found = np.zeros((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
        if not np.all(np.abs(wrench) <= at.LARGEST) or not np.any(force):
            found = found[:0]
        else:
            unit = np.concatenate([force, (moment - np.cross(centre, force)) / scale])
            found = found[: _kernels.search(unit, self._settings[at.SOFT], np.inf, *self._arguments, found)]
        point, normal = found[:, 8:11] * scale + centre, found[:, 11:14]
        torque = np.einsum("nk,nk->n", moment - np.cross(point, force), normal)
        plausible = (found[:, 4] <= self.friction) & (np.abs(torque) <= self.torsion * np.abs(normal @ force))
        order = np.lexsort((found[:, 4], found[:, 5], ~plausible))
        return Candidates(point[order], normal[order], torque[order], found[order, 4], plausible[order])

    def __repr__(self) -> str:
        bounds = f"friction {self.friction:g}, torsion {1e3 * self.torsion:g} mm"
        noise = "no noise" if self.noise is None else f"noise {vector(np.sqrt(np.diag(self.noise)), 4)}"
        return f"Locator({self.surface!r}, {self.method}, {bounds}, {noise})"


def _writable(array: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return contiguous writable float64: for a read-only array compiled code would be compiled again."""
    return np.require(array, np.float64, ["C", "W"])


@takes_arrays
def in_space(wrenches: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"], scale: float) -> Int[np.ndarray, " n"]:
    """Return indices (n,) that put wrenches next to each other if their axes enter a ball around the body close by.

    So the parts of a large tree that they need stay in the processor's cache. Keys are Morton's order of a grid.

    Args:
        wrenches: (n, 6) force first, in the surface's frame; rows of NaN or without a force are placed anywhere.
        centre: (3,) of the ball [m].
        scale: its radius [m].

    Raises:
        InputError: other shapes.
    """
    from palpate.contact import _neighbours  # compiled: loaded when first needed

    keys = np.empty(len(wrenches), dtype=np.uint16)
    _neighbours.keys(wrenches, centre, scale, keys)
    return np.argsort(keys, kind="stable")


def _state(previous: ArrayLike | None) -> Float[np.ndarray, " s"]:
    """Return the state before any contact, or with the last one at a point (3,) [m]."""
    state = np.zeros(at.STATE)
    if previous is not None:
        state[at.HAS_PREVIOUS], state[at.PREVIOUS : at.PREVIOUS + 3] = 1.0, shaped(previous, (3,), "previous")
    return state


def _thresholds(noise: Float[np.ndarray, "6 6"] | None, on: float | None, off: float | None) -> tuple[float, float]:
    """Return the forces [N] at which a contact begins and ends; those not given follow from the noise."""
    sigma = 0.0 if noise is None else float(np.sqrt(np.diag(noise)[:3].max()))
    if on is None:
        on = max(ON * sigma, off or 0.0)
    off = min(OFF / ON * on, OFF * sigma) if off is None else off
    if not 0 <= off <= on:
        raise InputError(f"contact thresholds must satisfy 0 <= off <= on, not on = {on} N and off = {off} N.")
    return float(on), float(off)


_KEPT = 8  # Locators of a surface that `locate` keeps, one for each method and bounds that it was called with
_Bounds = tuple[str, float, float]
_kept: WeakKeyDictionary[Surface, dict[_Bounds, Locator]] = WeakKeyDictionary()
_keeping = Lock()


def _prepared(surface: Surface, bounds: _Bounds) -> Locator:
    """Return the Locator of `locate`, kept as long as its surface lives; it has no reference to it, or both would stay.

    Threads may share it, as it is never used in sequence.
    """
    of_surface = _kept.get(surface)
    locator = None if of_surface is None else of_surface.get(bounds)
    if locator is None:
        locator = Locator(surface, *bounds, on=0.0, off=0.0)
        del locator.surface
        with _keeping:
            of_surface = _kept.setdefault(surface, {})
            while len(of_surface) >= _KEPT:
                del of_surface[next(iter(of_surface))]
            of_surface[bounds] = locator
    return locator


def _six_numbers(wrench: object) -> Float[np.ndarray, "6"] | None:
    """Return a copy of six floats in a list, tuple or array; None of anything else."""
    if type(wrench) is not list and type(wrench) is not tuple and type(wrench) is not np.ndarray:
        return None
    try:
        array = np.array(cast("ArrayLike", wrench))
    except ValueError:  # lists of different lengths
        return None
    return array if array.dtype == FLOAT and array.shape == _WRENCH else None


@called_as('palpate.locate([0, 0, -5, 0.02, 0, 0], "probe.stl", unit="mm")')
def locate(
    wrench: Wrench | ArrayLike,
    surface: SurfaceLike,
    method: str = "soft_finger",
    friction: float = 1.0,
    torsion: float = 5e-3,
    noise: ArrayLike | None = None,
    previous: ContactEstimate | ArrayLike | None = None,
    unit: str | None = None,
) -> ContactEstimate:
    """Return the contact of a wrench on a surface, both in the same frame; a batch is located one by one.

    In a loop, a `Locator` is faster: here a mesh of trimesh or a file is prepared at each call.

    Args:
        wrench: a `Wrench`, or six-vectors (*batch, 6), force first [N, N m].
        surface: a `Surface`, such as a `Mesh`; a mesh of trimesh; or the path of a mesh file.
        method: "soft_finger" or "wrench_axis", as of a `Locator`.
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].
        noise: standard deviations of force and torque, or of each of the six numbers, or a 6 x 6 covariance, force
            first; None: the wrench's covariance.
        previous: the last contact, an estimate or a point [m]; it decides between candidates.
        unit: of a mesh file's numbers: m, cm, mm, um or in.

    Returns:
        a `ContactEstimate` with the batch's leading axes. Without any noise its covariance is NaN.

    Raises:
        InputError: an unknown method; friction that is not positive, or negative torsion; wrenches, noise or previous
            of another shape; no surface, or a mesh file that cannot be read or has no unit.
        GeometryError: the mesh has no usable facet.
    """
    surface = as_surface(surface, unit)
    if type(friction) is not float or type(torsion) is not float:
        friction, torsion = number(friction, "friction"), number(torsion, "torsion")
    vectors, covariance = _six_numbers(wrench), None
    if vectors is None:
        whole = wrench if isinstance(wrench, Wrench) else Wrench.from_vector(shaped(wrench, (..., 6), "wrench"))
        vectors, covariance = whole.vector(), whole.covariance
    point = previous.point if isinstance(previous, ContactEstimate) else previous
    last = None if point is None else shaped(point, (3,), "previous")
    last = None if last is None or not np.isfinite(last).all() else last
    locator = _prepared(surface, (method, friction, torsion))
    if noise is not None:
        covariance = noise_covariance(noise)
    if vectors.ndim == 1:
        return locator.locate_one(vectors, covariance, last)
    return locator.run(vectors, covariance, sequential=False, previous=last)
