"""From wrenches to contacts on a surface."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int8
from numpy.typing import ArrayLike

from palpate.contact._settings import HAS_PREVIOUS, NOISY, PREVIOUS, SOFT, STATE
from palpate.contact.estimate import ROW, ContactEstimate
from palpate.errors import InputError
from palpate.sensors.load_cells import Indentation
from palpate.spatial.uncertain import noise_covariance
from palpate.spatial.wrench import Wrench
from palpate.surfaces.surface import Surface

__all__ = ["METHODS", "Candidates", "Locator", "locate"]

_ROW_SHAPE = (ROW.length,)
METHODS = ("soft_finger", "wrench_axis")  # of a Locator; `locate` knows "iterative" too


@dataclass(frozen=True)
class Candidates:
    """Every contact that one wrench can have on a surface, best first.

    Attributes:
        point: (k, 3) [m]; normal: (k, 3); torque: (k,) [N m] about the normal.
        friction: (k,) tan of the angle between -force and normal.
        plausible: (k,) within the friction and torsion bounds.
    """

    point: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    torque: Float[np.ndarray, " k"]
    friction: Float[np.ndarray, " k"]
    plausible: np.ndarray


class Locator:
    """Prepared location on one surface: the tree is built and the loops are compiled here, never in the loop.

    Args:
        surface: a `Surface`, such as a `Mesh`.
        method: "soft_finger" (the `probe` paper's model: force and a torque about the normal) or "wrench_axis" (Bicchi
            1993: where the line of action meets the surface).
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].
        noise: six standard deviations or a 6 x 6 covariance, force first [N, N m]; None: covariances are NaN unless
            given with the wrenches.
        on, off: force [N] from which there is a contact, and below which there is none any more. None: 10 and 5 times
            the largest standard deviation of force, or 0 without noise (then only zero force is no contact).
        indentation: of a soft layer on the surface: how deep below it the force acts; None: rigid.
        accuracy: [m] 3-D standard deviation above which the answer is TOO_LIGHT; None: none.

    Raises:
        InputError: an unknown method, or bounds that are not positive, or on < off.
    """

    def __init__(
        self,
        surface: Surface,
        method: str = "soft_finger",
        friction: float = 1.0,
        torsion: float = 5e-3,
        noise: ArrayLike | None = None,
        on: float | None = None,
        off: float | None = None,
        indentation: Indentation | None = None,
        accuracy: float | None = None,
    ) -> None:
        from palpate.contact import _kernel  # compiled: loaded when first needed

        if method not in METHODS:
            slow = " iterative is for `palpate.locate` alone." if method == "iterative" else ""
            raise InputError(f"unknown method {method!r}.", mend=f"Use one of {', '.join(METHODS)}.{slow}")
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
        self._settings = np.array(
            [*prepared.centre, prepared.scale, soft, self.friction, self.torsion, self.on, self.off, noisy]
            + ([0.0, 1.0] if indentation is None else [indentation.depth, indentation.exponent])
            + [accuracy or 0.0]
        )
        self._noisy = self._settings.copy()  # with covariances beside the wrenches
        self._noisy[NOISY] = 1.0
        self._noise = np.zeros((6, 6)) if self.noise is None else _writable(self.noise)
        self._state, self._wrench = _state(None), np.zeros(6)
        self._one: Callable[..., Any] = _kernel.estimate
        self._many: Callable[..., Any] = _kernel.estimate_many
        self(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), self.empty())
        self.run(np.zeros((1, 6)))
        self.reset()

    @staticmethod
    def empty(*batch: int) -> Float[np.ndarray, "*batch 22"]:
        """Rows to write into; `ContactEstimate.from_rows` names what is in them, `ROW` where."""
        return np.full((*batch, ROW.length), np.nan)

    def with_noise(self, noise: Float[np.ndarray, "6 6"]) -> Locator:
        """The same on the same surface, with another noise, and thresholds from it where they were not given."""
        return Locator(
            self.surface,
            self.method,
            self.friction,
            self.torsion,
            noise,
            *self._given,
            indentation=self.indentation,
            accuracy=self.accuracy,
        )

    def reset(self, previous: ArrayLike | None = None) -> None:
        """Forget the last contact and the hysteresis, or set the last contact to a point [m]."""
        self._state[:] = _state(previous)

    def __call__(self, wrench: Float[np.ndarray, "6"], out: Float[np.ndarray, "22"]) -> None:
        """Locate one wrench (6,), force first, in the surface's frame, into `out`; carries hysteresis and last contact.

        Allocates nothing. `out` is a row of `empty()`; the wrench may be any six numbers (a frozen value, a column).
        """
        if out.shape != _ROW_SHAPE or out.dtype != np.float64:
            raise ValueError(f"out must be a row of Locator.empty(), float64 {_ROW_SHAPE}, not {out.dtype} {out.shape}")
        self._wrench[:] = wrench  # the one array type that was compiled for
        self._one(self._wrench, self._noise, *self._arguments, self._settings, self._state, out)

    def run(
        self,
        wrenches: Float[np.ndarray, "n 6"],
        covariances: Float[np.ndarray, "*#n 6 6"] | None = None,
        statuses: Int8[np.ndarray, " n"] | None = None,
        sequential: bool = True,
        previous: ArrayLike | None = None,
    ) -> ContactEstimate:
        """Locate a time series; carries hysteresis and last contact from sample to sample and from call to call.

        Args:
            wrenches: (n, 6) in the surface's frame, force first.
            covariances: (n, 6, 6) or (6, 6), instead of the Locator's noise.
            statuses: (n,) a status known beforehand, or -1 for a sample to locate.
            sequential: False takes each sample on its own and leaves the Locator's memory alone.
            previous: (3,) [m] the last contact of every sample then.
        """
        wrenches = _writable(wrenches)
        noise, settings = self._noise, self._settings
        if covariances is not None:
            noise, settings = np.asarray(covariances, dtype=np.float64), self._noisy
        noises = _writable(noise if noise.ndim == 3 else noise[None])
        if len(noises) not in (1, len(wrenches)):
            raise ValueError(f"{len(noises)} covariances for {len(wrenches)} wrenches")
        forced = np.full(len(wrenches), -1, np.int8) if statuses is None else np.require(statuses, np.int8, ["C", "W"])
        rows = self.empty(len(wrenches))
        state = self._state if sequential else _state(previous)
        self._many(wrenches, noises, forced, *self._arguments, settings, state, sequential, rows)
        return ContactEstimate.from_rows(rows)

    def run_into(
        self,
        rows: Float[np.ndarray, "n 22"],
        wrenches: Float[np.ndarray, "n 6"],
        covariances: Float[np.ndarray, "n 6 6"] | None,
        statuses: Int8[np.ndarray, " n"],
    ) -> None:
        """`run` in sequence into rows of `empty()`, from contiguous, writable arrays: what a control loop calls."""
        noises = self._noise[None] if covariances is None else covariances
        settings = self._settings if covariances is None else self._noisy
        self._many(wrenches, noises, statuses, *self._arguments, settings, self._state, True, rows)

    def candidates(self, wrench: Float[np.ndarray, "6"]) -> Candidates:
        """Every contact that one wrench (6,) can have, those within the bounds first, then as met along the force."""
        from palpate.surfaces import _kernels

        centre, scale = self._settings[:3], self._settings[3]
        force, moment = np.asarray(wrench[:3], dtype=np.float64), np.asarray(wrench[3:], dtype=np.float64)
        found = np.zeros((_kernels.CAPACITY + 1, _kernels.CANDIDATE))
        if not np.all(np.isfinite(wrench)) or not np.any(force):
            found = found[:0]
        else:
            unit = np.concatenate([force, (moment - np.cross(centre, force)) / scale])
            found = found[: _kernels.search(unit, self._settings[SOFT], np.inf, *self._arguments, found)]
        point, normal = found[:, 8:11] * scale + centre, found[:, 11:14]
        torque = np.einsum("nk,nk->n", moment - np.cross(point, force), normal)
        plausible = (found[:, 4] <= self.friction) & (np.abs(torque) <= self.torsion * np.abs(normal @ force))
        order = np.lexsort((found[:, 4], found[:, 5], ~plausible))
        return Candidates(point[order], normal[order], torque[order], found[order, 4], plausible[order])


def _writable(array: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Contiguous float64, copied if read-only: to the compiler a read-only array is another type, compiled again."""
    return np.require(array, np.float64, ["C", "W"])


def _state(previous: ArrayLike | None) -> Float[np.ndarray, "5"]:
    """No contact so far, or the last one at a point [m]."""
    state = np.zeros(STATE)
    if previous is not None:
        state[HAS_PREVIOUS], state[PREVIOUS:] = 1.0, np.asarray(previous, dtype=np.float64)
    return state


def _thresholds(noise: Float[np.ndarray, "6 6"] | None, on: float | None, off: float | None) -> tuple[float, float]:
    """Forces at which a contact begins and ends, from the noise where they are not given."""
    sigma = 0.0 if noise is None else float(np.sqrt(np.diag(noise)[:3].max()))
    if on is None:
        on = 10.0 * sigma if off is None else max(10.0 * sigma, off)
    off = min(0.5 * on, 5.0 * sigma) if off is None else off
    if not 0 <= off <= on:
        raise InputError(f"contact thresholds must be 0 <= off <= on; got on = {on}, off = {off} N.")
    return float(on), float(off)


def _iterated(
    wrenches: Float[np.ndarray, "n 6"], surface: Surface, start: ArrayLike | None, friction: float, torsion: float
) -> ContactEstimate:
    """The baseline, one wrench after the other."""
    from palpate.contact.iterative import Equation, locate_iteratively
    from palpate.surfaces.mesh import Mesh

    if not isinstance(surface, Equation | Mesh):
        raise InputError("the method iterative needs an equation of the surface, or a mesh to fit one to.")
    found = [locate_iteratively(w, surface, start, friction=friction, torsion=torsion).estimate() for w in wrenches]
    return ContactEstimate.joined([ContactEstimate(**{k: v[None] for k, v in vars(one).items()}) for one in found])


@functools.lru_cache(maxsize=8)
def _prepared(surface: Surface, method: str, friction: float, torsion: float) -> Locator:
    """The Locator behind `locate`; surfaces are compared by identity."""
    return Locator(surface, method, friction, torsion, on=0.0, off=0.0)


def locate(
    wrench: Wrench,
    surface: Surface,
    method: str = "soft_finger",
    friction: float = 1.0,
    torsion: float = 5e-3,
    noise: ArrayLike | None = None,
    previous: ContactEstimate | ArrayLike | None = None,
) -> ContactEstimate:
    """Where a wrench touches a surface; both in the same frame, each wrench of a batch on its own.

    Args:
        wrench: batched by leading axes.
        surface: a `Surface`, such as a `Mesh`.
        method: "soft_finger", "wrench_axis", or "iterative" (`locate_iteratively`, the older way: slow, without a
            covariance; on a mesh it fits a paraboloid to the touched region, or refuses).
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].
        noise: six standard deviations or a 6 x 6 covariance, force first; None takes the wrench's own covariance.
        previous: the last contact, an estimate or a point [m]: it decides between candidates.

    Returns:
        a `ContactEstimate` with the batch's leading axes. Without any noise its covariance is NaN.
    """
    if not isinstance(wrench, Wrench):  # pyright: ignore[reportUnnecessaryIsInstance] - six bare numbers are a likely slip
        raise TypeError("locate takes a palpate.Wrench; six numbers become one by Wrench.from_vector")
    point = previous.point if isinstance(previous, ContactEstimate) else previous
    last = None if point is None or not np.all(np.isfinite(point)) else point
    vectors = wrench.vector()
    batch = vectors.shape[:-1]
    if method == "iterative":
        return _iterated(vectors.reshape(-1, 6), surface, last, friction, torsion).reshaped(batch)
    locator = _prepared(surface, method, friction, torsion)
    covariance = wrench.covariance if noise is None else noise_covariance(noise)
    if covariance is not None and covariance.ndim > 2:
        covariance = np.broadcast_to(covariance, (*batch, 6, 6)).reshape(-1, 6, 6)
    return locator.run(vectors.reshape(-1, 6), covariance, sequential=False, previous=last).reshaped(batch)
