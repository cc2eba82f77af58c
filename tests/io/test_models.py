"""Models as TOML: the same to the last bit when read back, refused by name when they are something else."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from palpate.errors import InputError
from palpate.io.models import load_toml, provenance, read_payload, write_payload
from palpate.io.strict import covariance_matrix
from palpate.sensors.force_torque import Payload


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


@pytest.mark.parametrize("seed", range(5))
def test_a_payload_reads_back_to_the_last_bit(tmp_path: Path, seed: int) -> None:
    payload = _payload(seed)
    write_payload(tmp_path / "payload.toml", payload)
    back = read_payload(tmp_path / "payload.toml")
    for name in ("weight", "force_bias", "center_of_mass", "torque_bias", "covariance", "residual"):
        assert np.array_equal(getattr(back, name), getattr(payload, name)), name
    for name in ("magnitude", "samples", "notes"):
        assert getattr(back, name) == getattr(payload, name)
    assert dict(back.provenance) == dict(payload.provenance)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('kind = "payload"', 'kind = "skin"', "not a payload model"),
        ("force_bias", "force_bais", "unknown key 'force_bais'.*'force_bias'"),
        ("weight = [", "weight = [1.0, ", "weight must be a list of 3 numbers, not 4 values"),
        ("samples = 7", "samples = ", "not TOML.*line"),
    ],
)
def test_a_model_that_was_spoilt_is_refused(tmp_path: Path, old: str, new: str, word: str) -> None:
    path = tmp_path / "payload.toml"
    write_payload(path, _payload(0))
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=word) as refused:
        read_payload(path)
    assert "payload" in str(refused.value)


def test_provenance_names_inputs_by_their_content(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"abc")
    record = provenance({"log": tmp_path / "log.csv", "rig": None}, {"friction": 0.5, "region": None})
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # of "abc", FIPS 180-2
    assert record["log"] == f"log.csv sha256:{digest}"
    assert record["friction"] == "0.5"
    assert set(record) == {"palpate", "log", "friction"}


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("weight", '["1", "2", "3"]', r"weight\[0\] must be a number, not '1'"),
        ("weight", "[true, false, true]", r"weight\[0\] must be a number, not True"),
        ("weight", "[0, 0, nan]", r"weight\[2\] must be a finite number, not nan"),
        ("weight", "[0, 0, 1e300]", r"weight\[2\] must be a finite number"),
        ("weight", "[0, 0, 1e12]", "payload.toml: weight must be"),
        ("weight", "[[1, 2], [3], 4]", r"weight\[0\] must be a number, not a list"),
        ("magnitude", '"9.8"', "magnitude must be a number, not '9.8'"),
        ("magnitude", "-9.8", "magnitude must be positive"),
        ("magnitude", "1e-300", "magnitude of gravity must lie between 1e-09 and 1e"),  # the mass would be 1e300 kg
        ("magnitude", "1" + "0" * 400, "magnitude must be a finite number, not one so large"),
        ("magnitude", "1" + "0" * 5000, "is not TOML"),
        ("magnitude", "[" * 3000 + "]" * 3000, "is not TOML"),
        ("notes", "3", "notes must be a list of texts, not 3"),
        ("notes", "[1]", r"notes\[0\] must be text"),
        ("samples", '"many"', "samples must be a whole number"),
        ("residual", "[-1, 0]", "must not be negative"),
        ("provenance", "3", "provenance must be a table"),
        ("covariance", "[[1, 2], [3]]", "covariance must be 12 x 12"),
        ("covariance", str(np.triu(np.ones((12, 12))).tolist()), "covariance must be symmetric"),
        ("covariance", str((-np.eye(12)).tolist()), "positive semidefinite"),
        ("covariance", str(np.full((12, 12), np.nan).tolist()), "must be a finite number"),
    ],
)
def test_a_value_of_a_model_that_was_spoilt_is_named(tmp_path: Path, key: str, value: str, word: str) -> None:
    path = tmp_path / "payload.toml"
    write_payload(path, _payload(0))
    document = tomllib.loads(path.read_text())
    lines = [
        f"{name} = {value if name == key else tomlkit.item(old).as_string()}"
        for name, old in document.items()
        if name != "provenance"
    ]
    path.write_text("\n".join([*lines, *([f"provenance = {value}"] if key == "provenance" else [])]))
    with pytest.raises(InputError, match=word) as refused:
        read_payload(path)
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
    with pytest.raises(InputError, match="null"):
        load_toml(tmp_path / "a\0.toml")
