"""The reproduction of `probe`'s moving phantom: one short run, how runs are judged, and the page that is written."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from claims.papers.moving_phantom.conditions import STEP, Sizes, sections, sine
from claims.papers.moving_phantom.controllers import Iterative
from claims.papers.moving_phantom.rows import FOLDER, figures_of, parts
from claims.papers.moving_phantom.study import COLUMNS, Condition, Found, Trace, traces
from claims.row import expected
from palpate.contact import Locator, WrenchEstimator
from palpate.contact.estimate import ROW
from palpate.sensors.force_torque.model import ForceTorque
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.phantom.probes import probe
from tests.support.templates import places


def made_up(condition: Condition, error: float = 0.5, force: float = 7.2) -> Trace:
    """Error [deg] and force [N] that stay the same but for the first second."""
    times = np.arange(0.0, condition.until, 0.005)
    values = np.zeros((len(times), len(COLUMNS)))
    values[:, 0], values[:, 4] = times, force
    values[:, 1:4] = np.radians(error)
    early = np.abs(times - condition.settings.motion.begin - 0.5) < 0.4
    values[early, 1:4], values[early, 4] = np.radians(3.0), 9.0
    states = ((0.0, "approach", ""), (1.2, "contact", ""), (2.0, "hold", ""))
    return Trace(condition, values, states, (1e-4, 2e-4), 3e-5)


def test_a_short_run_holds_force_and_angle() -> None:
    """1.5 s of the sine of 5 s: means are below half a degree and forces 0.1 N off; thrice that is allowed."""
    found = traces([sine("short", "in-plane", 5, judged=0.5, begin=2.2)], 1)["short"]
    (trace,) = found.traces
    assert trace.held
    assert found.lost == 0
    assert found.mean < 1.5
    assert found.off() < 0.4
    assert np.degrees(np.ptp(trace.column("probe"))) > 8.0  # it followed the phantom
    np.testing.assert_allclose(  # a turn of the surface less that of the probe is the error
        np.degrees(trace.column("surface") - trace.column("probe"))[trace.steady], trace.error[trace.steady], atol=0.1
    )


def test_less_noise_does_not_make_the_loop_swing() -> None:
    """A hundredth of it: a filter that believed its readings would turn faster than the loop's delay and oscillate."""
    noise = {"force_noise": 4e-4, "torque_noise": 1.5e-5}
    found = traces([sine("quiet", "out-of-plane", 5, judged=0.5, begin=2.2, lab=noise)], 1)["quiet"]
    assert found.lost == 0
    assert found.mean < 0.8  # what noise leaves at most of the usual one is asked to be below 1.1
    assert found.off() < 0.2


def test_the_first_second_is_judged_apart() -> None:
    found = Found([made_up(sine("one", "in-plane", 10)), made_up(sine("one", "in-plane", 10), 0.7, 7.3)])
    assert found.mean == pytest.approx(0.6)
    assert found.off() == pytest.approx(0.3)
    assert found.off(0.0, 1.0) == pytest.approx(2.0)
    assert found.lost == 0


def test_losses_and_settling_are_counted() -> None:
    whole = made_up(sine("one", "in-plane", 10), 0.5)
    gone = whole.values.copy()
    gone[1500:1510, 4] = 0.0
    assert replace(whole, values=gone).lost == 1
    assert replace(whole, states=(*whole.states, (7.0, "lost", ""))).lost == 1
    late = whole.values.copy()
    late[np.abs(whole.since - STEP - 0.1) < 0.2, 1] = np.radians(4.0)
    assert replace(whole, values=late).settled(STEP) == pytest.approx(0.3, abs=0.006)
    assert replace(whole, values=late).settled(STEP, 0.2) == pytest.approx(0.3, abs=0.11)
    late[:, 1] = np.radians(4.0)
    assert replace(whole, values=late).settled(STEP) == np.inf


def test_the_iteration_finds_a_point_near_the_middle() -> None:
    """A frictionless 7 N at a point of the face: the paraboloid is within 0.2 mm of it there."""
    shape = probe("convex")
    mesh = Mesh.from_arrays(shape.vertices, shape.faces)
    estimator = Iterative(WrenchEstimator(Locator(mesh), ForceTorque()), shape.tip)
    near = np.argmin(np.linalg.norm(shape.points - shape.tip - (0.004, 0.002, 0.0), axis=1))
    point, force = shape.points[near], -7.0 * shape.normals[near]
    row = estimator.empty(1)[0]
    estimator.update_into(0.0, np.concatenate([force, np.cross(point, force)]), row)
    np.testing.assert_allclose(row[ROW.point], point, atol=4e-4)
    np.testing.assert_allclose(row[ROW.force], force, atol=1e-9)


def test_a_run_fills_the_page() -> None:
    found = dict[str, Found]()
    for condition in sections(Sizes(1, 1)):
        found[condition.name] = Found([made_up(condition)])
    got = figures_of(found)
    assert got["ours_in-plane_10"] == pytest.approx(0.5)
    assert got["robust"] == pytest.approx(1.0)
    assert got["unplanned_settled"] == 0.0
    assert all(len(row.theirs) == 2 for row in expected(FOLDER, got, "paper", "human"))
    made = parts(found)
    assert {*made, "took", "runs"} == places(FOLDER)
    assert "soft finger, here" in str(made["two"])
