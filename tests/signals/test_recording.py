"""A recording is a value: read-only down into its arrays, of the shapes its names stand for, and back from a pickle."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.signals.recording import (
    ACCELERATION,
    CELLS,
    FORCE,
    ORIENTATION,
    POSITION,
    TORQUE,
    UNSTEADY,
    VOLTAGE,
    Recording,
)

WIDTHS = {FORCE: 3, TORQUE: 3, ORIENTATION: 4, POSITION: 3, ACCELERATION: 3, UNSTEADY: 1}


def _recording(count: int = 5) -> Recording:
    rng = np.random.default_rng(0)
    channels = {name: rng.normal(size=(count, width)) for name, width in WIDTHS.items()}
    channels |= {VOLTAGE: rng.normal(size=(count, 12)), CELLS: rng.normal(size=(count, 3, 4))}
    return Recording(np.arange(count) / 10.0, channels, frame="base", source="a.csv", notes=("one", "two"))


def _pickled(recording: Recording) -> Recording:
    return pickle.loads(pickle.dumps(recording))


@pytest.mark.parametrize("through", [_pickled, copy.copy, copy.deepcopy, lambda whole: whole.picked(slice(None))])
def test_what_comes_back_is_the_same_and_read_only(through: Callable[[Recording], Recording]) -> None:
    whole = _recording()
    back = through(whole)
    assert (back.frame, back.source, back.notes) == (whole.frame, whole.source, whole.notes)
    assert back.channels.keys() == whole.channels.keys()
    for name, values in {"time": whole.time, **whole.channels}.items():
        found = back.time if name == "time" else back.channels[name]
        np.testing.assert_array_equal(found, values)
        assert found.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            found[0] = 0.0
    channels: Any = back.channels
    with pytest.raises(TypeError):
        channels[FORCE] = whole.channels[FORCE]


@pytest.mark.parametrize("name", WIDTHS)
@pytest.mark.parametrize("more", [-1, 1])
def test_a_channel_of_another_width_is_refused(name: str, more: int) -> None:
    with pytest.raises(InputError, match=f"channel '{name}' has the shape .* it must be n x {WIDTHS[name]}"):
        Recording(np.zeros(4), {name: np.zeros((4, WIDTHS[name] + more))})
    with pytest.raises(InputError, match=f"channel '{name}'"):
        Recording(np.zeros(4), {name: np.zeros((4, WIDTHS[name], 1))})


@pytest.mark.parametrize("name", [FORCE, VOLTAGE, CELLS, "anything"])
@pytest.mark.parametrize("count", [0, 3, 5])
def test_there_is_one_row_for_each_time(name: str, count: int) -> None:
    with pytest.raises(InputError, match="for n = 4 times"):
        Recording(np.zeros(4), {name: np.zeros((count, 3))})


def test_channels_may_have_any_trailing_shape() -> None:
    shapes = {VOLTAGE: (4, 9), CELLS: (4, 6, 22), "a": (4,), "b": (4, 2, 3, 5)}
    made = Recording(np.zeros(4), {name: np.zeros(shape) for name, shape in shapes.items()})
    assert {name: values.shape for name, values in made.channels.items()} == shapes


def test_arrays_are_copied_only_where_somebody_could_change_them() -> None:
    open_to_change, sealed = np.ones((4, 3)), np.ones((4, 3))
    sealed.flags.writeable = False
    made = Recording(np.zeros(4), {FORCE: open_to_change, TORQUE: sealed})
    open_to_change[:] = 7.0
    assert np.all(made.channels[FORCE] == 1.0)
    assert made.channels[TORQUE] is sealed
    assert np.shares_memory(made.picked(slice(1, 3)).channels[FORCE], made.channels[FORCE])


@pytest.mark.parametrize(
    "values",
    [np.asfortranarray(np.arange(12.0).reshape(4, 3)), np.arange(24.0).reshape(4, 6)[:, ::2], np.zeros((8, 3))[::2]],
)
def test_whatever_is_given_is_held_by_rows(values: np.ndarray) -> None:
    for given in (values, values.view()):
        given.flags.writeable = False
        made = Recording(np.zeros(4), {FORCE: given})
        assert made.channels[FORCE].flags.c_contiguous
        assert made.picked(np.array([True, False, True, False])).channels[FORCE].flags.c_contiguous
        np.testing.assert_array_equal(made.channels[FORCE], values)


def test_wrenches_that_are_not_there_are_said() -> None:
    with pytest.raises(InputError, match=r"a\.csv: force and torque are needed, and there is voltage"):
        Recording(np.zeros(4), {VOLTAGE: np.zeros((4, 9))}, source="a.csv").wrenches()
