"""Values and prepared objects go to other processes and back: the same to the last bit, frozen, and sharing nothing."""

import copy
import functools
import pickle
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

from palpate.contact import Contacts, Locator
from palpate.contact.events import Events
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.touch_finder import find_touches
from palpate.sensors.force_torque import ForceTorque
from palpate.signals import Payload
from palpate.spatial.pose import Pose
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Cylinder, Ellipsoid, EllipticCylinder, ImplicitSurface, Mesh, Paraboloid, Sphere, plane
from palpate.surfaces import superquadric as make_superquadric
from palpate.surfaces.bspline import BSplineSurface, open_knots
from tests.support.bodies import R

WRENCHES = np.array([[0.5, 0, -5, 1e-3, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0.2, -3, 0, 1e-3, 0]])
POSE = Pose.from_rotation_vector((0.3, -0.2, 0.1), (0.01, 0.02, 0.03))


@functools.cache
def square() -> Mesh:
    return plane((0, 0, 0.01), (0, 0, 1), 0.05)


@functools.cache
def superquadric() -> ImplicitSurface:
    return make_superquadric((R, R, 0.7 * R), (0.9, 0.8), pose=POSE, notes=("a note",))


@functools.cache
def by_hand() -> ImplicitSurface:
    """Of functions without a name to find them by."""
    radius = R
    return ImplicitSurface(
        lambda p: p[0] ** 2 + p[1] ** 2 + p[2] ** 2 - radius**2,
        lambda p: 2.0 * p,
        lambda p: 2.0 * np.eye(3),
        (-2 * R,) * 3,
        (2 * R,) * 3,
    )


def patch() -> BSplineSurface:
    u, v = np.meshgrid(np.arange(5.0), np.arange(6.0), indexing="ij")
    return BSplineSurface(open_knots(np.arange(3.0)), open_knots(np.arange(4.0)), np.stack([u, v, u * v], axis=-1))


def payload() -> Payload:
    return Payload(
        np.array([0, 0, -9.0]),
        np.ones(3),
        np.full(3, 0.01),
        np.zeros(3),
        covariance=np.eye(12),
        provenance={"log": "a.csv"},
        notes=("a note",),
    )


def events() -> Events:
    """One touch, with a feature."""
    found = Locator(square(), noise=np.ones(6), on=0.0).run(np.tile(WRENCHES[0], (40, 1)))
    return find_touches(replace(Contacts.single(np.arange(40) / 100.0, found), features={"row": np.arange(40.0)}))


VALUES: dict[str, Callable[[], Any]] = {
    "Wrench": lambda: Wrench.from_vector(WRENCHES, np.eye(6)),
    "Wrench without covariance": lambda: Wrench.from_vector(WRENCHES[0]),
    "Pose": lambda: POSE,
    "Payload": payload,
    "ForceTorque": lambda: ForceTorque(np.ones(6), limits=np.full(6, 100.0), frame="base"),
    "ContactEstimate": lambda: Locator(square(), noise=np.ones(6), on=0.0).run(WRENCHES),
    "ContactEstimate, single": lambda: Locator(square(), noise=np.ones(6), on=0.0).run(WRENCHES[0]),
    "Events": events,
    "Candidates": lambda: Locator(square()).candidates(WRENCHES[0]),
    "TrueSamples": lambda: TrueSamples(np.arange(2.0), np.ones((2, 3)), force=np.ones((2, 3)), sensor=("a", "b")),
    "TrueTouches": lambda: TrueTouches(np.zeros(2), np.ones(2), np.ones((2, 3)), ("tip", "side")),
    "Mesh": square,
    "Sphere": lambda: Sphere(R, pose=POSE),
    "Ellipsoid": lambda: Ellipsoid((R, R, 2 * R)),
    "Cylinder": lambda: Cylinder(R, 2 * R, upper=True),
    "EllipticCylinder": lambda: EllipticCylinder(R, 2 * R, R),
    "Paraboloid": lambda: Paraboloid((R, 2 * R), R),
    "superquadric": superquadric,
    "ImplicitSurface": by_hand,
    "BSplineSurface": patch,
}
WAYS: dict[str, Callable[[Any], Any]] = {
    "pickled": lambda value: pickle.loads(pickle.dumps(value)),
    "deep copy": copy.deepcopy,
    "copy": copy.copy,
}


def arrays(value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Every array in a value, and in the values in it; not what it has worked out since."""
    for name in [field.name for field in fields(value)] if is_dataclass(value) else vars(value):
        each = getattr(value, name)
        if isinstance(each, np.ndarray):
            yield name, each
        elif isinstance(each, Pose):
            yield from arrays(each)
        elif isinstance(value, Events):  # features by name, and paths
            inside = each.items() if isinstance(each, Mapping) else enumerate(each or ())
            yield from ((f"{name} {key}", array) for key, array in inside)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", VALUES)
def test_a_value_comes_back_the_same_and_frozen(name: str, way: str) -> None:
    value = VALUES[name]()
    back = WAYS[way](value)
    assert type(back) is type(value)
    before, after = dict(arrays(value)), dict(arrays(back))
    assert before.keys() == after.keys()
    for field, array in after.items():
        assert np.array_equal(array, before[field], equal_nan=True), field
        assert not array.flags.writeable, field
    for field in fields(value):
        plain = getattr(value, field.name)
        if isinstance(plain, str | tuple | int | float | Mapping | None) and field.name not in ("features", "paths"):
            assert getattr(back, field.name) == plain


@pytest.mark.parametrize("name", VALUES)
def test_values_compare_and_hash_by_identity(name: str) -> None:
    """Arrays have no truth and no hash: comparing them crashed."""
    value = VALUES[name]()
    assert value == value
    assert {value: 1}[value] == 1
    assert value != Sphere(R)


@pytest.mark.parametrize("name", ["Mesh", "Sphere", "superquadric", "ImplicitSurface"])
def test_a_surface_that_comes_back_answers_the_same(name: str) -> None:
    surface = VALUES[name]()
    back = pickle.loads(pickle.dumps(surface))
    points = np.random.default_rng(0).normal(size=(5, 3)) * R
    for one, two in zip(surface.project(points), back.project(points), strict=True):
        assert np.array_equal(one, two)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("surface", [square, superquadric])
def test_a_copied_locator_goes_on_alone_from_where_the_first_was(surface: Callable[[], Any], way: str) -> None:
    """Its hysteresis and last contact come along; what either meets afterwards is not the other's."""
    first = Locator(surface(), friction=2.0, on=2.0, off=1.0, noise=np.full(6, 1e-3))
    press, light = (np.r_[0, 0, -f, np.cross(first.surface.centre, [0, 0, -f])] for f in (5.0, 1.5))
    assert first.run(press).status == 0
    second = WAYS[way](first)
    assert second.run(light).status == 0  # a contact before: above `off` it goes on
    first.reset()
    assert second.run(light).status == 0
    assert str(first.run(light).status) == "too_light"
    one, two = first.run(press), second.run(press)
    for name, array in arrays(one):
        assert np.array_equal(array, getattr(two, name), equal_nan=True), name
    mine = [value for _, value in arrays(first) if value.flags.writeable]
    theirs = [value for _, value in arrays(second) if value.flags.writeable]
    assert not any(np.shares_memory(a, b) for a in mine for b in theirs)
    assert (second.on, second.off, second.friction, second.torsion) == (2.0, 1.0, 2.0, first.torsion)


def test_another_process_answers_the_same() -> None:
    """A fresh interpreter: what joblib and multiprocessing do."""
    locator = Locator(square(), noise=np.ones(6), on=0.0)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = pool.submit(Locator.run, locator, WRENCHES).result()
    here = locator.run(WRENCHES)
    for name, array in arrays(here):
        assert np.array_equal(array, getattr(there, name), equal_nan=True), name
