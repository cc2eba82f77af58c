"""A log of voltages in blocks: the zero of every start, and what does not depend on how it was cut."""

from __future__ import annotations

import numpy as np
import pytest

from palpate import ContactEstimate, Recording
from palpate.contact.fingertip import Fingertip
from palpate.contact.fingertip_stream import FingertipStream
from palpate.errors import InputError
from palpate.sensors.load_cells import VOLTAGE, LoadCells
from palpate.simulation.cell_array import LAYOUTS, random_cells
from palpate.surfaces import EllipticCylinder

SURFACE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
ARRAY = random_cells(LAYOUTS[4], np.random.default_rng(1))
NOISE = 1e-4  # V
PUSH = ARRAY.voltages(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))  # 1 N on the middle


def start(begin: float, zero: float, *, rest: bool = True, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """2 s at 1 kHz: at rest, then pushed."""
    time = begin + np.arange(2000) / 1000
    pushed = np.clip((time - begin - 1.0) / 0.2, 0, 1) if rest else np.linspace(0.5, 1.0, 2000)
    noise = NOISE * np.random.default_rng(seed).normal(size=(2000, 12))
    offset = zero * np.where(np.arange(12) % 5 < 2, 1.0, -1.0)  # no wrench
    return time, offset + pushed[:, None] * PUSH + noise


def recording(*parts: tuple[np.ndarray, np.ndarray]) -> Recording:
    return Recording(
        np.concatenate([p[0] for p in parts]), {VOLTAGE: np.concatenate([p[1] for p in parts])}, source="log"
    )


def answered(log: Recording, cut: int = 10_000) -> tuple[FingertipStream, ContactEstimate]:
    stream = FingertipStream(Fingertip(LoadCells(ARRAY.forward(), np.full(12, NOISE)), SURFACE))
    blocks = [log.picked(slice(k, k + cut)) for k in range(0, len(log), cut)]
    pairs = list(stream.stream(blocks))
    np.testing.assert_array_equal(np.concatenate([block.time for block, _ in pairs]), log.time)
    return stream, ContactEstimate.joined([found for _, found in pairs])


def test_each_start_has_its_own_zero() -> None:
    log = recording(start(0.0, 0.02), start(40.0, -0.03, seed=1), start(10.0, 0.01, seed=2))  # a gap; time runs back
    stream, found = answered(log)
    for end in (2000, 4000, 6000):
        last = slice(end - 500, end)
        assert found.answered[last].all()
        assert np.abs(found.force[last] - [0.0, 0.0, -1.0]).max() < 0.02  # 2 mN of noise
    assert not stream.doubted
    assert stream.subsets[1] >= 5990


@pytest.mark.parametrize("cut", [1, 77, 499, 3000])
def test_answers_do_not_depend_on_the_blocks(cut: int) -> None:
    log = recording(start(0.0, 0.02), start(40.0, -0.03, seed=1)).picked(slice(0, 2700))
    whole, parts = answered(log)[1], answered(log, cut)[1]
    for name in ("point", "force", "covariance", "status"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


def test_a_first_start_that_is_touched_is_refused_and_a_later_one_doubted() -> None:
    with pytest.raises(InputError, match="not at rest at the start"):
        answered(recording(start(0.0, 0.02, rest=False)))
    stream, found = answered(recording(start(0.0, 0.02), start(40.0, 0.02, rest=False)))
    assert "the start at 40.000 s is not at rest" in stream.doubted[0]
    assert np.abs(found.force[-20:] - [0.0, 0.0, -1.0]).max() < 0.02


def test_a_log_without_voltages_is_refused() -> None:
    with pytest.raises(InputError, match="no voltages"):
        answered(Recording(np.arange(100) / 100, {}))
    with pytest.raises(InputError, match="needs 20 samples"):
        answered(recording(start(0.0, 0.0)).picked(slice(0, 10)))


def test_faults_are_found_on_the_way() -> None:
    log = recording(start(0.0, 0.02))
    volts = log.channels[VOLTAGE].copy()
    volts[:, 3:6] = 0.0
    stream, found = answered(Recording(log.time, {VOLTAGE: volts}))
    assert [fault.kind for fault in stream.faults()] == ["dead"]
    assert found.answered[-500:].all()
    assert stream.subsets[3] > 700
