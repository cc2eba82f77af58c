"""What a public call hands to compiled loops: the right answer, or a sentence with the shape wanted and the one seen.

Whatever the layout: Fortran order, strides, read-only, another byte order, whole numbers, single precision, lists. None
of them compiles a loop a second time, and none is read beyond its end.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate import identify_payload
from palpate.contact import ContactEstimate, Locator
from palpate.contact.locate import locate
from palpate.errors import InputError
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Cylinder, Mesh, plane, superquadric
from palpate.surfaces.bspline import BSplineSurface, open_knots
from tests.support.bodies import BODIES, R
from tests.support.kernels import compilations

ANY = None


@dataclass(frozen=True)
class Call:
    """A public call by one of its arguments: what it answers, an array that suits it, and every shape that does."""

    answer: Callable[[Any], Any]
    suits: np.ndarray  # small whole numbers, so that every type holds them
    shapes: tuple[tuple[Any, ...], ...]
    whole: bool = False  # of int8: fractions are refused

    def takes(self, shape: tuple[int, ...]) -> bool:
        """Is this one of the shapes?"""
        return any(fits(shape, wanted) for wanted in self.shapes)


def fits(shape: tuple[int, ...], wanted: tuple[Any, ...]) -> bool:
    if wanted[:1] == (...,):
        return len(shape) >= len(wanted) - 1 and fits(shape[len(shape) - len(wanted) + 1 :], wanted[1:])
    return len(shape) == len(wanted) and all(w is ANY or s == w for s, w in zip(shape, wanted, strict=True))


def values(answer: Any) -> list[np.ndarray]:
    """Every array in an answer."""
    if isinstance(answer, ContactEstimate):
        return [np.asarray(value) for value in vars(answer).values()]
    return [np.asarray(value) for value in (answer if isinstance(answer, tuple) else (answer,))]


@functools.cache
def locator() -> Locator:
    return Locator(BODIES["L"].mesh, noise=[0.02] * 3 + [5e-4] * 3)


@functools.cache
def spline() -> BSplineSurface:
    u, v = np.meshgrid(np.arange(6.0), np.arange(7.0), indexing="ij")
    control = np.stack([u, v, 0.1 * u * v], axis=-1)
    return BSplineSurface(open_knots(np.arange(4.0)), open_knots(np.arange(5.0)), np.asfortranarray(control))


@functools.cache
def equation() -> Any:
    return superquadric((R, 0.7 * R, 0.5 * R), (0.9, 0.8))


def afresh(call: Callable[[Locator], Any]) -> Any:
    locator().reset()
    return call(locator())


def called(wrench: Any) -> np.ndarray:
    row = Locator.empty()
    afresh(lambda one: one(wrench, row))
    return row


def run_into(wrenches: Any, covariances: Any = None, statuses: Any = None) -> np.ndarray:
    rows = Locator.empty(3)
    statuses = np.full(3, -1, np.int8) if statuses is None else statuses
    afresh(lambda one: one.run_into(wrenches, covariances, statuses, rows))
    return rows


def from_last(point: Any) -> np.ndarray:
    locator().reset(point)
    return locator().run(PRESSES).point


def candidates(wrench: Any) -> tuple[np.ndarray, ...]:
    return tuple(vars(locator().candidates(wrench)).values())


def nearest(points: Any) -> np.ndarray:
    count = len(points) if getattr(points, "ndim", 1) else 1
    return spline().nearest(points, np.resize(PLACES, (count, 2)))


PRESSES = np.array([[-5.0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [1, -4, -3, 0, 0, 0]])
POINTS = np.array([[0.0, 0, 1], [2, -1, 0], [0, 1, 1], [3, 0, -2]])
PLACES = np.array([[0.0, 0], [1, 2], [3, 4], [2, 2]])
EACH = np.arange(1.0, 4.0)[:, None, None] * np.eye(6)
CALLS = {
    "locate": Call(lambda w: locate(w, BODIES["L"].mesh), PRESSES, ((..., 6),)),
    "Wrench.from_vector": Call(lambda w: Wrench.from_vector(w).vector(), PRESSES, ((..., 6),)),
    "run": Call(lambda w: afresh(lambda one: one.run(w)), PRESSES, ((..., 6),)),
    "run, one": Call(lambda w: afresh(lambda one: one.run(w)), PRESSES[0], ((..., 6),)),
    "run, covariances": Call(lambda c: afresh(lambda one: one.run(PRESSES, c)), EACH, ((3, 6, 6), (6, 6), (1, 6, 6))),
    "run, statuses": Call(
        lambda s: afresh(lambda one: one.run(PRESSES, statuses=s)), np.array([-1, 6, 8]), ((3,),), whole=True
    ),
    "run, previous": Call(
        lambda p: locator().run(PRESSES, sequential=False, previous=p), np.array([0.0, 0, 1]), ((3,),)
    ),
    "reset": Call(from_last, np.array([0.0, 0, 1]), ((3,),)),
    "called": Call(called, PRESSES[0], ((6,),)),
    "candidates": Call(candidates, PRESSES[0], ((6,),)),
    "run_into": Call(run_into, PRESSES, ((3, 6),)),
    "run_into, covariances": Call(lambda c: run_into(PRESSES.copy(), c), EACH, ((3, 6, 6),)),
    "run_into, statuses": Call(lambda s: run_into(PRESSES.copy(), None, s), np.array([-1, 6, 8]), ((3,),), whole=True),
    "Mesh.project": Call(lambda p: BODIES["L"].mesh.project(p), POINTS, ((ANY, 3),)),
    "Mesh.from_arrays": Call(lambda v: Mesh.from_arrays(v, [[0, 1, 2]]).vertices, POINTS, ((ANY, 3),)),
    "plane": Call(lambda p: plane(p, (0, 0, 1)).vertices, np.array([0.0, 0, 1]), ((3,),)),
    "Cylinder.project": Call(lambda p: Cylinder(R, R).project(p), POINTS, ((ANY, 3),)),
    "Cylinder.gradient": Call(lambda p: Cylinder(R, R).gradient(p), POINTS, ((..., 3),)),
    "ImplicitSurface.project": Call(lambda p: equation().project(p), POINTS, ((ANY, 3),)),
    "ImplicitSurface.value": Call(lambda p: equation().value(p), POINTS, ((..., 3),)),
    "ImplicitSurface.hessian": Call(lambda p: equation().hessian(p), POINTS, ((..., 3),)),
    "BSplineSurface.at": Call(lambda uv: spline().at(uv), PLACES, ((..., 2),)),
    "BSplineSurface.derivatives": Call(lambda uv: spline().derivatives(uv), PLACES, ((..., 2),)),
    "BSplineSurface.nearest": Call(nearest, POINTS, ((ANY, 3),)),
    "BSplineSurface.nearest, start": Call(lambda uv: spline().nearest(POINTS, uv), PLACES, ((4, 2),)),
    "BSplineSurface.geodesics": Call(
        lambda s: spline().geodesics(s, 0.1, 4), np.array([[1.0, 1, 1, 0, 0, 1], [2, 2, 0, 1, 0, 1]]), ((ANY, 6),)
    ),
}


def strided(array: np.ndarray) -> np.ndarray:
    """Every second of a longer array along every axis, with nonsense in between."""
    wide = np.full(tuple(2 * k for k in array.shape), 77, array.dtype)
    every = tuple(slice(None, None, 2) for _ in array.shape)
    wide[every] = array
    return wide[every]


def reversed_strides(array: np.ndarray) -> np.ndarray:
    back = tuple(slice(None, None, -1) for _ in array.shape)
    return array[back].copy()[back]


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


def misaligned(array: np.ndarray) -> np.ndarray:
    data = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)
    data[...] = array
    return data


LAYOUTS: dict[str, Callable[[np.ndarray], Any]] = {
    "as it is": lambda a: a,
    "Fortran": np.asfortranarray,
    "strided": strided,
    "reversed": reversed_strides,
    "read-only": read_only,
    "misaligned": misaligned,
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "matrix of a subclass": lambda a: a.view(np.memmap) if a.dtype.kind != "O" else a,
    "list": lambda a: a.tolist(),
}
TYPES = ("float64", "float32", "float16", "int64", "int32", "int8", "longdouble")


@pytest.mark.parametrize("name", CALLS)
@given(layout=st.sampled_from(list(LAYOUTS)), kind=st.sampled_from(TYPES))
def test_any_layout_and_type_gives_the_same_answer_and_compiles_nothing(name: str, layout: str, kind: str) -> None:
    call = CALLS[name]
    if call.whole and not kind.startswith("int"):
        kind = "int64"
    expected = values(call.answer(call.suits.astype("int8" if call.whole else "float64")))
    compiled = compilations()
    found = values(call.answer(LAYOUTS[layout](call.suits.astype(kind))))
    for one, two in zip(found, expected, strict=True):
        assert np.array_equal(one, two, equal_nan=True)
    assert compilations() == compiled


@pytest.mark.parametrize("name", CALLS)
@given(shape=st.lists(st.integers(0, 7), max_size=4), slip=st.lists(st.integers(-2, 2), min_size=3, max_size=3))
def test_a_wrong_shape_is_refused_and_both_shapes_are_said(name: str, shape: list[int], slip: list[int]) -> None:
    """Any shape, and the likely slips: a row short, a column long."""
    call = CALLS[name]
    slipped = [max(0, size + more) for size, more in zip(call.suits.shape, slip, strict=False)]
    for wrong in (tuple(shape), tuple(slipped)):
        if not call.takes(wrong):
            with pytest.raises(InputError, match="shape") as caught:
                call.answer(np.ones(wrong, np.int8))
            assert str(wrong) in str(caught.value)
            said = str(caught.value).replace("n", "None").replace("...", "Ellipsis")
            assert any(str(wanted[-1]) in said for wanted in call.shapes)


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("kind", ["complex128", "object", "U8", "datetime64[s]", "timedelta64[s]"])
def test_what_are_no_real_numbers_is_refused_and_named(name: str, kind: str) -> None:
    call = CALLS[name]
    with pytest.raises(InputError, match=kind.split("64")[0].replace("U8", "<U")):
        call.answer(call.suits.astype("int64").astype(kind))


@pytest.mark.parametrize("name", CALLS)
def test_lists_of_different_lengths_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="shape"):
        CALLS[name].answer([[1.0, 2.0], [1.0]])


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        *((name, (0, 6)) for name in ("locate", "run", "BSplineSurface.geodesics")),
        *((name, (0, 3)) for name in ("Mesh.project", "Cylinder.project", "ImplicitSurface.project")),
        *((name, (2, 0, 3)) for name in ("Cylinder.gradient", "ImplicitSurface.value", "ImplicitSurface.hessian")),
        *((name, (0, 2)) for name in ("BSplineSurface.at", "BSplineSurface.derivatives")),
    ],
)
def test_nothing_in_gives_nothing_out(name: str, shape: tuple[int, ...]) -> None:
    for kind in ("float64", "object"):
        for answer in values(CALLS[name].answer(np.empty(shape, kind))):
            assert answer.size == 0


@pytest.mark.parametrize("name", ["run, statuses", "run_into, statuses"])
def test_statuses_that_are_none_are_refused(name: str) -> None:
    for wrong in (np.array([0.5, 1, 2]), np.array([300, -1, -1]), np.array([True, False, True])):
        with pytest.raises(InputError, match="statuses must be int8"):
            CALLS[name].answer(wrong)


OUTS = {
    "too few": np.zeros((2, 22)),
    "too narrow": np.zeros((3, 21)),
    "flat": np.zeros(66),
    "single": np.zeros((3, 22), np.float32),
    "Fortran": np.zeros((3, 22), order="F"),
    "strided": np.zeros((6, 22))[::2],
    "read-only": read_only(np.zeros((3, 22))),
}


@pytest.mark.parametrize("name", OUTS)
def test_an_out_that_cannot_be_written_into_is_refused_and_left_alone(name: str) -> None:
    out = OUTS[name]
    with pytest.raises(InputError, match=r"shape|contiguous"):
        locator().run_into(PRESSES.copy(), None, np.full(3, -1, np.int8), out)
    assert not out.any()


@pytest.mark.parametrize(
    "out", [np.zeros(21), np.zeros((1, 22)), np.zeros(22, np.float32), np.zeros((22, 2))[:, 0], read_only(np.zeros(22))]
)
def test_a_row_that_cannot_be_written_into_is_refused_and_left_alone(out: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"\(22,\)"):
        locator()(PRESSES[0], out)
    assert not out.any()


@pytest.mark.parametrize("make", [lambda: BODIES["L"].mesh, lambda: Cylinder(R, R), equation])
def test_a_point_that_is_nan_or_infinite_has_no_nearest_and_harms_no_other(make: Callable[[], Any]) -> None:
    surface = make()
    points = np.array([[0.0, 0, 0.1], [np.nan, 0, 0], [0, np.inf, 0], [0.1, 0, 0]])
    closest, normals, _ = surface.project(points)
    assert np.isnan(closest[1:3]).all()
    assert np.isnan(normals[1:3]).all()
    assert np.array_equal(closest[[0, 3]], surface.project(points[[0, 3]])[0])


def test_a_covariance_that_does_not_go_with_its_wrenches_is_refused() -> None:
    with pytest.raises(InputError, match=r"shape.*Write"):
        Wrench.from_vector(np.zeros((3, 6)), np.zeros((5, 6, 6)))


def test_an_identification_takes_a_wrench_as_it_takes_rows() -> None:
    rng = np.random.default_rng(0)
    turns = np.linalg.qr(rng.normal(size=(12, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    force = np.einsum("nji,j->ni", turns, [0, 0, -9.0])
    rows = np.concatenate([force, np.cross([0.01, 0.02, 0.05], force)], axis=1)
    one, two = identify_payload(rows, turns), identify_payload(Wrench.from_vector(rows), turns)
    assert np.array_equal(one.weight, two.weight)
    assert np.array_equal(one.covariance, two.covariance)
    for wrong in (rows[:, :5], rows[:11], rows[None]):
        with pytest.raises(InputError, match=r"shape.*Write"):
            identify_payload(wrong, turns)


@pytest.mark.parametrize("memory", [np.zeros(1), np.zeros(3), Locator.no_contact()[::-1]])
def test_a_memory_of_another_size_is_refused(memory: Any) -> None:
    with pytest.raises(InputError, match="memory must"):
        locator().run_into(PRESSES.copy(), None, np.full(3, -1, np.int8), np.zeros((3, 22)), memory=memory)


def test_a_touch_of_wrenches_of_another_shape_is_refused() -> None:
    statuses = np.full(20, -1, np.int8)
    with pytest.raises(InputError, match=r"wrenches must have shape \(n, 6\), not \(20, 1\)"):
        locator().first_free(np.zeros((20, 1)), None, statuses)
    with pytest.raises(InputError, match=r"wrenches must have shape \(20, 6\), not \(20, 1\)"):
        locator().follow_back(np.zeros((20, 1)), None, statuses, np.zeros((20, 22)))
    with pytest.raises(InputError, match=r"statuses must have shape \(20,\), not \(3,\)"):
        locator().follow_back(np.zeros((20, 6)), None, statuses[:3], np.zeros((20, 22)))
