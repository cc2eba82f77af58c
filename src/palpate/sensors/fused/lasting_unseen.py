"""Find a contact that lasts and that a skin does not feel."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import ROW, Status
from palpate.errors import InputError
from palpate.sensors.fused.locator import FusedFrames, FusedLocator
from palpate.spatial.arguments import takes_arrays

LOOKS = 0.1  # s between two searches for the place of an unseen contact, which take milliseconds
PERSISTS = 0.05  # s that a wrench must be unexplained before it is a contact: a touch that begins is felt first
_Place = tuple[Float[np.ndarray, " w"], Float[np.ndarray, "p 21"]]


class LastingUnseen:
    """A search for the likeliest place of a contact that the skin does not feel, after 50 ms of unexplained wrenches.

    Args:
        fused: locator with the surface.
        belief: column of the belief in the estimator's rows.
        width: of the estimator's rows.
    """

    def __init__(self, fused: FusedLocator, belief: int, width: int) -> None:
        self._locator, self._belief, self._width = fused, belief, width
        self.reset()

    def reset(self) -> None:
        """Forget the place, and since when the wrench is unexplained."""
        self._since = self._looked = np.nan  # [s] when the wrench began to be unexplained, and its place was looked for
        self._place: _Place | None = None

    def found(
        self,
        time: Float[np.ndarray, " n"],
        reporting: Bool[np.ndarray, " n"],
        usable: Bool[np.ndarray, " n"],
        fused: FusedFrames,
    ) -> dict[int, _Place]:
        """Return frame number -> unseen contact where it lasts: its row of the estimator (w,), and of `fused` (p, 21).

        The latter are of places that are equally likely.

        Args:
            time: (n,) [s].
            reporting: (n,) frames with a valid skin, and a wrench or a contact.
            usable: (n,) frames with a wrench.
            fused: of the frames.
        """
        found = dict[int, _Place]()
        for k, now in enumerate(time.tolist()):
            if not reporting[k]:
                self._since = np.nan
            elif usable[k] and self._persists(now, bool(fused.alarm[k])):
                if self._place is None or not now - self._looked < LOOKS:
                    self._place, self._looked = self._looked_for(fused.whitened[k], fused.factors[k]), now
                found[k] = self._place
        return found

    def _persists(self, time: float, alarm: bool) -> bool:
        if not alarm:
            self.reset()
        elif np.isnan(self._since):
            self._since = time
        return time - self._since >= PERSISTS

    def _looked_for(self, whitened: Float[np.ndarray, "6"], factor: Float[np.ndarray, "6 6"]) -> _Place:
        places = self._locator.unseen_by(whitened, factor)
        inside, several = places.cluster == 0, int(places.cluster.max()) + 1
        believed = places.belief[inside].sum()
        share, away = places.belief[inside] / believed, places.points[inside] - places.points[0]
        row = np.full(self._width, np.nan)
        row[ROW.point], row[ROW.normal] = places.points[0], places.normals[0]
        row[ROW.covariance] = np.einsum("k,ki,kj->ij", share, away, away).ravel()
        row[ROW.residual], row[ROW.candidates] = 0.0, several
        row[ROW.status] = Status.CONTACT if several == 1 else Status.AMBIGUOUS
        row[self._belief], row[-1] = believed, 0.0
        return row, self._locator.unseen_rows(places)


@takes_arrays
def fuse_with_unseen(
    locator: FusedLocator,
    contacts: Float[np.ndarray, "m 21"],
    counts: Int[np.ndarray, " n"],
    unseen: Float[np.ndarray, "n p 21"],
    wrenches: Float[np.ndarray, "n 6"],
    covariances: Float[np.ndarray, "n 6 6"],
) -> FusedFrames:
    """Return the forces of n frames with one more contact each, the last, at any of p places, as `FusedFrames`.

    Forces and shares are means of the mixture of all places; the 95 % ellipsoids of the covariances hold 95 % of it; p
    and alarm are those of the first place.

    Args:
        locator: of the seen contacts.
        contacts: (m, 21) rows of `FusedLocator.rows`, frame by frame.
        counts: (n,) number of contacts in each frame.
        unseen: (n, p, 21) rows of `FusedLocator.unseen_rows`.
        wrenches: (n, 6) [N, N m].
        covariances: (n, 6, 6) of the wrenches' noise.

    Raises:
        InputError: a count is negative, or the counts do not add up to m; or arrays of other shapes.
    """
    if counts.min(initial=0) < 0 or counts.sum() != len(contacts):
        raise InputError(f"counts must not be negative, and must add up to the {len(contacts)} contacts.")
    ends, ways = np.cumsum(counts), unseen.shape[1]
    after = np.concatenate([way * len(contacts) + ends for way in range(ways)])
    many = (np.concatenate([each] * ways) for each in (contacts, counts + 1, wrenches, covariances))
    every = np.insert(next(many), after, unseen.swapaxes(0, 1).reshape(-1, unseen.shape[2]), axis=0)
    found = locator.fuse_frames(every, *many)
    parts = (found.force, found.spread, found.share, found.bound)
    force, spread, share, bound = (each.reshape(ways, -1, *each.shape[1:]) for each in parts)
    mean, (rows, columns) = _mean(force), np.triu_indices(3)
    away = force - mean
    between = _mean(away[..., rows] * away[..., columns]) * ways / max(ways - 1, 1)
    mixed = _mean(spread) + between
    mixed *= _factor(mixed, spread, away)[:, None]
    first = {name: getattr(found, name)[: len(counts)] for name in ("p", "alarm", "whitened", "factors")}
    of_all = {"force": mean, "spread": mixed, "share": _mean(share), "bound": _mean(bound) > 0.5}
    return found._replace(**of_all, **first)


def _factor(
    mixed: Float[np.ndarray, "n 6"], spread: Float[np.ndarray, "p n 6"], away: Float[np.ndarray, "p n 3"]
) -> Float[np.ndarray, " n"]:
    """Return the factor of covariances with which their 95 % ellipsoids hold 95 % of a mixture.

    In it squared distances, which are 3 on average, vary by more than 6: they are taken for a multiple of chi-square
    with the degrees of freedom that have this variance, whose quantiles are those of Wilson and Hilferty.

    Args:
        mixed: (n, 6) covariances of the mixture.
        spread: (p, n, 6) covariances of its parts.
        away: (p, n, 3) of their means from that of the mixture.
    """
    square = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
    whole, parts, off = mixed[:, square], spread[:, :, square], away[..., None]
    least = 1e-12 * mixed[:, [0, 3, 5]].sum(axis=1) + 1e-300
    inverse = np.asarray(np.linalg.inv(whole + least[:, None, None] * np.eye(3)), dtype=np.float64)
    shape, lever = inverse @ parts, inverse @ off
    mean = (off.mT @ lever)[..., 0, 0] + np.trace(shape, axis1=2, axis2=3)
    variance = 2.0 * np.trace(shape @ shape, axis1=2, axis2=3) + 4.0 * (lever.mT @ parts @ lever)[..., 0, 0]
    varies = _mean(variance) + _mean((mean - _mean(mean)) ** 2)
    return _upper(varies) / _upper(np.array(6.0))


def _upper(variance: np.ndarray) -> np.ndarray:
    """Return the 95 % quantile of squared distances with a mean of 3 and a variance, over 3."""
    part = variance / 81.0
    return (1.0 - part + 1.6448536269514722 * np.sqrt(part)) ** 3


def _mean(ways: np.ndarray) -> np.ndarray:
    """Return the mean over the first axis, added in one order whatever the number of frames."""
    return np.cumsum(ways, axis=0, dtype=np.float64)[-1] / len(ways)
