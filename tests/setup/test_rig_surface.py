"""Surfaces by their lengths in a rig."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.errors import InputError
from palpate.setup.rig import check_rig, with_mesh
from palpate.surfaces import Cylinder, Ellipsoid, EllipticCylinder, ImplicitSurface, Paraboloid, Sphere

RIG = Path("rig.toml")


@pytest.mark.parametrize(
    ("table", "kind"),
    [
        ({"kind": "sphere", "radius": 0.01}, Sphere),
        ({"kind": "ellipsoid", "axes": [0.01, 0.02, 0.03]}, Ellipsoid),
        ({"kind": "cylinder", "radius": 0.01, "half_length": 0.02}, Cylinder),
        ({"kind": "elliptic_cylinder", "a": 0.014, "b": 0.005, "half_length": 0.016, "upper": True}, EllipticCylinder),
        ({"kind": "paraboloid", "radii": [0.06, 0.01], "height": 0.004}, Paraboloid),
        ({"kind": "superquadric", "axes": [0.01, 0.01, 0.01], "exponents": [0.9, 0.9]}, ImplicitSurface),
    ],
)
def test_every_kind_is_built_from_its_lengths(table: dict[str, object], kind: type) -> None:
    surface = check_rig({"surface": table}, RIG).resolve().link.surface()
    assert isinstance(surface, kind)
    assert np.allclose(surface.drawn().size, surface.size, rtol=0.01)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"kind": "sphere"}, "surface: radius is missing"),
        ({"kind": "sphere", "radius": -1.0}, "surface: radius must be positive"),
        ({"kind": "elliptic_cylinder", "a": 0.014, "half_length": 0.016}, "surface: b is missing"),
        ({"kind": "ellipsoid", "axes": [0.01, 0.0, 0.01]}, "surface: axes must be positive"),
        ({"kind": "ellipsoid", "axes": [0.01, 0.01]}, "axes"),
        ({"kind": "sphere", "radius": 0.01, "height": 0.02}, "surface: height does not belong to kind = 'sphere'"),
        ({"kind": "cylinder", "radius": 0.01, "half_length": 0.02, "mesh": "a.stl"}, "surface: mesh does not belong"),
        ({"kind": "mesh", "mesh": "a.stl", "unit": "mm", "radius": 0.01}, "surface: radius does not belong"),
        ({"kind": "sphere", "radius": 0.01, "covered": True}, "surface: covered does not belong"),
        ({"kind": "ball", "radius": 0.01}, "surface: kind must be one of mesh, plane, sphere"),
    ],
)
def test_what_is_missing_or_wrong_is_named(table: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_rig({"surface": table}, RIG)


def test_what_is_covered_is_used_where_the_rig_says_so(tmp_path: Path) -> None:
    trimesh.util.concatenate([trimesh.creation.icosphere(2, radius) for radius in (10, 8)]).export(tmp_path / "two.stl")
    for said, count in (({}, 320), ({"covered": False}, 320), ({"covered": True}, 0)):
        rig = check_rig({"surface": {"mesh": "two.stl", "unit": "mm", **said}}, tmp_path / "rig.toml")
        assert rig.resolve().link.surface().covered.sum() == count


def test_lengths_that_are_no_metres_are_doubted() -> None:
    notes = check_rig({"surface": {"kind": "sphere", "radius": 10.0}}, RIG).resolve().link.surface().notes
    assert "check that its lengths are in metres" in notes[0]
    assert not check_rig({"surface": {"kind": "sphere", "radius": 0.01}}, RIG).resolve().link.surface().notes


def test_a_mesh_takes_the_place_of_an_equation_and_keeps_its_pose() -> None:
    table = {"kind": "sphere", "radius": 0.01, "pose": {"xyz": [0.0, 0.0, 0.1]}}
    surface = with_mesh(check_rig({"surface": table}, RIG), "probe.stl", "mm").surface
    assert (surface.kind, surface.unit, surface.radius, surface.pose.xyz) == ("mesh", "mm", None, (0.0, 0.0, 0.1))
