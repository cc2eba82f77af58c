"""The pose of a mesh among places of taxels: found, doubted where others fit as well, refused where it cannot be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.place_formats import read_taxel_places, write_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.registration import register_places
from palpate.setup import load_rig
from palpate.spatial.pose import Pose
from palpate.surfaces import Ellipsoid, Mesh

RNG = np.random.default_rng
MOUNT = Pose.from_rotation_vector([0.7, -1.9, 0.4], [0.4, -1.5, 2.0])
NOISE = 0.5e-3


@pytest.fixture(scope="module")
def link() -> Mesh:
    """An ellipsoid of 120 x 70 x 50 mm with one side bulged: it looks like itself from no other side."""
    mesh = Ellipsoid((0.06, 0.035, 0.025)).mesh(1_500)
    x, y, z = mesh.vertices.T
    bulged = np.column_stack([x + 0.01 * (y / 0.035) ** 2, y * (1 + 5 * x), z + 0.2 * np.abs(x) + 0.15 * y])
    return Mesh.from_arrays(bulged, mesh.faces)


def _scattered(link: Mesh, count: int, seed: int) -> TaxelPlaces:
    """Places about points of the surface, in the frame of the places."""
    rng = RNG(seed)
    middles = link.vertices[link.faces].mean(axis=1)
    rows = rng.choice(len(middles), count, replace=False, p=link.areas / link.areas.sum())
    off = NOISE * rng.normal(size=(count, 1)) * link.normals[rows]
    return TaxelPlaces(MOUNT.apply(middles[rows] + off), MOUNT.rotate(link.normals[rows]))


def test_the_pose_is_found_from_anywhere_as_well_as_said(link: Mesh) -> None:
    """Squared errors over their covariance are chi-square of six: three are from 5 to 50 in 999 of 1,000."""
    total = 0.0
    for seed in range(3):
        places = _scattered(link, 60, seed)
        bare = replace(places, normals=np.full((60, 3), np.nan)) if seed % 2 else places
        found = register_places(bare, link)
        error = (found.pose @ MOUNT.inverse()).rotation_vector()
        shift = (found.pose @ MOUNT.inverse()).translation
        xi = np.concatenate([error, shift])  # small: exp(xi) to first order
        total += float(xi @ np.linalg.solve(found.covariance, xi))
        assert 0.7 * NOISE < found.rms < 1.2 * NOISE
        assert (found.uncertain, found.others) == ((), ())
        assert found.validation.parts == 4
    assert 5.0 < total < 50.0


def test_a_rough_pose_chooses_and_what_is_free_is_named() -> None:
    """A cylinder turns about its axis, y, and slides along it as far as its ends allow."""
    mesh = Ellipsoid((0.03, 0.08, 0.03)).drawn()
    places = _scattered(mesh, 50, 1)
    turn = Pose.from_rotation_vector([0.0, 1.0, 0.0], np.zeros(3))
    rough = MOUNT @ turn @ Pose.from_rotation_vector([0.02, 0.0, 0.02], [2e-3, 0.0, 1e-3])
    found = register_places(places, mesh, initial=rough)
    assert len(found.uncertain) == 1
    assert "rotation about (0.00, 1.00, 0.00)" in found.uncertain[0]
    assert len(found.others) >= 1
    away = (rough.inverse() @ found.pose).rotation_vector()
    assert abs(away[1]) < 0.2  # the free turn stays as stated
    assert register_places(places, mesh).rms == pytest.approx(found.rms, rel=0.02)


def test_wrong_units_hands_and_too_few_places_are_refused(link: Mesh) -> None:
    places = _scattered(link, 30, 2)
    inches = Mesh.from_arrays(link.vertices * 0.0254, link.faces)
    with pytest.raises(InputError, match=r"39\.37 times as large it fits to.*Write") as problem:
        register_places(places, inches)
    assert "m for in" in str(problem.value)
    mirrored = replace(places, positions=places.positions * [1, 1, -1], normals=places.normals * [1, 1, -1])
    with pytest.raises(InputError, match=r"differ in handedness.*Change"):
        register_places(mirrored, link)
    with pytest.raises(NotIdentifiable, match="2 places cannot show"):
        register_places(_scattered(link, 2, 0), link)
    line = TaxelPlaces(np.outer(np.arange(20.0), [1e-3, 2e-3, 0]), np.full((20, 3), np.nan))
    with pytest.raises(NotIdentifiable, match="lie on one line"):
        register_places(line, link)


def test_the_command_writes_the_pose_into_the_rig(
    link: Mesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    corners = 1e3 * link.vertices
    text = "".join(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in corners)
    (tmp_path / "link.obj").write_text(text + "".join(f"f {a} {b} {c}\n" for a, b, c in link.faces + 1))
    rig = tmp_path / "rig.toml"
    rig.write_text('# mine\n[surface]\nmesh = "link.obj"\nunit = "mm"  # as drawn\n')
    write_taxel_places(tmp_path / "places.csv", _scattered(link, 60, 3))
    given = ["calibrate", "registration", f"{tmp_path}/places.csv", "--rig", f"{rig}", "-o", f"{tmp_path}/posed.toml"]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "warning" not in said
    assert "mm rms" in said
    assert "# mine" in (tmp_path / "posed.toml").read_text()
    mount = load_rig(tmp_path / "posed.toml").resolve().link.mount
    places = read_taxel_places(tmp_path / "places.csv").positions
    off = np.linalg.norm(mount.inverse().apply(places) - MOUNT.inverse().apply(places), axis=1)
    assert off.mean() < 1e-3
    assert main([*given[:3], "--rig", f"{tmp_path}/none.toml", "-o", f"{tmp_path}/x.toml"]) != 0
