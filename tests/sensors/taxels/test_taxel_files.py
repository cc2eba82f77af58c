"""Files of where taxels sit: what is written is read back, real files are understood, others are refused."""

import os
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.urdf import Urdf
from palpate.sensors.taxels.place_formats import holds_taxels, read_taxel_places, write_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.files import holds_pokes, read_pokes
from palpate.sensors.taxels.section import SkinSection
from palpate.setup import load_rig

SHARED = Path(os.environ.get("PALPATE_SHARED", "../shared"))
ICUB = SHARED / "data" / "icub"


def _places() -> TaxelPlaces:
    """Two modules of twelve with a pad each, one taxel on none, and a module that is not there."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(37, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    positions, module = 0.04 * normals, np.repeat([0, -1, 1, -1], [12, 12, 12, 1])
    gone = [6, *range(12, 24), 30]
    positions[gone], normals[gone], module[gone] = np.nan, np.nan, -1
    return TaxelPlaces(positions, normals, module=module)


@pytest.mark.parametrize(("suffix", "tolerance"), [(".toml", 0.0), (".csv", 1e-15), (".txt", 1e-9), (".urdf", 1e-8)])
def test_what_is_written_is_read_back(tmp_path: Path, suffix: str, tolerance: float) -> None:
    """To the digits that the file keeps: nine behind the point of iCub's, nine in all of a URDF's."""
    places, path = _places(), tmp_path / f"skin{suffix}"
    write_taxel_places(path, places)
    found = read_taxel_places(path)
    np.testing.assert_allclose(found.positions, places.positions, atol=tolerance, rtol=0)
    np.testing.assert_allclose(found.normals, places.normals, atol=tolerance, rtol=0)
    np.testing.assert_array_equal(found.module, places.module)
    assert suffix == ".toml" or holds_taxels(path)


def test_icubs_bare_rows_are_modules_of_twelve(tmp_path: Path) -> None:
    places, path = _places(), tmp_path / "skin.txt"
    write_taxel_places(path, places, name="")
    found = read_taxel_places(path)
    np.testing.assert_allclose(found.positions, places.positions, atol=1e-9)
    assert found.module.tolist()[:6] == [0] * 6
    assert found.module[36] == 2  # alone in the fourth block, the third that is there


def test_frames_of_a_urdf_hang_below_the_link(tmp_path: Path) -> None:
    """Put into a robot, its fixed joints give back position and normal."""
    places, path = _places(), tmp_path / "skin.urdf"
    write_taxel_places(path, places, name="arm")
    robot = f'<robot name="r"><link name="forearm"/>{path.read_text().replace("LINK", "forearm")}</robot>'
    (tmp_path / "robot.urdf").write_text(robot)
    tree = Urdf(tmp_path / "robot.urdf").fixed()
    quaternion, position = tree.path("forearm", "arm_module_1_taxel_25").at(np.zeros(1))
    x, y, z, w = quaternion[0]
    np.testing.assert_allclose(position[0], places.positions[25], atol=1e-8)
    outward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    np.testing.assert_allclose(outward, places.normals[25], atol=1e-7)


@pytest.mark.parametrize(
    ("text", "x"), [("x [mm],y [mm],z [mm]\n30,1,2\n31,2,3\n", 0.03), ("x;y;z\n0,03;0,1;0\n0,04;0,1;0\n", 0.03)]
)
def test_tables_state_their_unit(tmp_path: Path, text: str, x: float) -> None:
    (tmp_path / "t.csv").write_text(text)
    found = read_taxel_places(tmp_path / "t.csv")
    assert found.positions[0, 0] == pytest.approx(x)
    assert np.isnan(found.normals).all()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "[calibration]\n0 0 0 0 0\n", "line 2: must be six numbers, x y z nx ny nz"),
        ("a.txt", "name s\ntaxel2Repr (0 1)\n[calibration]\n1 0 0 0 0 0\n1 0 0 0 0 1\n1 1 1 0 0 0\n", "3 rows of tax"),
        ("a.txt", "[calibration]\n0 0 0 0 0 0\n", "txt: has no taxels"),
        ("a.csv", "x,y,z\n30,1,2\n310,2,3\n", "up to 280 m from each other.*mm"),
        ("a.csv", "x,y\n1,2\n", "has no places of taxels.*Give"),
        ("a.csv", "x [mm],y [m],z\n1,2,3\n", "x, y, z must be in one known unit, not in mm, m, m.*Write"),
        ("a.csv", "x,y,z,module\n1,2,3,0.5\n", ": module must be a whole number"),
        ("a.urdf", "<robot/>", "no frames of taxels.*Name"),
        ("a.toml", 'kind = "taxels"\ntaxels = [[1.0]]', "toml: taxels must be 1 x 15 numbers"),
        ("a.toml", f'kind = "taxels"\ntaxels = [[{", ".join(["0.0"] * 6)}, 0.5, 1, nan, nan, nan, nan, nan, nan, nan]]',
         "toml: .*whole numbers"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        read_taxel_places(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "taxels", "modules", "normals"),
    [
        ("pos_right_forearm_lower_mesh.txt", 84, 7, False),
        ("right_forearm_mesh.txt", 276, 23, True),
        ("right_forearm_nomesh.txt", 275, 23, False),
        ("right_forearm_cad.txt", 240, 24, False),  # one normal stands for all
    ],
)
def test_real_files_are_understood(tmp_path: Path, name: str, taxels: int, modules: int, normals: bool) -> None:
    """Counts by hand from the files; each is written and read back."""
    if not ICUB.exists():
        pytest.skip("no shared data")
    found = read_taxel_places(ICUB / name)
    assert holds_taxels(ICUB / name)
    assert np.count_nonzero(found.there) == taxels
    assert found.modules == modules
    assert np.isfinite(found.normals[found.there]).all() == normals
    for suffix in (".toml", ".txt", ".csv"):
        write_taxel_places(tmp_path / f"a{suffix}", found)
        again = read_taxel_places(tmp_path / f"a{suffix}")
        np.testing.assert_allclose(again.positions, found.positions, atol=1e-9)
        np.testing.assert_array_equal(again.module, found.module)


def test_logs_are_no_places_of_taxels(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    for text in ("time,x,y,z\n0,1,2,3\n", "1 2 3 4 5 6\n" * 12, "fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n"):
        log.write_text(text)
        assert not holds_taxels(log)


RIG = "[surface]\nkind = 'sphere'\nradius = 0.04\n[skin]\ntaxels = 'skin.txt'\nbits = 0\n"


def test_a_body_leaves_out_numbers_without_a_taxel_and_takes_normals_from_the_surface(tmp_path: Path) -> None:
    places = _places()
    bare = TaxelPlaces(places.positions, np.full_like(places.normals, np.nan), module=places.module)
    write_taxel_places(tmp_path / "skin.txt", bare)
    (tmp_path / "rig.toml").write_text(RIG + "masked = [7, 25]\n")
    body = load_rig(tmp_path / "rig.toml").resolve().of(SkinSection).body
    assert (len(body), body.frame) == (23, 37)
    np.testing.assert_allclose(body.normals, places.normals[places.there], atol=1e-7)
    assert [body.name(k) for k in np.flatnonzero(~body.usable).tolist()] == ["7", "25"]
    frame = np.arange(37.0)
    np.testing.assert_array_equal(body.picked(frame), np.flatnonzero(places.there))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[skin]\nmap = 'a.toml'\ntaxels = 'b.txt'\n", "skin: .*exclude each other"),
        ("[skin]\ntaxels = 'skin.txt'\n", "the normals of 23 of 23 taxels.*mesh"),
        ("[skin]\ncount = 84\n", "the number of taxels, but not their places.*Run"),
        ("[skin]\ntaxels = 'skin.txt'\ncount = 5\n", "txt: has 37 taxels, but count = 5"),
        ("[skin]\ntaxels = 'skin.txt'\nmasked = [[1, 2]]\n", "skin: .*numbers of taxels"),
        (RIG + "masked = [99]\n", "taxels: masked taxel 99 does not exist: there are 37"),
    ],
)
def test_what_is_wrong_with_a_rig_of_taxels_is_said(tmp_path: Path, text: str, said: str) -> None:
    places = _places()
    bare = TaxelPlaces(places.positions, np.full_like(places.normals, np.nan))
    write_taxel_places(tmp_path / "skin.txt", bare)
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        _ = load_rig(tmp_path / "rig.toml").resolve().of(SkinSection).body


def test_priors_of_a_rig_are_in_degrees_and_may_be_infinite(tmp_path: Path) -> None:
    text = "[skin]\ncount = 84\n[pokes.priors]\nframe_angle = 2.0\nstart = inf\n"
    (tmp_path / "rig.toml").write_text(text)
    pokes = load_rig(tmp_path / "rig.toml").pokes
    assert pokes is not None
    assert pokes.priors.stated() == {"frame_angle": pytest.approx(np.radians(2.0)), "start": np.inf}


HEAD = "configuration,fx [mN],fy [mN],fz [mN],tx,ty,tz,qx,qy,qz,qw,x [mm],y [mm],z [mm],t0,t1,weight"


def test_a_table_of_pokes_is_read_in_its_units(tmp_path: Path) -> None:
    path = tmp_path / "pokes.csv"
    rows = ("7,1000,0,0,0,0,1,0,0,0,1,10,0,0,3,0,1", "2,0,2000,0,0,0,1,0,0,0.7071068,0.7071068,0,0,5,0.5,4,0")
    path.write_text("\n".join([HEAD, *rows]))
    pokes = read_pokes(path, threshold=1.0)
    assert holds_pokes(HEAD.split(","))
    np.testing.assert_allclose(pokes.wrench[:, :3], [[1, 0, 0], [0, 2, 0]])
    np.testing.assert_allclose(pokes.origin, [[0.01, 0, 0], [0, 0, 0.005]])
    np.testing.assert_allclose(pokes.rotation[1], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert pokes.configuration.tolist() == [1, 0]
    assert (pokes.taxel.tolist(), pokes.weight.tolist()) == ([0, 1], [1.0, 0.0])
    path.write_text("\n".join([HEAD, rows[0].replace("0,0,0,1,10", "0,0,0,3,10")]))
    with pytest.raises(InputError, match=r"line 2.*must have length 1"):
        read_pokes(path)
