"""Readings straight to positions: known where they vary with it, refused where they do not."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.calibration.response import identify_response
from palpate.errors import InputError, NotIdentifiable


def _strips() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five strips with bell-shaped responses along x, which say nothing of y; seven strokes."""
    rng = np.random.default_rng(8)
    x = np.tile(np.linspace(0.0, 50.0, 60), 7)
    y = np.repeat(np.arange(7.0), 60)
    readings = np.exp(-0.5 * ((x[:, None] - np.linspace(0, 50, 5)) / 10.0) ** 2) + 0.01 * rng.standard_normal((420, 5))
    return readings, np.column_stack([x, y]), y.astype(np.int64)


def test_held_out_strokes_are_placed() -> None:
    """To 0.5 mm: noise of 1 % on a slope of 5 % a millimetre is 0.2 mm."""
    readings, places, stroke = _strips()
    found = identify_response(readings, places[:, :1], stroke)
    assert float(found.error[0]) < 0.5
    assert np.abs(found.position(readings)[:, 0] - places[:, 0]).mean() < 0.5


def test_a_coordinate_that_readings_do_not_know_is_named() -> None:
    readings, places, stroke = _strips()
    with pytest.raises(NotIdentifiable, match="say nothing of y") as refused:
        identify_response(readings, places, stroke)
    assert refused.value.missing == ("y",)


def test_one_stroke_cannot_be_held_out() -> None:
    readings, places, stroke = _strips()
    with pytest.raises(InputError, match="one group"):
        identify_response(readings, places[:, :1], np.zeros_like(stroke))
