"""The elastic foundation against closed forms, against a plain twin, and its friction against Coulomb's bound."""

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation

from palpate_lab.simulation.phantom._tissue import press
from palpate_lab.simulation.phantom.probes import PROBES, probe

K = 2e6
LAW = np.array([K, 0.005, 0.3, 2 / 3 * K, 0.005])
FRICTIONLESS = np.array([K, 0.005, 0.0, 2 / 3 * K, 0.005])
DOWN = np.diag([1.0, -1.0, -1.0])


def _cells(name: str) -> np.ndarray:
    body = probe(name)
    return np.concatenate([body.points, body.normals, body.areas[:, None]], axis=1)


def _frame(rotation: np.ndarray, place: np.ndarray, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate([rotation, [place, velocity, spin]])


def _pressed(name: str, depth: float, turn: np.ndarray = DOWN, about: float = 0.0) -> np.ndarray:
    """The probe's frame, turned about a point `about` above the tip, its tip at this depth when upright."""
    pivot = np.array([0.0, 0.0, 0.150 - about])
    return _frame(turn, np.array([0.0, 0.0, about - depth]) - turn @ pivot)


STILL = _frame(np.eye(3), np.zeros(3))


def _pressing(cells, law, body, phantom=STILL, bristles=None) -> np.ndarray:
    found = np.zeros(11)
    press(cells, law, body, phantom, np.zeros((len(cells), 3)) if bristles is None else bristles, found)
    return found


def _twin(cells, law, body, phantom, bristles):
    """The same law in NumPy: matrices instead of loops."""
    k, loss, mu, shear, shear_loss = law
    seen = phantom[:3].T
    arm = cells[:, :3] @ body[:3].T  # base axes, from the sensor's origin
    place = (arm + body[3] - phantom[3]) @ seen.T
    speed = body[4] + np.cross(body[5], arm) - phantom[4] - np.cross(phantom[5], arm + body[3] - phantom[3])
    speed, normal = speed @ seen.T, cells[:, 3:6] @ body[:3].T @ seen.T
    depth, facing = -place[:, 2], -normal[:, 2]
    touching = (depth > 0) & (facing > 0)
    pressure = np.where(touching, np.maximum(k * (depth - loss * speed[:, 2]), 0.0), 0.0)
    held = np.where((bristles[:, 2:] > 0), bristles[:, :2], place[:, :2])
    spring = shear * (held - place[:, :2])
    bound = mu * pressure
    size = np.linalg.norm(spring, axis=1)
    spring *= np.where(size > bound, bound / np.where(size > 0, size, 1.0), 1.0)[:, None]
    held = place[:, :2] + spring / shear
    drag = spring - shear * shear_loss * speed[:, :2]
    size = np.linalg.norm(drag, axis=1)
    drag *= np.where(size > bound, bound / np.where(size > 0, size, 1.0), 1.0)[:, None]
    force = np.column_stack([drag, pressure]) * np.where(touching, facing * cells[:, 6], 0.0)[:, None] @ phantom[:3].T
    push = force @ phantom[:3, 2]
    centre = push @ cells[:, :3] / push.sum()
    wrench = np.concatenate([force.sum(axis=0), np.cross(arm, force).sum(axis=0)])
    return np.concatenate([wrench, [push.sum()], centre, [depth[touching].max()]]), touching, held


def test_the_compiled_loop_is_the_plain_law() -> None:
    """Both frames turned and moving, cells of which some slip and some hold."""
    rng, cells = np.random.default_rng(2), _cells("convex")
    bristles = np.zeros((len(cells), 3))
    base = Rotation.from_rotvec([0.4, -0.3, 0.8])
    for _ in range(3):
        phantom = _frame(base.as_matrix(), rng.normal(size=3), rng.normal(size=3) * 0.05, rng.normal(size=3) * 0.3)
        turn = base * Rotation.from_rotvec(rng.normal(size=3) * 0.1) * Rotation.from_matrix(DOWN)
        tip = phantom[3] + base.apply([*rng.normal(size=2) * 1e-3, -0.006])
        place = tip - turn.apply([0.0, 0.0, 0.150])
        body = _frame(turn.as_matrix(), place, phantom[4] + rng.normal(size=3) * 0.01, rng.normal(size=3) * 0.3)
        expected, touching, held = _twin(cells, LAW, body, phantom, bristles)
        np.testing.assert_allclose(_pressing(cells, LAW, body, phantom, bristles), expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(bristles[:, 2] > 0, touching)
        np.testing.assert_allclose(bristles[touching, :2], held[touching], atol=1e-12)


def test_a_sphere_presses_with_k_times_the_volume_of_its_cap() -> None:
    """F = k pi d^2 (R - d/3), for any shape k times the volume below the surface; 0.1 % for 200 x 200 cells."""
    radius, depth = 0.050, 0.004
    polar, around = np.meshgrid((np.arange(200) + 0.5) * 0.5 / 200, (np.arange(200) + 0.5) * 2 * np.pi / 200)
    normal = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    normal = normal.reshape(-1, 3)
    area = (radius**2 * np.sin(polar) * (0.5 / 200) * (2 * np.pi / 200)).reshape(-1, 1)
    cells = np.concatenate([radius * normal + [0.0, 0.0, 0.150 - radius], normal, area], axis=1)
    found = _pressing(cells, LAW, _pressed("", depth))
    np.testing.assert_allclose(found[2], K * np.pi * depth**2 * (radius - depth / 3), rtol=1e-3)
    np.testing.assert_allclose(found[10], depth, rtol=1e-3)
    moment = np.cross([0.0, 0.0, -0.150], found[:3])
    np.testing.assert_allclose(found[3:6], moment, atol=1e-9)


def test_a_flat_punch_presses_with_k_a_d() -> None:
    """Of the whole outline once the round edges are below the surface, less what the edges' rounding leaves out."""
    shape, depth, r = PROBES["linear"], 0.005, PROBES["linear"].edge
    outline = shape.length * shape.width - (4 - np.pi) * r**2
    core_edge = 2 * (shape.length + shape.width - 4 * r)
    # what a quarter round of radius r leaves out of a square edge, along the sides; round the corners by Pappus
    left_out = (1 - np.pi / 4) * r**2 * core_edge + np.pi * r**3 - 2 / 3 * np.pi * r**3
    found = _pressing(_cells("linear"), LAW, _pressed("linear", depth))
    np.testing.assert_allclose(found[6], K * (outline * depth - left_out), rtol=2e-3)


def test_the_torus_presses_with_k_times_its_volume() -> None:
    """Before the patch meets the edges: drop R - sqrt((R - r + sqrt(r^2 - y^2))^2 - x^2), integrated."""
    big, small, depth = 0.060, 0.018, 0.003

    def below(x: float, y: float) -> float:
        return max(depth - big + np.sqrt((big - small + np.sqrt(small**2 - y**2)) ** 2 - x**2), 0.0)

    volume, _ = dblquad(below, -0.0105, 0.0105, -0.02, 0.02, epsabs=1e-12)
    found = _pressing(_cells("convex"), LAW, _pressed("convex", depth))
    np.testing.assert_allclose(found[6], K * volume, rtol=3e-3)
    np.testing.assert_allclose(K * volume, np.pi * K * np.sqrt(big * small) * depth**2, rtol=0.05)  # small depths


@pytest.mark.parametrize(("axis", "radius"), [("y", 0.060), ("x", 0.018)])
def test_rolling_on_the_torus_hardly_ripples(axis: str, radius: float) -> None:
    """Turned about its centre of curvature the face stays where it is: the force may change by the cells alone.

    3 mm deep, up to 2 deg, the patch is inside the face; below 0.5 % of the force.
    """
    cells, forces = _cells("convex"), []
    for angle in np.radians(np.linspace(-2.0, 2.0, 81) if axis == "y" else np.linspace(-1.0, 1.0, 81)):
        turn = Rotation.from_euler(axis, angle).as_matrix() @ DOWN
        forces.append(_pressing(cells, FRICTIONLESS, _pressed("convex", 0.0025, turn, radius))[6])
    assert np.ptp(forces) / np.mean(forces) < 5e-3


def test_the_force_keeps_below_friction_and_saturates_at_it() -> None:
    """Slid along: the tangential force rises and stops at mu times the normal force, never above."""
    cells = _cells("convex")
    bristles, ratios = np.zeros((len(cells), 3)), []
    for slide in np.linspace(0.0, 0.006, 61):
        body = _pressed("convex", 0.004)
        body[3, 0] += slide
        found = _pressing(cells, LAW, body, STILL, bristles)
        ratios.append(-found[0] / found[2])
    assert np.all(np.diff(ratios) > -1e-12)
    assert max(ratios) <= 0.3 + 1e-12
    np.testing.assert_allclose(ratios[-1], 0.3, rtol=1e-6)
    lower = (cells[:, 2] > 0.150 - 0.004) & (cells[:, 5] > 0)
    held = 2 / 3 * K * 1e-4 * (cells[lower, 5] @ cells[lower, 6]) / found[2]  # 0.1 mm on, were every cell held
    assert 0.9 * held < ratios[1] < held  # those of the rim, less than 0.22 mm deep, slip


def test_the_phantom_that_moves_is_the_probe_that_moves_back() -> None:
    """Only relative motion counts: carrying both along changes nothing but the frame of the answer."""
    cells = _cells("t-shaped")
    body = _pressed("t-shaped", 0.003)
    body[4], body[5] = (0.01, -0.02, -0.03), (0.1, 0.2, -0.1)
    carried = Rotation.from_rotvec([0.5, -0.2, 0.3]).as_matrix()
    shift, v, w = np.array([0.3, -0.1, 0.2]), np.array([0.1, 0.2, -0.3]), np.array([0.4, -0.5, 0.6])

    def moved(frame: np.ndarray) -> np.ndarray:
        place = carried @ frame[3]
        return _frame(
            carried @ frame[:3], place + shift, carried @ frame[4] + v + np.cross(w, place), carried @ frame[5] + w
        )

    here, there = _pressing(cells, LAW, body), _pressing(cells, LAW, moved(body), moved(STILL))
    np.testing.assert_allclose(there[:3], carried @ here[:3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(there[3:6], carried @ here[3:6], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(there[6:], here[6:], rtol=1e-9, atol=1e-12)


def test_tissue_pushes_and_never_pulls() -> None:
    """Away at 1 m/s the loss would make the pressure negative."""
    body = _pressed("linear", 0.002)
    body[4, 2] = 1.0
    np.testing.assert_array_equal(_pressing(_cells("linear"), LAW, body)[:7], 0.0)
    body[4, 2] = -0.1
    deeper = _pressing(_cells("linear"), LAW, body)[6]
    body[4, 2] = 0.0
    assert deeper > _pressing(_cells("linear"), LAW, body)[6]
