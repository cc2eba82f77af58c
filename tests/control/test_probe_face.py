"""A face against closed forms of an elastic foundation: round, flat, and what is none."""

import numpy as np
import pytest
import trimesh

from palpate.control.probe_face import ProbeFace
from palpate.errors import GeometryError
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh


def mesh(shape: trimesh.Trimesh) -> Mesh:
    return Mesh.from_arrays(np.asarray(shape.vertices), np.asarray(shape.faces))


def test_a_ball_answers_with_its_radius_whatever_the_stiffness() -> None:
    """R tan against R sin at 5 degrees: 0.4 %; cells of a twentieth of the patch: 2 %."""
    face = ProbeFace.of(mesh(trimesh.creation.icosphere(5, 0.03)))
    assert face.place == pytest.approx([0.0, 0.0, 0.03], abs=1e-4)
    for stiffness in (2000.0, 6000.0):
        assert face.radii(7.0, stiffness) == pytest.approx([0.03, 0.03], rel=0.02)


def test_a_flat_face_answers_with_a_third_of_its_half_width_squared_over_the_depth() -> None:
    """Flat walls press too where it leans: by less than a tenth at 5 degrees and this depth, along the long side."""
    face = ProbeFace.of(mesh(trimesh.creation.box([0.04, 0.02, 0.05])))
    for stiffness in (1500.0, 3000.0):  # a step of 5 degrees lifts neither end off
        depth = 7.0 / stiffness
        assert face.radii(7.0, stiffness)[0] == pytest.approx(0.02**2 / (3.0 * depth), rel=0.1)


def test_a_face_moves_with_its_mesh() -> None:
    """A turn and a shift leave the radii and take place and axes with them, to rounding."""
    ball = mesh(trimesh.creation.icosphere(4, 0.03))
    pose = Pose.from_rotation_vector(np.array([0.3, -1.0, 0.7]), np.array([0.01, 0.02, -0.3]))
    straight = ProbeFace.of(ball)
    turned = ProbeFace.of(ball.transformed(pose), pose.rotation[:, 2], pose.rotation[:, 0])
    assert turned.place == pytest.approx(pose.apply(straight.place), abs=1e-9)
    assert turned.axes == pytest.approx(pose.rotation, abs=1e-12)
    assert turned.radii(7.0, 2000.0) == pytest.approx(straight.radii(7.0, 2000.0), rel=1e-6)


def test_what_has_no_face_is_refused() -> None:
    ball = mesh(trimesh.creation.icosphere(2, 0.03))
    with pytest.raises(GeometryError, match="must not be parallel to its axis"):
        ProbeFace.of(ball, (0, 0, 1), (0, 0, 2))
    with pytest.raises(GeometryError, match="cell"):
        ProbeFace(np.zeros(3), np.eye(3), np.zeros((0, 7)))
