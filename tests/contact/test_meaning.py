"""Where another frame, sign, point, axes or form of the pose explains the wrenches, it is named; else nothing is."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import palpate
from palpate.contact.meaning import Known, other_meaning, reversed_sign, smaller_body
from palpate.contact.plausibility import Plausibility
from palpate.signals.recording import FORCE, TORQUE, Recording
from palpate.spatial.pose import Pose

NOISE = np.array([0.02] * 3 + [4e-4] * 3)  # N, N m
FLANGE = np.array([0.0, 0.0, -0.12])  # m
MOUNT = Pose.from_translation([0.014, -0.009, 0.085])  # of the box's middle
BOX = trimesh.creation.box((0.05, 0.036, 0.07))
EGG = trimesh.creation.icosphere(3).apply_scale([0.02, 0.03, 0.05])


@pytest.fixture(scope="module")
def locator() -> palpate.Locator:
    return palpate.Locator(palpate.Mesh.from_trimesh(BOX, unit="m"), noise=NOISE)


def presses(
    seed: int, touches: int = 12, up: float = -0.5, body: trimesh.Trimesh = BOX
) -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray]:
    """Return forces and torques (n, 3) of the sensor, its rotations and positions: presses from outside, with pauses.

    Normals have at least `up` along z.

    A press leans by 0.3 at most, within the friction of 1 that is allowed; nothing presses where the box is held.
    """
    rng = np.random.default_rng(seed)
    points, facets = trimesh.sample.sample_surface(body, 400, seed=seed)
    normals = body.face_normals[facets]
    free = np.flatnonzero(normals[:, 2] > up)[:touches]
    aside = np.cross(normals[free], rng.normal(size=(len(free), 3)))
    force = rng.uniform(4, 10, (len(free), 1)) * (0.3 * aside / np.linalg.norm(aside, axis=1)[:, None] - normals[free])
    torque = np.cross(MOUNT.apply(points[free]), force)
    pressed = np.kron(np.ones(len(free)), [0.0] * 5 + [1.0] * 5)[:, None]
    wrench = pressed * np.repeat(np.hstack([force, torque]), 10, axis=0) + NOISE * rng.normal(size=(len(pressed), 6))
    position = rng.uniform(0.3, 0.6, (len(pressed), 3))
    return wrench[:, :3], wrench[:, 3:], Rotation.random(len(pressed), random_state=rng), position


@pytest.mark.parametrize("seed", range(20))
def test_nothing_is_said_of_wrenches_that_fit(locator: palpate.Locator, seed: int) -> None:
    force, torque, turns, position = presses(seed, touches=3 + seed % 10)
    known = Known(np.hstack([force, torque]), turns.as_matrix(), position)
    assert other_meaning(known, locator, MOUNT) == ""
    assert reversed_sign(known, locator, MOUNT) == smaller_body(known, locator, MOUNT) == ""


@pytest.mark.parametrize("body", [BOX, EGG])
def test_a_mesh_in_a_larger_unit_is_named(body: trimesh.Trimesh) -> None:
    """A box cannot tell by how forces lean, only by where all of them are."""
    force, torque, _, _ = presses(43, touches=24, body=body)
    larger = palpate.Locator(palpate.Mesh.from_arrays(10.0 * body.vertices, body.faces), noise=NOISE)
    said = smaller_body(Known(np.hstack([force, torque]), None, None), larger, MOUNT)
    assert "10 times smaller, as in mm where cm is stated" in said
    assert said.startswith("the forces lean" if body is EGG else "all touches are where")


def test_the_mistake_is_named_with_its_line(locator: palpate.Locator) -> None:
    force, torque, turns, position = presses(40)
    matrices, mirror = turns.as_matrix(), np.diag([-1.0, 1.0, 1.0])
    based = np.hstack([turns.apply(force), turns.apply(torque)])
    wxyz = Rotation.from_quat(turns.as_quat()[:, [3, 0, 1, 2]])
    about_base = torque + np.cross(turns.inv().apply(position), force)
    cases = {  # line -> what the rig makes of the log
        'with frame = "base":': Known(based, matrices, position),
        'with torque_frame = "base":': Known(np.hstack([force, based[:, 3:]]), matrices, position),
        'with frame = "sensor":': Known(
            np.hstack([turns.inv().apply(force), turns.inv().apply(torque)]), matrices, position, "base"
        ),
        'with reference = "base":': Known(np.hstack([force, about_base]), matrices, position),
        "reference = about [": Known(np.hstack([force, torque - np.cross(FLANGE, force)]), matrices, position),
        'axes = ["-x", "y", "z"], left_handed = true, torque_axes = ["x", "y", "z"]': Known(
            np.hstack([force @ mirror, torque]), None, None
        ),
        'axes = ["x", "y", "z"], torque_axes = ["-x", "-y", "-z"]': Known(np.hstack([force, -torque]), None, None),
        'form = "quaternion_wxyz" in [orientation]:': Known(
            np.hstack([wxyz.inv().apply(each) for each in (based[:, :3], based[:, 3:])]),
            wxyz.as_matrix(),
            position,
            "base",
        ),
    }
    for line, known in cases.items():
        assert line in other_meaning(known, locator, MOUNT)


@pytest.mark.parametrize(("stated", "meant"), [("body", "environment"), ("environment", "body")])
def test_touches_on_the_side_that_is_held_are_reactions(locator: palpate.Locator, stated: str, meant: str) -> None:
    force, torque, _, _ = presses(41, touches=4, up=0.5)
    known = Known(-np.hstack([force, torque]), None, None, acts_on=stated)
    assert f'state acts_on = "{meant}"' in reversed_sign(known, locator, MOUNT)
    assert other_meaning(known, locator, MOUNT) == ""  # the lines of force are the same


def test_two_touches_are_too_few(locator: palpate.Locator) -> None:
    force, torque, turns, position = presses(42, touches=2)
    known = Known(np.hstack([-force, -torque]), turns.as_matrix(), position)
    assert reversed_sign(known, locator, MOUNT) == other_meaning(known, locator, MOUNT) == ""


def test_a_log_without_a_load_has_no_line_of_force(locator: palpate.Locator) -> None:
    quiet = np.array([[0.02, 0.0, 0.0, 0.0, 0.01, 0.0]])  # noise, whose line passes 0.5 m away
    judge = Plausibility(locator, lambda _: (quiet, None, np.zeros(1, dtype=np.int8)), MOUNT)
    assert judge.warnings(Recording(np.zeros(1), {FORCE: quiet[:, :3], TORQUE: quiet[:, 3:]})) == []
