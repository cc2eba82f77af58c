"""Models as TOML: the same to the last bit when read back, refused by name when they are something else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.io.models import provenance, read_payload, write_payload
from palpate.sensors.force_torque import Payload


def _payload(seed: int) -> Payload:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(12, 12)) * 1e-5
    weight, force_bias, center, torque_bias = rng.normal(size=(4, 3)) * np.array([10.0, 1e-3, 1e-20, 1e15])[:, None]
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
        ("weight = [", "weight = [1.0, ", "weight must be 3 numbers"),
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
