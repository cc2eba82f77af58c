"""Models as TOML: the same to the last bit when read back, refused by name when they are something else."""

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from palpate.contact.indentation import Indentation
from palpate.control.servo import Servo
from palpate.errors import InputError
from palpate.files.models import MODELS, load_toml, provenance, read_model, write_model
from palpate.files.models.provenance import read_provenance, write_provenance
from palpate.files.schema import covariance_matrix
from palpate.optical.fisheye import Fisheye, RingView
from palpate.optical.markers import MarkerColour
from palpate.optical.ring_response import RingResponse
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.response import TaxelResponse
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.signals.payload import Payload
from palpate.spatial.pose import Pose
from palpate.surfaces.bspline import BSplineSurface, open_knots
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from tests.conformance.ball import BallGain


def _payload(seed: int) -> Payload:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(12, 12)) * 1e-5
    weight, force_bias, center, torque_bias = rng.normal(size=(4, 3)) * np.array([10.0, 1e-3, 1e-20, 1e5])[:, None]
    return Payload(
        weight,
        force_bias,
        center,
        torque_bias,
        covariance=root @ root.T,
        magnitude=9.81,
        residual=np.abs(rng.normal(size=2)),
        samples=7,
        provenance={"palpate": "0.1.0", "log": 'a "quoted" name \\ sha256:00'},
        notes=("two samples were set aside", "ünïcode"),
    )


def _load_cells(seed: int) -> LoadCells:
    """Four cells, the place of one and the range of a channel not known, on odd seeds with a soft layer."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(36, 36)) * 1e-4
    return LoadCells(
        random_cells(LAYOUTS[4], rng).forward(),
        1e-4 * (1 + rng.uniform(size=12)),
        limits=np.concatenate([np.tile([-5.0, 5.0], (11, 1)), [[-np.inf, np.inf]]]),
        covariance=half @ half.T,
        positions=np.concatenate([LAYOUTS[4][:3], np.full((1, 3), np.nan)]),
        indentation=Indentation(3.3e-4, 0.51, np.array([[1e-10, 0.0], [0.0, 1e-4]])) if seed % 2 else None,
        bias=rng.normal(size=12) / 3,
        drift=1 / 3,
        misfit=1e-3 / 7,
        correlation=5.1,
        samples=1000,
        provenance={"log": "bench.csv"},
        notes=("a note",),
    )


def _intensity(seed: int) -> Intensity:
    """Curves of two kinds; of seed 1 one for each of 2 x 2 cells, of seed 2 for each of 3 taxels."""
    third = 1 / 3 + np.random.default_rng(seed).uniform()
    strong = np.diag([1e-3, 2e-5, third])
    curves = (
        Curve("two_range", np.array([100.1, -3.3, 11.7]), strong, 18.0, np.inf, joint=0.3, residual=0.1),
        Curve("monotone", np.array([third, 2.0]), np.eye(2) / 7, 2.0, knots=np.array([0.7, 2.0]), hysteresis=0.01),
    )
    which = {1: np.array([[0, 1], [1, 1]]), 2: np.array([0, 1, 1])}.get(seed)
    return Intensity(curves, which, provenance={"a b.c": "x"}, notes=("n",))


def _response(seed: int) -> TaxelResponse:
    """Three taxels; on odd seeds a guess."""
    rng, guess = np.random.default_rng(seed), TaxelResponse.guessed(3, 0.0047)
    if seed % 2:
        return guess
    drawn = {name: rng.normal(size=getattr(guess, name).shape) for name in ("gains", "shares", "curve")}
    drawn |= {"temperature": 24.5, "thermal": rng.normal(size=(3, 3)), "fade": 1e-3 / 3}
    return replace(guess, **drawn, sums=True, provenance={"left_out": "x"}, notes=("n",))


def _skin_map(seed: int) -> SkinMap:
    """3 x 4 cells; on odd seeds with a spline and all that is known of it."""
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(3, 4, 3))
    normals = centres / np.linalg.norm(centres, axis=-1, keepdims=True)
    plain = SkinMap(centres, normals, rng.uniform(size=(3, 4)), (0.01, 0.011))
    if not seed % 2:
        return plain
    control = np.moveaxis(np.stack([*np.mgrid[0:6, 0:6], np.zeros((6, 6))]), 0, -1) / 300
    spline = BSplineSurface(open_knots(np.arange(4.0)), open_knots(np.arange(4.0)), control)
    over, uv = rng.uniform(size=(3, 4)) > 0.5, rng.uniform(size=(3, 4, 2))
    return replace(plain, overlap=over, surface=spline, uv=uv, strain=(0.01, -0.02), distance=(1e-4, 1e-3))


def _taxels(seed: int) -> TaxelPlaces:
    """Five numbers, at one of which there is no taxel; on odd seeds with all that is known of them."""
    rng = np.random.default_rng(seed)
    positions, half = rng.normal(size=(5, 3)) / 3, rng.normal(size=(5, 3, 3)) * 1e-3
    normals = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    positions[2] = normals[2] = np.nan
    if not seed % 2:
        return TaxelPlaces(positions, np.full((5, 3), np.nan))
    covariance = half @ half.transpose(0, 2, 1)
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    covariance[2] = np.nan
    relative, module = rng.uniform(size=5), np.array([0, 0, -1, 1, -1])
    said = {"provenance": {"pokes": "log.mcap"}, "notes": ("ünïcode",)}
    return TaxelPlaces(positions, normals, covariance, module, np.arange(5), relative, 0.1 / 3, **said)


def _camera(seed: int) -> Fisheye:
    numbers = np.random.default_rng(seed).uniform(size=8) / 3
    return Fisheye(200 / 3, 201 / 3, 319.5, 239.5, *numbers[:4].tolist(), width=640, height=481)


def _marker_ring(seed: int) -> MarkerRing:
    """Seven markers, or two rings of four; on odd seeds with shear."""
    rng = np.random.default_rng(seed)
    pose = Pose.from_rotation_vector(rng.normal(size=3) / 10, [0.0, 1e-3, 0.04])
    rings, count = ((0.0,), 7) if seed % 3 else ((0.0, 0.03 / 7), 8)
    view = RingView(_camera(seed), pose, 0.051, np.sort(rng.uniform(0.0, 6.0, count)), rings)
    response = RingResponse(
        rng.normal(size=(3 + seed % 2, 2 * len(rings), 9, 5)) / 3,
        rng.uniform(size=2) / 7,
        rng.uniform(size=(2 * len(rings), 6)),
        rng.uniform(size=2),
        np.array([0.01, 5.1]),
        rng.uniform(size=3),
        0.4 / 3,
        np.array([0.1, 0.2, 0.4]) / 3 * (seed % 2),
    )
    colour = MarkerColour("red", 1 / 3, 0.01)
    rest, area = view.from_plane(view.rest) + rng.normal(size=(count, 2)), rng.uniform(30.0, 40.0, count)
    said = {"provenance": {"log": "frames.avi"}, "notes": ("a note",)}
    return MarkerRing(0.055, view, colour, rest, area, 0.7 / 3, response, **said)


MADE = {
    "marker ring": _marker_ring,
    "camera": _camera,
    "payload": _payload,
    "servo": lambda seed: Servo(1 / 30, 0.02 / (1 + seed), 0.0, 0.1 / 3, 1e-3, 1 + seed % 2, {"log": "free.csv"}),
    "load_cells": _load_cells,
    "intensity": _intensity,
    "response": _response,
    "skin map": _skin_map,
    "taxels": _taxels,
    "ball gain": lambda seed: BallGain(1.5 + seed, 0.01, {"palpate": "0.1.0"}),
}


def _assert_same(one: Any, other: Any, name: str = "") -> None:
    """To the last bit, with the types and the shapes of arrays."""
    assert type(one) is type(other), name
    if isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape), name
        np.testing.assert_array_equal(one, other, err_msg=name)
    elif is_dataclass(one):
        for field in fields(one):
            _assert_same(getattr(one, field.name), getattr(other, field.name), field.name)
    elif isinstance(one, tuple):
        assert len(one) == len(other), name
        for first, second in zip(one, other, strict=True):
            _assert_same(first, second, name)
    elif isinstance(one, Mapping):
        assert dict(one) == dict(other), name
    else:
        assert one == other or (one != one and other != other), name


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", MODELS)
def test_a_model_reads_back_to_the_last_bit(tmp_path: Path, kind: str, seed: int) -> None:
    model = MADE[kind](seed)
    write_model(tmp_path / "model.toml", model)
    _assert_same(read_model(str(tmp_path / "model.toml")), model)
    _assert_same(read_model(tmp_path / "model.toml", MODELS[kind].holds), model)
    comments = re.findall("#.*", (tmp_path / "model.toml").read_text())
    assert len(comments) == len(set(comments))  # of tables that repeat, the first has them


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_of_another_kind_is_refused_with_what_writes_the_right_one(tmp_path: Path, kind: str) -> None:
    other = next(name for name in MODELS if name != kind)
    write_model(tmp_path / "model.toml", MADE[other](1))
    with pytest.raises(InputError, match=f"is not {MODELS[kind].called}.*`{MODELS[kind].command}` writes one"):
        read_model(tmp_path / "model.toml", MODELS[kind].holds)
    for unknown in ('"teapot"', '["payload"]'):
        (tmp_path / "model.toml").write_text(f"kind = {unknown}")
        with pytest.raises(InputError, match=r"is not a model.*'payload'"):
            read_model(tmp_path / "model.toml")


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", MODELS)
def test_a_model_is_summed_up_in_lines(kind: str, seed: int) -> None:
    lines = dict(MODELS[kind].summary(MADE[kind](seed)))
    assert len(lines) >= 2
    assert not [text for text in lines.values() if "nan" in text or "\n" in text]


def test_the_summary_of_load_cells_says_what_they_are() -> None:
    """Cells of 10 N/V that stand alike around the middle share a force along z alike."""
    servo = {"commands": "every 33.33 ms, reached at once", "delay": "20.0 +- 1.0 ms"}
    assert dict(MODELS["servo"].summary(MADE["servo"](0))) == servo | {"lag": "33.3 +- 1.0 ms, of first order"}
    lines = dict(MODELS["load_cells"].summary(nominal_cells(LAYOUTS[4], 10.0, 1e-4, 5.0)))
    assert lines["cells"] == "4, places known"
    assert lines["range"] == "-5 to 5 V"
    assert lines["noise"].startswith("0.0001 V")
    assert ", 10) N/V" in lines["sensitivity"]


def test_files_written_before_are_read(tmp_path: Path) -> None:
    """No place of a cell was an empty row, no range was 1e18 V, a soft layer an inline table."""
    path, cells = tmp_path / "model.toml", _load_cells(1)
    write_model(path, cells)
    text = path.read_text().replace("[nan, nan, nan]", "[]").replace("[-inf, inf]", "[-1e18, 1e18]")
    head, rest = text.split("[indentation]")
    path.write_text(
        head
        + "indentation = {depth = 0.00033, exponent = 0.51, covariance = [[1e-10, 0.0], [0.0, 0.0001]]}\n"
        + rest[rest.index("[provenance]") :]
    )
    assert "[]" in text
    assert "1e18" in text
    _assert_same(read_model(path, LoadCells), cells)


@pytest.mark.parametrize(
    ("kind", "old", "new", "word"),
    [
        ("load_cells", "bias = [", "bias = [1.0, ", "toml: bias must be a list of 12 numbers, not 13"),
        ("load_cells", "correlation = 5.1", "correlation = 0.5", "toml: correlation must not be below 1"),
        ("load_cells", "depth = 0.00033", "depth = 3", "indentation: an indentation cannot have a depth of 3 m.*Use"),
        ("load_cells", "samples = 1000", "samples = -1", "model.toml: samples must not be negative"),
        ("skin map", "rows = 3", "rows = 4", "toml: cells must be 4 x 4 rows of 9 numbers"),
        ("skin map", "shape = [6, 6]", "shape = [6, 7]", "surface: control must have 6 x 7 points, not 36"),
        ("skin map", "overlap = [", "overlap = [true, ", "toml: overlap must be 12 values true or false"),
        ("skin map", "overlap = [", "overlap = [1, ", r"toml: overlap\[0\] must be true or false, not 1"),
        ("skin map", "columns = 4\n", "", "toml: columns is missing"),
        ("intensity", "[0, 1],", "[0, 1, 1],", "toml: which must be"),
        ("intensity", "[0, 1],", "[0, 0.5],", r"toml: which\[0\]\[1\] must be a whole number"),
        ("intensity", "knots = [0.7, 2.0]", "knots = [nan, 2.0]", r"curve\[1\].knots\[0\] must be a finite number"),
        ("payload", 'kind = "payload"', 'kind = "skin"', "not a payload model.*palpate"),
        ("payload", "force_bias", "force_bais", "unknown key 'force_bais'.*'force_bias'"),
    ],
)
def test_a_value_that_cannot_be_meant_is_named_with_its_place(
    tmp_path: Path, kind: str, old: str, new: str, word: str
) -> None:
    path = tmp_path / "model.toml"
    write_model(path, MADE[kind](1))
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=word) as refused:
        read_model(path, MODELS[kind].holds)
    assert str(path) in str(refused.value)


def test_provenance_names_inputs_by_their_content(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"abc")
    record = provenance({"log": tmp_path / "log.csv", "rig": None}, {"friction": 0.5, "region": None})
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # of "abc", FIPS 180-2
    assert record["log"] == f"log.csv sha256:{digest}"
    assert record["friction"] == "0.5"
    assert set(record) == {"palpate", "log", "friction"}
    write_provenance(tmp_path / "contacts.csv.toml", record)
    assert read_provenance(tmp_path / "contacts.csv") == record


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("weight", '["1", "2", "3"]', r"toml: weight\[0\] must be a number, not '1'"),
        ("weight", "[true, false, true]", r"toml: weight\[0\] must be a number, not True"),
        ("weight", "[0, 0, nan]", r"toml: weight\[2\] must be a finite number, not nan"),
        ("weight", "[0, 0, 1e12]", "payload.toml: weight must be"),
        ("weight", "[[1, 2], [3], 4]", r"weight\[0\] must be a number, not a list"),
        ("magnitude", "-9.8", "toml: magnitude of gravity must be between"),
        ("magnitude", "1e-300", "magnitude of gravity must be between 1e-09 and 1e"),  # the mass would be 1e300 kg
        ("magnitude", "1" + "0" * 400, "toml: magnitude must be a finite number, not an integer that is too large"),
        ("magnitude", "1" + "0" * 5000, "payload.toml: is not TOML"),
        ("magnitude", "[" * 3000 + "]" * 3000, "payload.toml: is not TOML"),
        ("notes", "3", "toml: notes must be a list of texts, not 3"),
        ("notes", "[1]", r"toml: notes\[0\] must be text"),
        ("samples", '"many"', "toml: samples must be a whole number"),
        ("residual", "[-1, 0]", "must not be negative"),
        ("provenance", "3", "toml: provenance must be a table"),
        ("covariance", "[[1, 2], [3]]", "toml: covariance must be 12 x 12"),
        ("covariance", str(np.triu(np.ones((12, 12))).tolist()), "toml: covariance must be symmetric"),
        ("covariance", str((-np.eye(12)).tolist()), "toml: .*positive semidefinite"),
    ],
)
def test_a_value_of_a_model_that_was_spoilt_is_named(tmp_path: Path, key: str, value: str, word: str) -> None:
    path = tmp_path / "payload.toml"
    write_model(path, _payload(0))
    document = tomllib.loads(path.read_text())
    lines = [
        f"{name} = {value if name == key else tomlkit.item(old).as_string()}"
        for name, old in document.items()
        if name != "provenance"
    ]
    path.write_text("\n".join([*lines, *([f"provenance = {value}"] if key == "provenance" else [])]))
    with pytest.raises(InputError, match=word) as refused:
        read_model(path, Payload)
    assert str(path) in str(refused.value)


def test_a_covariance_of_low_rank_with_rounding_is_one() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(12, 4)) * np.repeat([1e-2, 1e-2, 1e-5, 1e-4], 3)[:, None]
    root[0] = 0.0
    matrix = np.round(root @ root.T, 17)
    assert np.array_equal(covariance_matrix(matrix.tolist(), 12, "c"), matrix)
    matrix[0, 0] = -1e-20
    covariance_matrix(matrix.tolist(), 12, "c")
    covariance_matrix(np.zeros((12, 12)).tolist(), 12, "c")


def test_a_small_variance_that_is_negative_is_seen_beside_large_ones() -> None:
    with pytest.raises(ValueError, match="positive semidefinite"):
        covariance_matrix(np.diag([1.0, 1e-5, -1e-6]).tolist(), 3, "c")


def test_a_pipe_is_not_hashed_but_said(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log")
    assert provenance({"log": tmp_path / "log"}, {})["log"] == "log (a pipe, no hash)"


def test_a_name_that_is_not_utf8_can_be_recorded(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"bad\xff\n.csv")
    path.write_bytes(b"")
    assert provenance({"log": path}, {})["log"].startswith(
        "bad\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}.csv sha256:"
    )


def test_a_byte_order_mark_is_passed_over_and_a_nul_in_a_name_said(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfa = 1")
    assert load_toml(tmp_path / "a.toml") == {"a": 1}
    with pytest.raises(InputError, match=r"toml: .*null"):
        load_toml(tmp_path / "a\0.toml")
