"""What every page keeps: cameras see body and arrow whole, numbers have units and the digits that they deserve."""

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sensors.fused.estimator import FEATURES as FUSED
from palpate.sensors.marker_ring.estimator import FEATURES as RING
from palpate.sensors.taxels.estimator import FEATURES as TAXELS
from palpate.spatial.shown import uncertain
from palpate.viewer.camera import PANEL, SHEET, STRIP, VIEW, fit
from palpate.viewer.captions import caption
from palpate.viewer.rendered import ViewPoint
from palpate.viewer.scene import prepare
from palpate.viewer.scene3d import aim
from tests.support.pages import ellipsoid, session, two_contacts

WINDOWS = ((1440 - PANEL, 900, STRIP), (390, 844, SHEET))  # px of the picture, and what is covered of it from below
LABEL = np.array([22.0, 18.0])  # px of half the width of "12.3 N", and its height
VALUE = re.compile(r"-?[\d.,]+( ± [\d.]+)? (N|mm|cm²|kPa|°|%|cells|mN m about the normal)")
COUNTS = ("cells pressed", "markers seen")


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 3.0), st.floats(0.0, 0.5))
def test_a_camera_sees_all_points_and_stands_no_farther_than_it_must(seed: int, aspect: float, covered: float) -> None:
    """Nearer by a thousandth, some point would leave the picture: two opposite edges are reached."""
    rng = np.random.default_rng(seed)
    points, direction = rng.normal(size=(20, 3)) * rng.uniform(0.01, 1.0, 3), rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    position, target = fit(points, direction, aspect, covered)
    size = (round(1000 * aspect), 1000)
    seen = ViewPoint(position, target, VIEW, size).seen(points)
    assert (seen[:, 2] > 0).all()
    x, y = 2 * seen[:, 0] / size[0] - 1, 1 - 2 * seen[:, 1] / size[1]  # from -1 to 1
    assert max(np.abs(x).max(), y.max()) <= 0.86 + 0.01
    assert y.min() >= 2 * covered - 1
    spans = np.ptp(x) / (2 * 0.86), np.ptp(y) / (2 - 2 * covered - 0.14 * (2 - covered))
    near = float(np.linalg.norm(target - position)) < 1e-2  # nothing to see but a point before the lens
    assert max(spans) == pytest.approx(1.0, abs=0.01) or near


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("found", [session(rate=20.0), two_contacts()])
def test_body_arrow_and_its_label_are_within_the_window_and_not_covered(found: object, window: tuple) -> None:
    wide, high, covered = window
    scene = prepare(ellipsoid(2_000), found)
    contacts = scene.at(scene.opening).contacts
    position, target = aim(scene, wide / high)
    camera = ViewPoint(position, target, VIEW, (wide, high))
    body = camera.seen(scene.placed(scene.body.vertices))[:, :2]
    labels = camera.seen(scene.placed(np.array([scene.labelled(each) for each in contacts])))[:, :2]
    points = np.concatenate([body, labels + LABEL, labels - LABEL])
    assert points.min() >= 0
    assert points[:, 0].max() <= wide
    assert points[:, 1].max() <= (1 - covered) * high
    larger = np.ptp(body, axis=0) / [wide, (1 - covered) * high]
    assert larger.max() > 0.4  # and is not a speck


def test_every_number_of_the_panel_has_a_name_and_a_unit_or_is_a_count() -> None:
    """With all features of all sensors; none by the name that files give it."""
    found = two_contacts()[:1]
    features = {name: np.full(1, 0.1) for name in ("row", "column", *TAXELS, *RING, *FUSED)}
    said = caption(prepare(ellipsoid(), replace(found, features=features)).at(0), 5)
    rows = re.findall(r"<tr><td[^>]*>(.*?)</td><td>(.*?)</td>", said)
    assert len(rows) > 15
    for name, value in rows:
        text = unescape(value).replace("\xa0", " ")
        assert "_" not in name + text
        if name not in (*COUNTS, "time", "place [mm]", "95 % half-axes"):
            assert VALUE.fullmatch(text), (name, text)
    assert dict(rows)["spread, angle"].count("±") == 1  # its deviation is no row of its own
    number = re.search(r"font-weight:600[^>]*>(.*?)</span>", said)
    assert number is not None
    assert number[1].endswith(" N")


@given(st.floats(-1e3, 1e3), st.floats(1e-4, 99.0))
def test_digits_follow_the_uncertainty(value: float, deviation: float) -> None:
    """Two digits of the deviation, the value to the same place, and both by half a unit of it at most."""
    shown, _, spread = uncertain(value, deviation).partition(" ± ")
    digits = len(shown.partition(".")[2])
    assert digits == len(spread.partition(".")[2])
    assert len(spread.replace(".", "").lstrip("0")) == 2
    assert abs(float(shown) - value) <= 0.501 * 10.0**-digits
    assert abs(float(spread) - deviation) <= 0.501 * 10.0**-digits
    assert not re.fullmatch(r"-0\.?0*", shown)
    assert uncertain(value, float("nan")) == f"{round(value, 2) + 0.0:.2f}"


def test_no_curl_is_drawn_below_its_own_noise() -> None:
    """Of noise alone one in some hundred is (0.3 %, and what the noise itself is off by); of what is real all are."""
    found = session(400)
    noise = np.random.default_rng(3).normal(0.0, 1e-3, len(found))
    for mean, least, most in ((0.0, 0.0, 0.02), (0.02, 1.0, 1.0)):
        torque = np.where(np.isfinite(found.torque), mean + noise, np.nan)
        scene = prepare(ellipsoid(), found.with_estimate(replace(found.estimate, torque=torque)))
        drawn = [scene.turning(scene.at(k).contacts[0]) != 0.0 for k in scene.timeline.in_touch]
        assert least <= np.mean(drawn) <= most
