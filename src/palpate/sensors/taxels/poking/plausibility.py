"""Weight pokes by plausibility: reject two pokers at once and light pushes, weigh down wrenches with torsion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.spatial.arguments import takes_arrays

LIGHT = 5.0  # deviations of noise that a poke's force is at least
PITCH = 3.5  # usual pitches of a wrench that are not doubted
APART = 3.0  # usual distances of neighbours between two areas
SHARE = 0.2  # of all answers that a second area has at least
TOGETHER = 0.2  # of the answers of the rarer of two taxels that both give, where they are neighbours
SEEN = 4  # pokes that a taxel answers to before it is known what answers with it
MOST = 6_000  # taxels of whose pairs a table is kept
LEVER = 0.1  # m, by which errors of force are those of torque
FEWEST = 8  # pokes from which a usual pitch is known


@takes_arrays
def believed(
    pokes: Pokes, *, start: TaxelPlaces | None = None, saturated: Bool[np.ndarray, " n"] | None = None
) -> Pokes:
    """Return the `Pokes` with weights, 0 for rejected and less than 1 for doubtful ones, notes on them, and more noise.

    The scatter of touches, as by friction, is added to the noise.

    Args:
        pokes: as they were measured.
        start: expected places of the taxels, which separate two pokers; None: taxels that answer together elsewhere do.
        saturated: (n,) pokes in which a taxel reads its largest value, for the notes; None: not known.

    Raises:
        InputError: the start is of another number of taxels, or no poke remains.
    """
    if start is not None and len(start) != pokes.taxels:
        raise InputError(
            f"the places to start from have {len(start)} taxels, but the log has {pokes.taxels}.",
            where="start",
            hint="Check that start is the CAD file of this skin.",
        )
    force = np.linalg.norm(pokes.wrench[:, :3], axis=1)
    light = force < LIGHT * np.sqrt(np.trace(pokes.noise[:3, :3]))
    silent = np.diff(pokes.starts) == 0
    two = _never_together(pokes) if start is None else _far_apart(pokes, start)
    weight = np.where(light | silent | two, 0.0, pokes.weight)
    pitched, doubted = _pitch_weights(pokes, weight > 0)
    counts = (
        (light & ~silent, "rejected: their force is within its noise"),
        (silent, "rejected: no taxel answers throughout"),
        (two & ~light, "rejected: two separate areas answer, as under two pokers at once"),
        (
            doubted,
            "given less weight: their torque along the force, about the sensor's origin, is too large for one push",
        ),
        (np.zeros(0, dtype=bool) if saturated is None else saturated, "hold a taxel at the end of its range"),
    )
    said = [f"{np.count_nonzero(which)} of {len(pokes)} pokes {what}" for which, what in counts if which.any()]
    weight = weight * pitched
    if not (weight > 0).any():
        raise InputError(f"no poke remains: {'; '.join(said)}.", where="pokes")
    return replace(pokes, weight=weight, notes=(*pokes.notes, *said), noise=pokes.noise + _of_touch(pokes, weight > 0))


def _pitch_weights(
    pokes: Pokes, used: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return weights by pitch, |F . M| / |F|^2 about the sensor's origin, and which pokes are doubted.

    The weight is min(1, (limit / pitch)^2), the limit PITCH times the usual pitch of these pokes.
    """
    force, torque = pokes.wrench[:, :3], pokes.wrench[:, 3:]
    square = np.maximum((force**2).sum(axis=1), 1e-18)
    pitch = np.abs((force * torque).sum(axis=1)) / square
    slope = np.concatenate([torque, force], axis=1) / square[:, None]
    noise = np.sqrt(np.einsum("ni,ij,nj->n", slope, pokes.noise, slope))
    if np.count_nonzero(used) < FEWEST:
        return np.ones(len(pokes)), np.zeros(len(pokes), dtype=bool)
    usual = 1.4826 * float(np.quantile(pitch[used], 0.5))
    ratio = pitch / (PITCH * np.hypot(usual, noise) + 1e-12)
    doubted = used & (ratio > 1.0)
    return np.where(doubted, 1.0 / np.maximum(ratio, 1.0) ** 2, 1.0), doubted


def _of_touch(pokes: Pokes, used: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "6 6"]:
    """Return the scatter of touches in addition to noise, as by friction, (6, 6), from their torque along the force.

    For t = F . M / |F|, var t = (variance by noise) + s^2 (1 + |M|^2 / (|F| L)^2), for errors of torque s and of force
    s / L; the median of t^2 gives s. Where pokes are many, forms of second degree in the wrench over |F|, as of
    cross-talk, are subtracted first, but for F_i M_i.
    """
    force, torque = pokes.wrench[used, :3], pokes.wrench[used, 3:]
    if len(force) < FEWEST:
        return np.zeros((6, 6))
    size = np.linalg.norm(force, axis=1, keepdims=True)
    slope = np.concatenate([torque, force], axis=1) / size
    told = np.einsum("ni,ij,nj->n", slope, pokes.noise, slope)
    along = (force * torque).sum(axis=1) / size[:, 0]
    wrench = np.concatenate([force, torque / LEVER], axis=1)
    one, other = np.nonzero(np.triu(~np.eye(6, k=3, dtype=bool)))
    if len(force) >= 3 * len(one):
        forms: Float[np.ndarray, "n f"] = wrench[:, one] * wrench[:, other] / size
        left: Float[np.ndarray, " n"] = along - forms @ (np.linalg.pinv(forms, rcond=1e-9) @ along)
        along = left * np.sqrt(len(force) / (len(force) - len(one)))
    more = (along**2 / 0.455 - told) / (1.0 + (torque**2).sum(axis=1) / (size[:, 0] * LEVER) ** 2)
    square = max(float(np.quantile(more, 0.5)), 0.0)
    return square * np.diag([LEVER**-2] * 3 + [1.0] * 3)


def _far_apart(pokes: Pokes, start: TaxelPlaces) -> Bool[np.ndarray, " n"]:
    """Return the pokes whose answers are in two areas by their distances."""
    from scipy.spatial import cKDTree  # here: scipy is slow to import

    points = start.positions
    known = points[start.there]
    if len(known) < 2:
        return np.zeros(len(pokes), dtype=bool)
    distances: Any = cKDTree(known).query(known, k=2)[0]
    usual = float(np.median(distances[:, 1]))
    first = pokes.taxel[pokes.starts[pokes.poke]]
    wide = np.linalg.norm(points[pokes.taxel] - points[first], axis=1) > APART * usual

    def beside(taxels: Int[np.ndarray, " a"]) -> Bool[np.ndarray, "a a"]:
        away = np.linalg.norm(points[taxels][:, None] - points[taxels], axis=2)
        return ~(away > APART * usual)  # what is not known lies anywhere

    return _split(pokes, beside, np.unique(pokes.poke[wide]))  # all beside one of them are no two areas


def _never_together(pokes: Pokes) -> Bool[np.ndarray, " n"]:
    """Return the pokes with answers in two areas whose taxels never answer together elsewhere."""
    if pokes.taxels > MOST:
        return np.zeros(len(pokes), dtype=bool)
    from scipy.sparse import csr_matrix  # here: scipy is slow to import

    ones = np.ones(len(pokes.taxel), dtype=np.int32)
    table: Any = csr_matrix((ones, pokes.taxel, pokes.starts), (len(pokes), pokes.taxels))
    counts = np.asarray((table.T @ table).toarray(), dtype=np.int32)
    single = np.diag(counts).copy()

    def beside(taxels: Int[np.ndarray, " a"]) -> Bool[np.ndarray, "a a"]:
        rarer = np.minimum(single[taxels][:, None], single)
        others = counts[taxels].copy()
        others[:, taxels] -= 1  # without this poke
        near = (others > TOGETHER * rarer).astype(np.float32)
        near[np.arange(len(taxels)), taxels] = 1.0
        found = near @ near.T > 0
        rare = single[taxels] < SEEN  # what hardly answers elsewhere tells nothing: it joins any part, and joins none
        found[:, rare] = True
        found[rare] = False
        return found

    return _split(pokes, beside, np.arange(len(pokes)))


def _split(
    pokes: Pokes, beside: Callable[[np.ndarray], np.ndarray], among: Int[np.ndarray, " j"]
) -> Bool[np.ndarray, " n"]:
    """Return the pokes whose answers form unconnected parts, the second one with a fair share."""
    found = np.zeros(len(pokes), dtype=bool)
    for k in among.tolist():
        rows = slice(*pokes.starts[k : k + 2])
        taxels, response = pokes.taxel[rows], pokes.response[rows]
        if len(taxels) < 2:
            continue
        near = beside(taxels)
        part, reached = np.zeros(len(taxels), dtype=bool), np.zeros(len(taxels), dtype=bool)
        part[int(np.argmax(response))] = True
        if not near[part].any():  # nothing is known of the strongest
            continue
        while (part != reached).any():
            reached = part
            part = reached | near[reached].any(axis=0)
        found[k] = response[~part].sum() > SHARE * response.sum()
    return found
