"""Run the compiled loop over frames of taxels, and keep its state from frame to frame."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.contact import _track
from palpate.contact.taxel_settings import TaxelSettings
from palpate.sensors.taxels import _kernels, _rest
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.response import AXES, coupling_terms
from palpate.signals.smoothing import Forward
from palpate.surfaces._jit import FixedEntry

__all__: list[str] = []

_UNKNOWN, _CALIBRATED = 0.1, 0.02  # shares by which gains differ: of cells as they are made, and of calibrated ones
_STATE = np.delete(np.arange(_rest.NUMBERS), [_rest.NOISE, _rest.LIMIT, _rest.ROUGH, _rest.ROUGH + 1])
FEW, FELL = 10, 0.02  # frames far below rest that need no warning, and of those with a touch
_PLAIN = Intensity((Curve("polynomial", np.ones(1), np.zeros((1, 1)), largest=1.0),), unit="newtons")


class TaxelFrames:
    """A loop that turns frames of raw readings into rows of contacts, with its state.

    Args:
        body, intensity, settings: as of `TaxelEstimator`.
        forward: filter of the readings that needs no later ones.
        falling: readings fall under load; None: as the health says.
        filtered: whether there is any filter.

    Raises:
        InputError: the intensity model is of another number of cells.
    """

    def __init__(
        self,
        body: TaxelBody,
        intensity: Intensity | None,
        settings: TaxelSettings,
        forward: Forward | None,
        falling: bool | None,
        *,
        filtered: bool,
    ) -> None:
        self._health: Health | None = None
        self._settings, self._forward, self._filtered = settings, forward, filtered
        self._gains = (_UNKNOWN if intensity is None else _CALIBRATED) if settings.unequal is None else settings.unequal
        curves = intensity or _PLAIN
        self._known, self.falling = falling, bool(falling)
        which, count = curves.numbers(body.shape), len(body)
        self._limits = np.array([curve.saturation for curve in curves.curves])[which]
        self._ends = -np.inf if body.bits is None else 0.0, body.top
        self._curves = curves.tables()
        grid = np.zeros((0, 0, 6)) if body.grid is None else body.grid.copy()
        vectors = np.stack([body.positions, body.normals, body.tangents])
        known = np.zeros((0, 3, 3)) if body.covariance is None else body.covariance.copy()
        self._model = np.zeros(0) if body.response is None else body.response.numbers()
        self._place = (vectors, np.stack([body.areas, body.spacing]), grid, body.turn, known)
        self._model.flags.writeable = False
        self._follow = np.inf if body.response is None else body.response.drift
        tables = (body.neighbours.copy(), body.steps.copy(), body.between.copy())
        self._table = (*tables, max(body.columns, 1), _couplings(body))
        self._usable, self._name = body.usable, body.name
        self._clock = np.zeros(_rest.CLOCK)
        self._zeros = np.zeros((_rest.SLOTS, count)), np.zeros((_rest.SLOTS, 3)), np.full(2, np.nan)
        self._turn = 0.0 if body.bits is None else body.top + 1.0
        self._numbers = np.ones((_rest.NUMBERS, count))
        self._whole = np.zeros((_rest.WHOLE, count), dtype=np.int64)
        self._whole[_rest.CURVE] = which
        self._tracks = np.full((_track.TRACKS, _track.TRACK), -1.0), np.ones(1, dtype=np.int64)
        self._channels = body.axes * count
        self._unfiltered = np.zeros((1, self._channels)), np.zeros(1, dtype=np.int8), np.zeros(0)
        self.no_forces = np.zeros((0, count))
        self._loop = FixedEntry(_kernels.frames, _FIRST, self._fixed())

    def know(self, health: Health) -> None:
        """Use the baseline, noise and bad cells of a `Health` from the next `reset` on."""
        self._health = health
        self.falling = health.falling if self._known is None else self._known
        limits = np.where(np.isnan(self._limits), self._ends[not self.falling], self._limits)
        self._numbers[_rest.LIMIT] = limits
        self._whole[_rest.GOOD], self._numbers[_rest.NOISE] = self._usable & health.good, health.noise
        self._numbers[_rest.ROUGH : _rest.LOAD] = 0.0 if health.sideways is None else health.sideways[1]
        self._loop = FixedEntry(_kernels.frames, _FIRST, self._fixed())

    def notes(self, health: Health) -> tuple[str, ...]:
        """Return a sentence each on baselines that drifted from `health`, unusable frames and wrapped readings."""
        said = list[str]()
        drifted = np.abs(self.rest[0] - health.baseline) / health.noise
        if drifted.max() > self._settings.on:
            cell = self._name(int(np.argmax(drifted)))
            moved = f"{drifted.max():.0f} deviations of its noise, most at cell {cell}"
            said.append(f"readings at rest drifted by up to {moved}; they were followed where nothing touched")
        if self._clock[_rest.UNUSED]:
            said.append(
                f"{self._clock[_rest.UNUSED]:.0f} frames could not be used (they have another size, or no numbers)"
            )
        wrapped = [self._name(cell) for cell in np.flatnonzero(self._whole[_rest.WRAPPED]).tolist()]
        if wrapped:
            cells = f"{', '.join(wrapped[:5])}{', ...' if len(wrapped) > 5 else ''}"
            said.append(
                f"readings of {len(wrapped)} cells wrapped around from one end of the range to the other "
                f"({cells}): they were corrected where it was clear"
            )
        return tuple(said)

    def warnings(self) -> tuple[str, ...]:
        """Return a sentence each on zeros that jumped, touches that left a remainder, and readings that fell."""
        clock, said = self._clock, list[str]()
        if jumps := int(clock[_rest.JUMPS]):
            times = "once" if jumps == 1 else f"{jumps} times, the last time"
            said.append(
                f"the readings of all cells shifted together {times} at {clock[_rest.JUMPED]:.2f} s, as no touch does: "
                "their rest was taken anew, and frames until then are invalid"
            )
        if clock[_rest.REMAINS] > 0.0:
            where = f"most at cell {self._name(int(clock[_rest.WHERE]))}"
            said.append(
                f"up to {100 * clock[_rest.REMAINS]:.0f} % of a touch's peak remained after it ({where}) and was "
                "followed as rest: hysteresis, or slow recovery"
            )
        if clock[_rest.FALLEN] > max(FEW, FELL * clock[_rest.TOUCHES]):
            said.append(
                f"readings were far below their rest in {clock[_rest.FALLEN]:.0f} frames, and touches were found in "
                f"{clock[_rest.TOUCHES]:.0f}: if a load does that, write falling = {str(not self.falling).lower()} in "
                "[skin]; else the tare was touched"
            )
        return tuple(said)

    def reset(self) -> None:
        """Forget drift of the baseline, wrapped readings, filter, identities and the last frame."""
        health = self._health
        self._numbers[_STATE], self._whole[_rest.TURNS :] = 0.0, 0
        if health is not None:
            self._numbers[[_rest.BASELINE, _rest.HELD]] = health.baseline
            walks = self._settings.walk > 0.0
            self._numbers[_rest.SIDEWAYS : _rest.ROUGH] = 0.0 if health.sideways is None else health.sideways[0]
            self._numbers[_rest.VARIANCE] = health.noise**2 / max(1, health.frames) if walks else 0.0
        self._zeros[0][:], self._zeros[1][:], self._zeros[2][:] = 0.0, 0.0, np.nan
        self._whole[_rest.TOUCHED] = _rest.NEVER
        self._numbers[_rest.LAST] = np.nan
        self._clock[:] = 0.0
        self._clock[_rest.LATEST] = np.nan
        self._tracks[0][:], self._tracks[1][:] = -1.0, 1
        if self._forward is not None:
            self._forward.reset()

    @property
    def touches(self) -> int:
        """Return the number of touches so far."""
        return int(self._tracks[1][0]) - 1

    @property
    def misfit(self) -> float:
        """Return what `TaxelEstimator.misfit` does, a geometric mean over hard touches; NaN of few."""
        hard, misfits = self._clock[[_rest.HARD, _rest.MISFITS]].tolist()
        return float(np.exp(misfits / hard)) if hard >= FEW else np.nan

    @property
    def force(self) -> Float[np.ndarray, " k"]:
        """Return each cell's force (k,) [N] in the last frame, a view."""
        return self._numbers[_rest.FORCE]

    @property
    def rest(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Return each cell's baseline (k,) [counts] and its standard deviation, as `TaxelEstimator.rest`."""
        return self._numbers[_rest.BASELINE].copy(), np.sqrt(self._numbers[_rest.VARIANCE])

    @property
    def label(self) -> Int[np.ndarray, " k"]:
        """Return the index of each cell's area (k,), as `TaxelEstimator.label`."""
        return self._whole[_rest.LABEL]

    def run(
        self,
        time: Float[np.ndarray, " n"],
        raw: Float[np.ndarray, "n k"],
        sideways: Float[np.ndarray, "n _"],
        out: Float[np.ndarray, "r width"],
        counts: Int[np.ndarray, " n"],
        forces: Float[np.ndarray, "_ k"],
        filtered: tuple[np.ndarray, ...] | None = None,
    ) -> tuple[int, int]:
        """Find the contacts of as many frames as `out` has room for.

        Args:
            time: (n,) [s].
            raw: (n, k) readings.
            sideways: (n, 2 k) loads of taxels with three axes along their tangents; (n, 0) of one axis.
            out: rows of contacts; written.
            counts: (n,) number of rows of each frame; written.
            forces: (n, k) [N] of each cell, or `no_forces`; written.
            filtered: readings, statuses and shares of the noise from a filter of zero phase.

        Returns:
            The number of frames that were processed, and the number of their rows.
        """
        values = self._unfiltered if filtered is None else filtered
        known = (_constant(time), _constant(raw), _constant(sideways), self._model, *values)
        return self._loop(*known, out, counts, forces)

    def prepare(
        self, raw: Float[np.ndarray, "n k"], sideways: Float[np.ndarray, "n _"]
    ) -> tuple[Float[np.ndarray, "n _"], np.ndarray]:
        """Return unwrapped readings and tangential loads for a filter of zero phase, and each frame's status, int8."""
        values, status = np.empty((len(raw), self._channels)), np.empty(len(raw), dtype=np.int8)
        rest, health = np.zeros((3, raw.shape[1])), self._health  # not the followed one: frames of before may wait
        if health is not None:
            rest[0], rest[1:] = health.baseline, 0.0 if health.sideways is None else health.sideways[0]
        known = (self._table[0], self._turn, self._numbers, self._whole)
        _kernels.prepare(_constant(raw), _constant(sideways), _constant(rest), *known, values, status)
        return values, status

    def _fixed(self) -> tuple[object, ...]:
        """Return the arguments of the loop, from `_FIRST` on, that are the same objects for all frames."""
        set_, forward, drift = self._settings, self._forward, self._settings.drift
        drift = min(drift, self._follow) if drift < np.inf else drift
        resting = 1.0 / self._health.frames if self._filtered and self._health is not None else 0.0
        sign = -1.0 if self.falling else 1.0
        numbers = (set_.on, set_.off, set_.sure, set_.share, sign, self._gains, drift, self._turn, resting)
        settings = tuple(map(float, (*numbers, set_.reach, set_.speed, set_.patience, set_.walk)))
        smoothing = _NO_FILTER if forward is None else (*forward.parts, forward.shares)
        known = (self._place, self._table, self._curves, settings, smoothing)
        return (*known, self._clock, self._zeros, self._numbers, self._whole, *self._tracks)


def _couplings(body: TaxelBody) -> Float[np.ndarray, "_ m 3 3"]:
    """Return what is added to the loads of each taxel by those of its neighbours, (k, m, 3, 3); (0, m, 3, 3): nothing.

    Loads are along both tangents and into the body.
    """
    response, count = body.response, body.neighbours.shape[1]
    if response is None or not response.coupling.any():
        return np.zeros((0, count, AXES, AXES))
    terms = coupling_terms(body.steps * body.spacing[:, None, None] / response.pitch, body.neighbours)
    return np.einsum("kmabpq,pq->kmab", terms, response.coupling)


def _constant(values: np.ndarray) -> np.ndarray:
    """Return a read-only view, or an array that is read-only itself: the loops are compiled for such arrays."""
    if not values.flags.writeable:
        return values
    view = values.view()
    view.flags.writeable = False
    return view


_FIRST = 7  # argument of the loop that is the same object for all frames
_NO_FILTER = (
    np.zeros((0, 6)),
    np.zeros((0, 2)),
    np.zeros(0),
    0.0,
    np.zeros(2),
    np.zeros((1, 1)),
    np.zeros(0),
)
