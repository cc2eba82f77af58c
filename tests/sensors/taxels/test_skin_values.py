"""Readings in steps, readings that fall, and zeros that move: the number of touches is the one that was made."""

from typing import Any

import numpy as np
import pytest

from claims.evidence.skin_values import SHEET, TARE, counted, made, shifted, turned
from palpate.contact.estimate import Status
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.calibrate import identify_intensity
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import examine
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.rest import ROUNDING, quantum, resting
from palpate.sensors.taxels.watch import TaxelWatch
from palpate.signals.recording import CELLS, Recording

BODY = TaxelBody.sheet(SHEET.layout(), bits=None)


def _estimator(log: Recording) -> TaxelEstimator:
    return TaxelEstimator(BODY, health=examine(log, BODY, seconds=TARE))


@pytest.mark.parametrize("step", [0.1, 1.0, 4.0])
@pytest.mark.parametrize("ratio", [0.05, 0.3, 1.0])
def test_noise_is_at_least_that_of_rounding_to_the_steps_of_the_readings(step: float, ratio: float) -> None:
    """Rounding of a noise s to steps q has a deviation from q / sqrt(12) to sqrt(s^2 + q^2 / 4)."""
    rng = np.random.default_rng(1)
    cells = step * np.rint(rng.uniform(20.0, 60.0, 24) + rng.normal(0.0, ratio, (400, 24)))
    np.testing.assert_allclose(quantum(cells), step, rtol=1e-9)
    noise = resting(cells, counts=False)[1]
    assert (noise >= ROUNDING * step * (1 - 1e-9)).all()
    assert (noise <= step * np.hypot(1.15 * ratio, 0.52)).all()
    assert not quantum(rng.normal(0.0, 1.0, (400, 24))).any()  # continuous


@pytest.mark.parametrize(
    "changes",
    [{"ratio": 0.05}, {"ratio": 0.5}, {"falling": True}, {"remains": True}, {"common": turned}, {"common": shifted}],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_touches_are_counted_whatever_the_readings(changes: dict[str, Any], seed: int) -> None:
    log, touches = made(np.random.default_rng([5, seed]), **changes)
    assert counted(log, touches, BODY)


def test_what_moved_is_reported_and_what_did_not_is_not() -> None:
    rng = [np.random.default_rng(9) for _ in range(4)]
    kinds: list[dict[str, Any]] = [{}, {"common": turned}, {"remains": True}, {"falling": True}]
    logs = [made(each, **kind)[0] for each, kind in zip(rng, kinds, strict=True)]
    skins = [_estimator(log) for log in logs]
    found = [skin.run(log) for skin, log in zip(skins, logs, strict=True)]
    assert not skins[0].warnings()
    assert not skins[0].unbelievable
    assert "shifted together once" in " ".join(skins[1].warnings())
    assert np.count_nonzero(found[1].status == Status.INVALID) == 10
    assert "remained after it" in " ".join(skins[2].warnings())
    assert "falling = true" in " ".join(skins[3].notes())


@pytest.mark.parametrize("changes", [{"common": turned}, {"remains": True}])
def test_zeros_that_move_are_followed_alike_in_blocks_of_any_size(changes: dict[str, Any]) -> None:
    log, _ = made(np.random.default_rng(3), **changes)
    whole, parts = _estimator(log), _estimator(log)
    blocks = (log.picked(slice(k, k + 37)) for k in range(0, len(log), 37))
    np.testing.assert_array_equal(
        np.concatenate([each.estimate.force for each in parts.stream(blocks)]), whole.run(log).estimate.force
    )


def test_readings_that_fall_without_a_touch_at_the_start_are_named_later() -> None:
    log, _ = made(np.random.default_rng(4), falling=True)
    skin = TaxelEstimator(BODY, health=examine(log.picked(slice(0, 150)), BODY))  # 3 s without a touch
    skin.run(log)
    assert "falling = true" in " ".join(skin.warnings())
    stated = TaxelEstimator(BODY, falling=True, health=examine(log.picked(slice(0, 150)), BODY, falling=True))
    assert stated.run(log).answered.any()
    rising = Intensity((Curve("polynomial", np.array([10.0]), np.zeros((1, 1)), largest=20.0),))
    with pytest.raises(InputError, match=r"contradicts the curves.*Leave"):
        TaxelEstimator(BODY, rising, falling=True)


def test_a_wrong_order_of_the_cells_is_not_believed() -> None:
    log, _ = made(np.random.default_rng(6))
    order = np.random.default_rng(7).permutation(64)
    mixed = Recording(log.time, {CELLS: log.channels[CELLS][:, order]})
    skin = _estimator(mixed)
    skin.run(mixed)
    assert "order" in skin.unbelievable


def test_lost_and_frozen_frames_are_found_wherever_they_are() -> None:
    log, _ = made(np.random.default_rng(8))
    cells, kept = log.channels[CELLS].copy(), np.arange(len(log)) % 7 != 3
    cells[700:740] = cells[700]
    said = " ".join(_watched(log.time[kept], cells[kept]).warnings())
    assert "frames are missing (14%)" in said
    assert "the readings repeat from 14.00 to 14.78 s" in said
    assert not _watched(log.time, log.channels[CELLS]).warnings()
    for coarse in (False, True):  # to the end of the log; rest that repeats is no hanging sensor
        cells = np.round(log.channels[CELLS] / 200.0) if coarse else log.channels[CELLS].copy()
        cells[150:] = cells[150]
        assert ("the readings repeat from 3.00" in " ".join(_watched(log.time, cells).warnings())) is not coarse


def _watched(time: np.ndarray, cells: np.ndarray) -> TaxelWatch:
    """Frames without contacts."""
    watch, width = TaxelWatch(BODY), _estimator(Recording(time, {CELLS: cells})).empty(0).shape[1]
    watch.add(time, cells, cells, np.full((len(time), width), np.nan), np.ones(len(time), dtype=np.int64))
    return watch


@pytest.mark.parametrize(("share", "ghost"), [(0.6, True), (1.0, False)])
def test_the_weak_corner_of_a_rectangle_of_touches_may_be_a_ghost(share: float, ghost: bool) -> None:
    time, rng = np.arange(500) / 50.0, np.random.default_rng(2)
    row, column = (each.ravel() for each in np.mgrid[:8, :8])
    cells = rng.normal(40.0, 1.0, (500, 64))
    for r, c, size in ((1, 1, 1.0), (1, 6, 1.0), (6, 1, 1.0), (6, 6, share)):
        cells[250:350] += 250.0 * size * np.exp(-((row - r) ** 2 + (column - c) ** 2))
    log = Recording(time, {CELLS: cells})
    skin = _estimator(log)
    skin.run(log)
    assert ("ghost" in " ".join(skin.warnings())) == ghost


def test_a_few_known_weights_give_a_curve_or_the_reason_why_not() -> None:
    rng = np.random.default_rng(1)
    force = np.repeat([0.0, 0.5, 1.0, 2.0, 5.0], 40)
    counts = np.rint(20.0 + np.minimum(100.0 * force, 250.0) + rng.normal(0.0, 2.0, len(force)))
    curve = identify_intensity(force, counts).curves[0]
    assert curve.force(np.array([100.0]))[0] == pytest.approx(1.0, rel=0.05)
    with pytest.raises(NotIdentifiable, match="lighter forces"):
        identify_intensity(4.0 * force, counts.clip(None, 70.0))
    with pytest.raises(NotIdentifiable, match="one clock"):
        identify_intensity(rng.uniform(0.0, 10.0, 200), rng.uniform(0.0, 200.0, 200))


def test_a_curve_that_falls_ends_at_zero_counts() -> None:
    force = np.tile(np.linspace(0.0, 10.0, 50), 4)
    cell = np.repeat([[0, 0], [0, 1], [1, 0], [1, 1]], 50, axis=0)
    counts = 240.0 - 12.0 * force * (1.0 + 0.1 * cell[:, 0])
    found = identify_intensity(force, counts, cell, shape=(2, 2), top=255.0)
    assert all(curve.falling for curve in found.curves)
    assert found.curves[-1].force(np.array([132.0]))[0] == pytest.approx(10.0, rel=1e-3)
