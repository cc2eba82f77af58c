"""What `takes_arrays` makes of arguments: the array that an annotation names, or a sentence on what is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.spatial.arguments import integer, number, takes_arrays


@takes_arrays
def taken(
    time: Float[np.ndarray, " n"],
    points: Float[np.ndarray, "n 3"] | None = None,
    rate: float = 1.0,
    which: Int[np.ndarray, " k"] | None = None,
    mask: Bool[np.ndarray, " n"] | None = None,
    *,
    batch: Float[np.ndarray, "*#batch 3"] | None = None,
    other: Float[np.ndarray, "*#batch 2"] | None = None,
) -> tuple[object, ...]:
    return time, points, rate, which, mask, batch, other


@takes_arrays
class Pair(NamedTuple):
    """A named tuple, whose constructor is checked as a function is."""

    first: Float[np.ndarray, " n"]
    second: Float[np.ndarray, " n"]


@takes_arrays
def sized(values: Float[np.ndarray, " n"], size: tuple[int, int]) -> np.ndarray:
    return values.reshape(size)


TIME, POINTS = np.arange(4.0), np.arange(12.0).reshape(4, 3)


def test_what_fits_is_handed_on_as_it_is() -> None:
    assert taken(TIME, points=POINTS)[0] is TIME
    assert taken(TIME, POINTS)[1] is POINTS
    assert taken(TIME)[1] is None


@pytest.mark.parametrize(
    "points",
    [
        POINTS.tolist(),
        tuple(map(tuple, POINTS.tolist())),
        POINTS.astype(np.float32),
        POINTS.astype(np.int8),
        np.asfortranarray(POINTS),
        np.repeat(POINTS, 2, axis=1)[:, ::2],
        pl.DataFrame(POINTS),
    ],
)
def test_any_container_becomes_the_array_of_the_annotation(points: object) -> None:
    (_, found, *_) = taken(pl.Series(TIME), points)
    assert type(found) is np.ndarray
    assert found.dtype == np.float64
    assert found.flags.c_contiguous
    assert np.array_equal(found, POINTS)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"time": TIME[None]}, r"time must have shape \(n,\), not \(1, 4\)"),
        ({"points": POINTS[:3]}, r"points must have shape \(4, 3\) \(n as in time\), not \(3, 3\)"),
        ({"points": None, "time": None}, "time"),
        ({"time": ["a", "b"]}, "time must be float64"),
        ({"time": [[1.0], [1.0, 2.0]]}, "time must be float64"),
        ({"time": TIME * 1j}, "complex128"),
        ({"rate": "fast"}, "rate must be a number, not 'fast'"),
        ({"which": [0.5]}, "which must be int64"),
        ({"which": [10**400]}, "which must be int64"),
        ({"mask": [0, 1, 0, 1]}, "mask must be bool"),
        (
            {"batch": np.zeros((5, 3)), "other": np.zeros((4, 2))},
            r"other must have shape \(5, 2\) \(batch as in batch\)",
        ),
    ],
)
def test_what_does_not_fit_is_a_sentence(given: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        taken(**({"time": TIME, "points": POINTS} | given))


def test_arguments_like_those_of_before_are_taken_and_others_are_not() -> None:
    @takes_arrays
    def counted(values: Float[np.ndarray, " n"], count: int, more: Float[np.ndarray, " n"] | None = None) -> object:
        return values, count, more

    for length in (*range(4, 80), 4):  # more forms than are kept
        values = np.arange(float(length))
        assert counted(values, 3, values)[2] is values
        assert counted(values, 3, more=values)[2] is values
        for wrong in (values[1:], values[:, None]):
            with pytest.raises(InputError, match="more"):
                counted(values, 3, more=wrong)
        with pytest.raises(InputError, match="count must be"):
            counted(values, 2**70)
        assert counted(np.repeat(values, 2)[::2], 3)[0].flags.c_contiguous
        assert counted(values, 3, values > 1.0)[2].dtype == np.float64


def test_leading_axes_are_broadcast_where_the_annotation_says_so() -> None:
    assert taken(TIME, batch=np.zeros((5, 1, 3)), other=np.zeros((4, 2)))[5].shape == (5, 1, 3)


def test_what_cannot_be_computed_names_the_argument_that_is_not_finite_or_empty() -> None:
    @takes_arrays
    def solved(matrix: Float[np.ndarray, "n n"], share: float = 1.0) -> np.ndarray:
        return np.linalg.svd(matrix)[1][0] * (1 / share)

    with pytest.raises(InputError, match=r"matrix must be finite, and is nan at \[1, 0\]"):
        solved([[1.0, 0.0], [np.nan, 1.0]])
    with pytest.raises(InputError, match="matrix is empty"):
        solved(np.zeros((0, 0)))
    with pytest.raises(InputError, match="share must not be zero"):
        solved([[1.0]], 0)


def test_an_error_that_no_argument_explains_stays_what_it_is() -> None:
    @takes_arrays
    def failing(values: Float[np.ndarray, " n"]) -> None:
        raise ValueError(f"a fault of ours, of {len(values)} values")

    with pytest.raises(ValueError, match="a fault of ours"):
        failing([1.0])


def test_a_class_takes_them_in_its_constructor_and_its_methods() -> None:
    @takes_arrays
    @dataclass(frozen=True)
    class Line:
        at: Float[np.ndarray, " n"]
        value: Float[np.ndarray, " n"]

        def moved(self, by: Float[np.ndarray, " n"]) -> Line:
            return Line(self.at + by, self.value)

    assert Line([1, 2], (3, 4)).moved([1, 1]).at.tolist() == [2.0, 3.0]
    with pytest.raises(InputError, match="value must have shape"):
        Line([1.0, 2.0], [3.0])


def test_a_named_tuple_and_a_tuple_of_numbers_are_taken_as_arrays_are() -> None:
    assert Pair([1, 2], (3, 4)).second.dtype == np.float64
    assert sized(TIME.tolist(), [2.0, 2]).shape == (2, 2)
    with pytest.raises(InputError, match=r"second must have shape \(2,\)"):
        Pair([1, 2], [3])
    with pytest.raises(InputError, match=r"size\[1\] must be a whole number"):
        sized(TIME, (2, 1.5))
    with pytest.raises(InputError, match=r"size must have shape \(2,\)"):
        sized(TIME, (2, 2, 1))


def test_arrays_that_do_not_fit_together_are_named_with_their_shapes() -> None:
    with pytest.raises(InputError, match=r"values \(4,\), size \(3, 3\) cannot be used"):
        sized(TIME, (3, 3))


def test_a_number_may_be_of_any_class_and_is_one() -> None:
    assert number(np.float32(0.5), "a") == 0.5
    assert integer(np.int8(3), "a") == 3
    for make, value in ((number, "1"), (number, [1.0]), (integer, 1.5), (integer, 10**400)):
        with pytest.raises(InputError, match="a must be"):
            make(value, "a")
