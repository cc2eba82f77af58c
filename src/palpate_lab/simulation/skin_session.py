"""Simulate the paper's validation as a session on the bench: touches by a wand, a sensor below, cameras around.

Protocol [skin map, 3.5 and 4.3]: 19 touches at random places, of 1 to 16 N with a mean near 3.6 N, pressed along the
normal. Each is a ramp, a hold and a release, and between touches the sheet is at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.signals.recording import Recording
from palpate_lab.simulation.skin_bench import PaperSheet, Patch, Rolled, Wand, paper_sheet, press, read_out, wand_poses

RATE = 50.0  # Hz
HOLD, PAUSE, RAMP = 0.8, 0.4, 0.1  # s
FORCE_NOISE, TORQUE_NOISE = 0.05, 0.001  # N, N m, of the sensor below


@dataclass(frozen=True, eq=False)
class SkinSession:
    """The recordings of a session, and their truth.

    Attributes:
        sheet, model: sheet of the bench, and the model of its readings.
        frames: cells at 50 Hz; the first second is untouched.
        wrench: (n, 6) [N, N m] of the sensor below, at the times of `frames`, in the link's frame.
        wand: (n, 7) pose of the wand in the link's frame; NaN where it was lost or away.
        start, end: (k,) [s] of each touch.
        point, normal, force: (k, 3) of each touch, from geometry.
    """

    sheet: Rolled
    model: PaperSheet
    frames: Recording
    wrench: Float[np.ndarray, "n 6"]
    wand: Float[np.ndarray, "n 7"]
    start: Float[np.ndarray, " k"]
    end: Float[np.ndarray, " k"]
    point: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    force: Float[np.ndarray, "k 3"]


def simulate_protocol(
    rng: np.random.Generator,
    *,
    sheet: Rolled | None = None,
    model: PaperSheet | None = None,
    touches: int = 19,
    width: float = 0.3,
    wand: Wand | None = None,
) -> SkinSession:
    """Simulate one session of touches with a wand, and return the `SkinSession`.

    Args:
        rng: random numbers of everything drawn.
        sheet: None: the paper's.
        model: None: the paper's, drawn.
        touches: number of touches.
        width: width of a touch, in cells; small ones lie in one cell or two.
        wand: the wand and its cameras; None: the usual ones.
    """
    sheet, wand = sheet or Rolled(), wand or Wand()
    model = model or paper_sheet(sheet, rng)
    half = min(max(width / 2 - 0.5, -0.5), (sheet.rows - 1) / 2)
    places = np.stack(
        [rng.uniform(half, sheet.rows - 1 - half, touches), rng.uniform(half, sheet.columns - 1 - half, touches)],
        axis=1,
    )
    newtons = np.clip(rng.exponential(2.6, touches) + 1.0, 1.0, 16.0) * max(1.0, width**2 / 2)
    patches = [
        Patch(row, column, width / 2, force)
        for (row, column), force in zip(places.tolist(), newtons.tolist(), strict=True)
    ]
    pressed = [press(sheet, [patch]) for patch in patches]
    begin = 1.0 + (HOLD + PAUSE) * np.arange(touches)
    time = np.arange(int((begin[-1] + HOLD + PAUSE) * RATE)) / RATE
    share = np.stack([np.clip(np.minimum((time - at) / RAMP, (at + HOLD - time) / RAMP), 0.0, 1.0) for at in begin])
    loads = np.einsum("kn,krc->nrc", share, np.stack([each.loads for each in pressed]))
    exact = share.T @ np.stack([np.concatenate([each.force[0], each.torque[0]]) for each in pressed])
    noise = np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)
    point, normal = np.stack([each.point[0] for each in pressed]), np.stack([each.normal[0] for each in pressed])
    tracked = np.full((len(time), 7), np.nan)
    touched: Int[np.ndarray, " m"] = np.flatnonzero(share.max(axis=0) >= 1.0)
    which = share.argmax(axis=0)[touched]
    tracked[touched] = wand_poses(wand, point[which], normal[which], rng)
    return SkinSession(
        sheet,
        model,
        read_out(model, loads, rng, rate=RATE),
        exact + noise * rng.standard_normal(exact.shape),
        tracked,
        begin + RAMP,
        begin + HOLD - RAMP,
        point,
        normal,
        np.stack([each.force[0] for each in pressed]),
    )


def load_cell_presses(
    sheet: Rolled, model: PaperSheet, rng: np.random.Generator, *, presses: int = 60
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Int[np.ndarray, "n 2"]]:
    """Return force (n,) [N], reading (n,) [counts] and cell (n, 2) of presses on each cell in turn.

    Each press goes up, and down again.
    """
    ramp = np.linspace(0.0, 1.0, presses // 2) ** 2
    force = np.concatenate([ramp, ramp[::-1]]) * 18.0
    cell = np.argwhere(np.ones((sheet.rows, sheet.columns)))
    exact = model.rest.reshape(-1, 1) + model.gain.reshape(-1, 1) * model.counts(force)[None]
    counts = np.clip(np.rint(exact + model.noise * rng.standard_normal(exact.shape)), 0.0, model.top)
    return np.tile(force, len(cell)), counts.ravel(), np.repeat(cell, len(force), axis=0)
