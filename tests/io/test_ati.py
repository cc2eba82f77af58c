"""Calibration files of ATI: a made one, and the real one where it is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.io.ati import read_ati, read_certificate
from palpate.sensors.gauges import certified_noise

ROW = '<UserAxis Name="{}" values="{}" max="{}"/>'


def made(tmp_path: Path, **change: str) -> Path:
    rows = [
        ROW.format(name, " ".join("1" if k == j else "0" for j in range(6)), 10)
        for k, name in enumerate(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
    ]
    text = (
        '<FTSensor Serial="S1"><Calibration ForceUnits="lbf" TorqueUnits="lbf-in" OutputRange="20">'
        + "".join(rows)
        + "</Calibration></FTSensor>"
    )
    for old, new in change.items():
        text = text.replace(old, new)
    path = tmp_path / "made.cal"
    path.write_text(text)
    return path


def test_units_become_si(tmp_path: Path) -> None:
    sensor = read_ati(made(tmp_path))
    np.testing.assert_allclose(np.diag(sensor.matrix)[[0, 3]], [4.4482216152605, 4.4482216152605 * 0.0254])
    assert sensor.volts == 10.0
    assert sensor.serial == "S1"
    found = sensor.wrenches(np.array([[1.0, 0, 0, 0, 0, 0], [10.0, 0, 0, 0, 0, 0]]), np.zeros(6))
    assert found[0, 0] == pytest.approx(4.4482216152605)
    assert np.isnan(found[1]).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"FTSensor": "Sensor"}, "no calibration of ATI"),
        ({"UserAxis": "Axis"}, "no UserAxis Fx"),
        ({'values="1 0': 'values="1'}, "must hold 6 numbers"),
        ({"lbf-in": "stone"}, "unknown unit 'stone'"),
        ({"</FTSensor>": ""}, "is not XML"),
        ({'values="1 0 0 0 0 0"': 'values="0 0 0 0 0 0"'}, "does not give six numbers"),
    ],
)
def test_bad_files_are_sentences(tmp_path: Path, change: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_ati(made(tmp_path, **change))


def test_entities_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.cal"
    path.write_text('<!DOCTYPE x [<!ENTITY a "b">]><FTSensor>&a;</FTSensor>')
    with pytest.raises(InputError, match="entities"):
        read_ati(path)


def test_certified_errors_are_a_covariance() -> None:
    rng, limits = np.random.default_rng(1), np.array([25.0, 25.0, 35.0, 0.25, 0.25, 0.25])
    errors = 0.002 * rng.normal(size=(5000, 6))
    noise = certified_noise(errors, limits)
    np.testing.assert_allclose(np.sqrt(np.diag(noise)), 0.002 * limits, rtol=0.05)  # five deviations
    with pytest.raises(InputError, match="load cases"):
        certified_noise(errors[:3], limits)


def test_the_real_nano17(shared: Path) -> None:
    """Its two blocks of rows agree: user rows are basic rows over their scale, moved along z by 6.096 mm."""
    from xml.etree import ElementTree

    path = shared / "data" / "nano17" / "calibration_files_FT44297.cal"
    sensor = read_ati(path)
    assert sensor.serial == "FT44297"
    np.testing.assert_allclose(sensor.limits, [25, 25, 35, 0.25, 0.25, 0.25])
    basic = ElementTree.parse(path).findall("Calibration/Axis")
    rows = np.array([[float(v) for v in str(a.get("values")).split()] for a in basic])
    rows /= np.array([float(str(a.get("scale"))) for a in basic])[:, None]
    rows[3] += 6.096 * rows[1]
    rows[4] -= 6.096 * rows[0]
    rows[3:] *= 1e-3  # N mm
    np.testing.assert_allclose(sensor.matrix, rows, atol=2e-5)  # the file has five decimals
    noise = np.sqrt(np.diag(read_certificate(path.with_name("cert_FT44297_loadcases.csv"), sensor)))
    assert np.all(
        noise < 0.005 * sensor.limits
    )  # the certificate's errors are below 1.4 % of full scale, most below 0.3
    assert np.all(noise > 0.0002 * sensor.limits)
    assert sensor.sensor(noise).limits is not None
