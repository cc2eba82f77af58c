"""What cells are worth: rest and noise are found under touches, and the bad ones by name."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.taxels.health import Health, examine
from palpate.sensors.taxels.model import TaxelBody
from palpate.signals.recording import CELLS, Recording
from palpate_lab.simulation.skin_bench import Rolled

LAYOUT = Rolled(6, 8, radius=np.inf).layout()
SHEET = TaxelBody.sheet(LAYOUT)


def _frames(count: int = 200, *, touched: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Rest of 10 to 20 counts with noise of 1; a touch of 3 x 3 cells passes over all columns again and again."""
    rng = np.random.default_rng(3)
    rest = rng.uniform(10.0, 20.0, (6, 8))
    cells = rest + rng.standard_normal((count, 6, 8))
    for k in range(0, count if touched else 0, 2):
        row, column = 1 + k // 16 % 4, 1 + k // 2 % 6
        cells[k, row - 1 : row + 2, column - 1 : column + 2] += 100.0
    return np.rint(cells), rest


def _examined(cells: np.ndarray, body: TaxelBody = SHEET, seconds: float | None = None) -> Health:
    return examine(Recording(np.arange(len(cells)) / 50.0, {CELLS: cells}), body, seconds=seconds)


def test_rest_and_noise_are_found_under_touches() -> None:
    """Rest to 0.5 counts: five deviations of the mean of 100 frames; the noise with rounding is 1.04."""
    cells, rest = _frames()
    health = _examined(cells)
    assert np.abs(health.baseline - rest.ravel()).max() < 0.5
    assert np.all((health.noise > 0.8) & (health.noise < 1.35))
    assert health.good.all()


@pytest.mark.parametrize(("step", "said"), [(8.0, "cells read 8 more"), (-8.0, "cells read 8 less"), (1.0, "")])
def test_a_zero_that_moved_without_a_tare_is_named(step: float, said: str) -> None:
    cells, _ = _frames()
    cells[len(cells) // 3 :] += step
    assert said in (found := "".join(_examined(cells).warnings))
    assert bool(found) == bool(said)


def test_a_cell_that_is_silent_between_pressed_ones_is_dead() -> None:
    cells, _ = _frames()
    cells[:, 2, 3] = 12.0
    health = _examined(cells)
    assert np.flatnonzero(health.dead).tolist() == [19]
    assert any("dead" in note and "(2, 3)" in note for note in health.warnings)


def test_a_cell_at_one_value_far_from_the_others_is_stuck() -> None:
    cells, _ = _frames()
    cells[:, 4, 1] = 255.0
    health = _examined(cells)
    assert np.flatnonzero(health.stuck).tolist() == [33]


def test_an_idle_sheet_whose_driver_cuts_noise_off_is_not_stuck() -> None:
    health = _examined(np.zeros((50, 6, 8)))
    assert health.good.all()
    assert any("no cell moves" in note for note in health.notes)


def test_all_cells_stuck_are_refused() -> None:
    frozen = np.repeat(np.arange(48.0).reshape(1, 6, 8) * 5, 50, axis=0)
    with pytest.raises(InputError, match=r"all cells are stuck.*Check"):
        _examined(frozen)


def test_rest_below_zero_that_wrapped_is_put_right() -> None:
    """Readings about 0 with noise of 1 come out as 255 now and then; their mean is near 0, not near 60."""
    rng = np.random.default_rng(4)
    cells = np.mod(np.rint(rng.standard_normal((200, 6, 8)) + 0.5), 256.0)
    health = _examined(cells)
    assert np.abs(health.baseline - 0.5).max() < 0.6
    assert any("wrapped around" in note for note in health.notes)


def test_a_hard_touch_of_one_cell_is_not_taken_for_a_wrap() -> None:
    """It rests where noise takes it nowhere near 0, so what it reads at the top is pressed."""
    rng = np.random.default_rng(5)
    cells = np.rint(7.0 + rng.standard_normal((300, 6, 8)))
    cells[100:140, 4, 2] += 223.0
    assert not any("wrapped around" in note for note in _examined(cells).notes)


def test_frames_of_another_size_are_counted_and_named() -> None:
    with pytest.raises(InputError, match=r"only 0 of 30 frames have 6 x 8 cells.*Check"):
        _examined(np.full((30, 6, 8), np.nan))
    with pytest.raises(InputError, match=r"only 1 of 1 frames.*too short"):
        _examined(np.zeros((1, 6, 8)))


def test_a_start_without_touch_is_taken_at_its_word() -> None:
    cells, rest = _frames(touched=False)
    cells[100:] += 40.0  # later all is pressed
    assert np.abs(_examined(cells, seconds=1.5).baseline - rest.ravel()).max() < 0.6


@pytest.mark.parametrize(
    ("rows", "given", "said"),
    [(1, {}, "needs rows and columns"), (6, {"bits": 40}, "bits"), (6, {"masked": ((6, 0),)}, "counted from 0")],
)
def test_sheets_that_cannot_be_are_refused(rows: int, given: dict[str, object], said: str) -> None:
    place = Rolled(rows, 1 if rows == 1 else 22).layout()
    with pytest.raises(InputError, match=said):
        TaxelBody.sheet(place, **given)  # pyright: ignore[reportArgumentType] - wrong on purpose


def test_what_is_left_of_a_reading_behind_a_touch_is_reported() -> None:
    """Pressed for a second to 100 counts, then 15 counts that decay with 2 s: 11.7 after half a second."""
    time = np.arange(200) / 50.0
    course = np.where(time < 1, 0.0, np.where(time < 2, 100.0, 15.0 * np.exp(-(time - 2) / 2.0)))
    cells = np.random.default_rng(5).standard_normal((200, 6, 8)) + 12.0
    cells[:, 2:4, 3:5] += course[:, None, None]
    health = examine(Recording(time, {CELLS: cells}), TaxelBody.sheet(LAYOUT, bits=None), seconds=0.9)
    assert health.hysteresis == pytest.approx(0.15 * np.exp(-0.25), abs=0.02)
    assert any("hysteresis" in note for note in health.warnings)
    quick, _ = _frames()
    assert not any("hysteresis" in note for note in _examined(quick).warnings)
