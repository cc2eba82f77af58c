"""Mesh files: the formats, the units, and what is said to a file that is none."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.errors import GeometryError, InputError, PalpateError
from palpate.surfaces import Mesh, Sphere
from palpate.surfaces._load import _load_trimesh, arrays_of, load_arrays
from palpate.surfaces.surface import as_surface
from tests.support.bodies import R, box


def write(path: Path, scale: float = 1e3, kind: str | None = None) -> Path:
    """The box of the table, in millimetres unless said otherwise, by trimesh: not by the code under test."""
    vertices, faces = box()
    trimesh.Trimesh(vertices * scale, faces, process=False).export(path, file_type=kind)
    return path


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "dae", "STL", "stl_ascii"])
def test_formats_are_read_in_the_declared_unit(tmp_path: Path, kind: str) -> None:
    """The path may be a string."""
    mesh = Mesh.load(str(write(tmp_path / f"box.{kind[:3]}", kind=kind.lower())), unit="mm")
    assert len(mesh.faces) == 12
    assert len(mesh.vertices) == 8  # STL's soup is merged
    corner = np.array([R, 0.5 * R, 0.7 * R] if kind == "dae" else [R, 0.7 * R, 0.5 * R])  # trimesh writes Y_UP
    assert np.allclose(mesh.bounds, [-corner, corner], rtol=1e-6, atol=0)  # float32
    assert mesh.notes == (("the file states Y_UP: the mesh is turned so that z points up",) if kind == "dae" else ())


def test_bytes_stl_is_read_as_by_trimesh_to_the_last_bit(tmp_path: Path) -> None:
    """Whatever its numbers are: random bytes hold NaN, infinities and numbers without a normal form."""
    bits = np.random.default_rng(8).integers(0, 256, (400, 50), dtype=np.uint8)
    for facets in (bits, np.frombuffer(write(tmp_path / "box.stl").read_bytes()[84:], np.uint8).reshape(-1, 50)):
        path = tmp_path / "any.stl"
        path.write_bytes(bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes())
        for ours, theirs in zip(load_arrays(path), arrays_of(_load_trimesh(path), ""), strict=True):
            assert ours.tobytes() == theirs.tobytes()
            assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)


def test_every_body_of_a_file_is_read(tmp_path: Path) -> None:
    vertices, faces = box()
    scene = trimesh.Scene([trimesh.Trimesh(vertices * 1e3 + offset, faces, process=False) for offset in (0, 100)])
    scene.export(tmp_path / "two.obj")
    assert len(Mesh.load(tmp_path / "two.obj", unit="mm").faces) == 24
    assert Mesh.load(tmp_path / "two.obj", unit="mm", smooth=False).crease == 0.0


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 1e2), ("mm", 1e3), ("um", 1e6), ("in", 1 / 0.0254)])
def test_units_give_the_same_body(tmp_path: Path, unit: str, scale: float) -> None:
    mesh = Mesh.load(write(tmp_path / "box.ply", scale), unit=unit)
    assert mesh.size == pytest.approx(R * np.sqrt(4 + 1.96 + 1), rel=1e-6)
    assert mesh.notes == ()


def test_a_region_is_in_metres_whatever_the_unit(tmp_path: Path) -> None:
    path = write(tmp_path / "box.stl")
    upper = Mesh.load(path, unit="mm", region=((-1, -1, 0.4 * R), (1, 1, R)))
    assert len(upper.faces) == 2
    with pytest.raises(GeometryError, match=r"box.stl: no facet is in the region"):
        Mesh.load(path, unit="mm", region=((-1, -1, 0.9), (1, 1, 2)))


SPOILT = {  # name -> content, or what is cut off a good file
    "text garbage.stl": b"this is not a mesh\n" * 5,
    "bytes garbage.stl": bytes(range(256)) * 3,
    "cut in a facet.stl": slice(300),
    "cut in the header.stl": slice(40),
    **{f"empty.{kind}": b"" for kind in ("stl", "obj", "ply", "dae")},
    "garbage.obj": b"f 1 2\nhello\nv a b c\n",
    "garbage.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nend_header\n1 2\n",
    "garbage.dae": b"<collada><unfinished>",
    "points only.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_file_that_is_no_mesh_is_named_in_a_sentence(tmp_path: Path, name: str) -> None:
    path, content = tmp_path / name, SPOILT[name]
    path.write_bytes(write(tmp_path / "good.stl").read_bytes()[content] if isinstance(content, slice) else content)
    with pytest.raises(PalpateError) as caught:
        Mesh.load(path, unit="mm")
    said = str(caught.value)
    assert name in said
    assert said.endswith((".", "facets", "area"))
    assert "Traceback" not in said
    assert "\n" not in said


def test_a_missing_file_an_unknown_suffix_and_an_unknown_unit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"stl: the mesh file does not exist"):
        Mesh.load(tmp_path / "nowhere.stl")
    (tmp_path / "mesh.xyz123").write_bytes(b"1 2 3")
    with pytest.raises(InputError, match=r"is of type '.xyz123'.*Use STL"):
        Mesh.load(tmp_path / "mesh.xyz123")
    (tmp_path / "mesh").write_bytes(b"1 2 3")
    with pytest.raises(InputError, match=r"cannot be read as a mesh.*Use"):
        Mesh.load(tmp_path / "mesh")
    with pytest.raises(InputError, match=r"unknown unit 'feet'.*another of m, cm"):
        Mesh.load(write(tmp_path / "box.stl"), unit="feet")


def test_the_unit_must_be_said_and_the_error_says_which_there_are(tmp_path: Path) -> None:
    path = write(tmp_path / "box.stl")
    with pytest.raises(InputError, match=r"box\.stl: the unit .* is not given .*another of m, cm, mm, um, in"):
        Mesh.load(path)
    with pytest.raises(InputError, match=r"Trimesh: the unit .* is not given.*Write"):
        Mesh.from_trimesh(trimesh.creation.box())


def test_a_trimesh_is_a_mesh_in_its_unit() -> None:
    """A box of trimesh's own, and two of them in a scene, turned and moved there."""
    made = trimesh.creation.box(extents=(20.0, 14.0, 10.0))
    mesh = Mesh.from_trimesh(made, "mm", crease=0.5)
    assert np.allclose(mesh.bounds, [[-0.01, -0.007, -0.005], [0.01, 0.007, 0.005]], rtol=0, atol=1e-15)
    assert mesh.crease == 0.5
    scene = trimesh.Scene()
    for shift in (0.0, 50.0):
        scene.add_geometry(made, transform=trimesh.transformations.translation_matrix([0, 0, shift]))
    assert np.allclose(Mesh.from_trimesh(scene, "mm").bounds[1], [0.01, 0.007, 0.055], rtol=0, atol=1e-15)
    assert any("check the unit" in note for note in Mesh.from_trimesh(made, "m").notes)


@pytest.mark.parametrize("wrong", [None, np.zeros((3, 3)), "box.stl"])
def test_what_is_no_trimesh_is_refused(wrong: object) -> None:
    with pytest.raises(InputError, match=r"trimesh\.Trimesh.*Write"):
        Mesh.from_trimesh(wrong, "mm")


def test_what_is_given_is_a_surface_a_mesh_or_refused(tmp_path: Path) -> None:
    sphere, path = Sphere(R), write(tmp_path / "box.stl")
    assert as_surface(sphere) is sphere
    for given in (path, str(path), trimesh.load_mesh(path)):
        found = as_surface(given, "mm")
        assert np.allclose(found.drawn().bounds, Mesh.load(path, unit="mm").bounds, rtol=1e-6, atol=0)
    with pytest.raises(InputError, match=r"a dict is not a surface.*Write palpate\.Mesh\.load"):
        as_surface({})
    with pytest.raises(InputError, match=r"unit='mm' is only for a mesh file.*Leave unit out"):
        as_surface(sphere, "mm")
