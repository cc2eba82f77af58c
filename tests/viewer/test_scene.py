"""What is drawn of contacts: ellipses, heat, trails and curves against closed forms; without any server."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.contact.ellipse import ellipse
from palpate.contact.estimate import CHI2_95, Status
from palpate.errors import InputError
from palpate.surfaces.mesh import plane
from palpate.viewer.captions import MEANING, caption
from palpate.viewer.heat import PALETTE, colours, density, refined
from palpate.viewer.marker import facing
from palpate.viewer.robot_layer import LiveRobotLayer, RobotLayer
from palpate.viewer.scene import MAGNIFICATIONS, Scene, prepare, rounded_up
from palpate.viewer.timeline import Timeline, downsampled, next_of
from tests.support.pages import BODY, SPREAD, ellipsoid, session, tangents, two_contacts
from tests.support.robots import rotation


@pytest.fixture(scope="module")
def scene() -> Scene:
    return prepare(ellipsoid(), session(), title="session")


@given(st.integers(0, 2**32 - 1))
def test_an_ellipse_holds_95_percent_of_its_normal_distribution(seed: int) -> None:
    """Chi-square with two degrees of freedom: P(r^2 < x) = 1 - exp(-x/2), and every rim point has that r^2."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    flat = np.eye(3) - np.outer(normal, normal)
    spread = flat @ rng.normal(size=(3, 3)) * 1e-3
    covariance = spread @ spread.T
    axes, rotation = ellipse(covariance, normal)
    assert 1 - np.exp(-CHI2_95 / 2) == pytest.approx(0.95, abs=1e-12)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert rotation[:, 2] == pytest.approx(normal)
    inverse = np.linalg.pinv(covariance, rcond=1e-9)
    for turn in np.linspace(0, 2 * np.pi, 7):
        rim = rotation @ [axes[0] * np.cos(turn), axes[1] * np.sin(turn), 0.0]
        assert rim @ inverse @ rim == pytest.approx(CHI2_95, rel=1e-4)


def test_an_ellipse_without_a_covariance_or_a_normal_is_none() -> None:
    """Among others, which are as each alone; of normals that point straight down, too."""
    spread = np.random.default_rng(4).normal(size=(9, 3, 3))
    covariance, normal = spread @ np.swapaxes(spread, 1, 2), np.concatenate([np.eye(3), -np.eye(3), np.eye(3)])
    covariance[6], covariance[7], normal[8] = np.nan, np.inf, np.nan
    axes, frames = ellipse(covariance, normal)
    assert np.isnan(axes).any(axis=1).tolist() == 6 * [False] + 3 * [True]
    assert np.isnan(axes[6:]).all()
    assert frames @ np.swapaxes(frames, 1, 2) == pytest.approx(np.tile(np.eye(3), (9, 1, 1)))
    assert np.array_equal(frames[8], np.eye(3))
    for k in range(9):
        alone = ellipse(covariance[k], normal[k])
        assert alone[0] == pytest.approx(axes[k], nan_ok=True)
        assert alone[1] == pytest.approx(frames[k])


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (0.6, -0.8, 0), (0.48, 0.64, -0.6), (1e-6, 0, -1)])
def test_what_marks_a_contact_stands_on_its_normal(normal: tuple[float, float, float]) -> None:
    w, x, y, z = facing(np.array(normal, dtype=float))
    assert Rotation.from_quat([x, y, z, w]).apply([0.0, 0.0, 1.0]) == pytest.approx(normal, abs=2e-6)


def test_a_moment_is_the_estimate_of_its_sample(scene: Scene) -> None:
    contacts = session()
    moment = scene.at(200)
    assert (moment.index, moment.sample, moment.time) == (200, 200, contacts.time[200])
    assert moment.seconds == pytest.approx(2.0)
    (shown,) = moment.contacts
    assert shown.status == Status.CONTACT
    assert np.array_equal(shown.point, contacts.point[200])
    along, across = tangents(contacts.normal[200:201])
    turned = shown.frame
    assert shown.axes == pytest.approx(np.sqrt(CHI2_95) * np.array(SPREAD), rel=1e-9)
    assert abs(turned[:, 0] @ along[0]) == pytest.approx(1.0)
    assert abs(turned[:, 1] @ across[0]) == pytest.approx(1.0)
    assert not scene.at(0).contacts[0].located


def test_a_usual_ellipse_can_be_seen(scene: Scene) -> None:
    """Drawn, it is as long as a twenty-fifth of the body, or the next smaller magnification would do."""
    long = np.sqrt(CHI2_95) * SPREAD[0]
    least = scene.size / 25
    assert scene.magnification * long >= least
    smaller = [times for times in MAGNIFICATIONS if times < scene.magnification]
    assert not smaller or smaller[-1] * long < least


def _areas(corners: np.ndarray) -> np.ndarray:
    """Of facets (n, 3, 3)."""
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def test_heat_lies_where_it_was_touched_and_amounts_to_the_time_of_touch() -> None:
    """The integral of the density over the surface is the time: 2 s. A vertex stands for a third of its facets."""
    scene = prepare(ellipsoid(5_000), session())  # fine: contacts of a coarser mesh would hover above its facets
    corners = scene.body.vertices[scene.body.faces]
    whole = float((scene.heat[scene.body.faces].mean(axis=1) * _areas(corners)).sum())
    assert whole == pytest.approx(2.0, rel=0.05)  # the body is curved, and Gaussians are cut
    hottest = scene.body.vertices[np.argmax(scene.heat)]
    assert np.nanmin(np.linalg.norm(session().point - hottest, axis=1)) < scene.size / 50
    assert (scene.heat[scene.body.vertices[:, 0] < -0.01] == 0).all()


def test_heat_does_not_shine_through_a_thin_body() -> None:
    """Two facing sheets 0.1 mm apart: only the one that was pressed is warm."""
    top, bottom = plane([0, 0, 0], [0, 0, 1], 0.01), plane([0, 0, -1e-4], [0, 0, -1], 0.01)
    width = 1e-3
    points, normals, seconds = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1)
    for sheet, warm in ((top, True), (bottom, False)):
        body = refined(sheet, points, width)
        assert (density(body, points, normals, seconds, width).max() > 0) == warm


def test_facets_are_cut_near_touches_only_and_stay_on_the_surface() -> None:
    """A coarse facet cannot show a small spot; cutting it changes neither its place nor its normal."""
    sheet = plane([0, 0, 0], [0, 0, 1], 1.0)
    body = refined(sheet, np.array([[0.5, 0.5, 0.0]]), 0.01)
    corners = body.vertices[body.faces]
    assert _areas(corners).sum() == pytest.approx(4.0)
    assert (body.vertices[:, 2] == 0).all()
    assert body.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(body.vertices), 1)))
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    near = np.linalg.norm(corners.mean(axis=1) - [0.5, 0.5, 0.0], axis=1) < 0.01
    assert near.any()
    assert edge[near].max() <= 0.01
    assert len(body.faces) < 3_000  # of the 80,000 that a whole sheet so fine would have


def test_colours_run_from_the_bare_body_to_the_darkest() -> None:
    ends = colours(np.array([0.0, 1.0]))
    assert ends.tolist() == [PALETTE[0].tolist(), PALETTE[-1].tolist()]


def test_the_trail_is_where_the_contact_was_in_the_last_seconds(scene: Scene) -> None:
    contacts = session()
    time = contacts.time
    segments, age = scene.trail(250, 0.5)
    rows = (time >= time[250] - 0.5) & (time <= time[250])
    lift = 2e-3 * scene.size
    assert np.array_equal(segments[-1, 1], contacts.point[250] + lift * contacts.normal[250])
    assert len(segments) == np.count_nonzero(rows) - 1
    assert (age[0], age[-1]) == (pytest.approx(1.0, abs=0.05), 0.0)
    assert len(scene.trail(10, 5.0)[0]) == 0  # nothing was touched yet
    assert len(scene.trail(399, 2.0)[0]) == 100  # and no line leads over the time in between


def test_a_long_trail_is_downsampled() -> None:
    segments, _ = prepare(ellipsoid(), session(5_000, rate=1_000.0)).trail(3_500, 2.0)
    assert 100 < len(segments) <= 300


@given(st.integers(0, 2**32 - 1), st.integers(1, 500), st.integers(2, 60))
def test_downsampling_keeps_every_peak_and_the_order(seed: int, count: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    clock, values = np.cumsum(rng.random(count)), rng.normal(size=(count, 2))
    values[rng.random(count) < 0.2, 1] = np.nan
    x, y = downsampled(clock, values, most)
    assert len(x) <= max(most, 2)
    assert (np.diff(x) >= 0).all()
    assert y[:, 0].min() == values[:, 0].min()
    assert y[:, 0].max() == values[:, 0].max()
    known = np.isfinite(values[:, 1])
    if known.any():
        assert np.nanmax(y[:, 1]) == values[known, 1].max()


def test_curves_hold_force_and_place(scene: Scene) -> None:
    contacts = session()
    clock, values = scene.curves()
    assert clock == pytest.approx(contacts.time - contacts.time[0])
    assert values[200, :2] == pytest.approx([np.linalg.norm(contacts.force[200])] * 2)  # pushed along the normal
    assert values[200, 2:] == pytest.approx(1e3 * contacts.point[200])
    assert np.isnan(values[0, 2:]).all()
    window, _ = scene.curves(slice(100, 150))
    assert np.array_equal(window, clock[100:150])


@pytest.mark.parametrize(
    ("time", "clock"),
    [
        ([5.0, 6.0, 8.0], [0.0, 1.0, 3.0]),
        ([5.0, np.nan, 8.0], [0.0, 0.0, 3.0]),
        ([np.nan, 5.0, 4.0, 8.0], [0.0, 0.0, 0.0, 3.0]),
        ([np.nan, np.nan, np.inf], [0.0, 1.0, 2.0]),
        ([7.0], [0.0]),
    ],
)
def test_the_clock_never_runs_backwards(time: list[float], clock: list[float]) -> None:
    timeline = Timeline.of(np.array(time), np.ones(len(time), dtype=bool))
    assert timeline.clock.tolist() == clock
    assert [timeline.at(seconds) for seconds in (-1.0, 1e9)] == [0, len(time) - 1]


def test_a_gap_is_not_a_touch() -> None:
    """A pause of the log between two samples does not warm the place before it."""
    time = np.array([0.0, 0.1, 0.2, 100.0, 100.1])
    assert Timeline.of(time, np.ones(5, dtype=bool)).seconds == pytest.approx([0.1, 0.1, 1.0, 0.1, 0.1])


def test_touches_are_stepped_through() -> None:
    touched = np.array([0, 1, 1, 0, 0, 1, 0, 1], dtype=bool)
    timeline = Timeline.of(np.arange(8.0), touched)
    assert timeline.touches.tolist() == [2, 5, 7]  # their middles
    assert [next_of(timeline.touches, k, 1) for k in (0, 1, 4, 7)] == [2, 2, 5, 7]
    assert [next_of(timeline.touches, k, -1) for k in (0, 1, 4, 7)] == [0, 1, 2, 5]


def test_a_log_without_a_touch_or_a_noise_is_shown_all_the_same() -> None:
    contacts = session()
    scene = prepare(ellipsoid(), contacts[:50])
    assert scene.opening == 0
    assert not scene.heat.any()
    assert len(scene.trail(49, 5.0)[0]) == 0
    assert "no contact" in caption(scene.at(0), 1)
    unknown = replace(contacts.estimate, covariance=np.full((len(contacts), 3, 3), np.nan))
    scene = prepare(ellipsoid(), contacts.with_estimate(unknown))
    assert scene.magnification == 1
    assert "the noise is not known" in caption(scene.at(200), 1)


def test_every_status_has_its_words() -> None:
    assert set(MEANING) == set(Status)


@given(st.floats(1e-6, 1e6))
def test_a_nice_step_is_the_next_of_1_2_5(value: float) -> None:
    step = rounded_up(value)
    digit = step / 10 ** np.floor(np.log10(step) + 1e-9)
    assert min(abs(digit - d) for d in (1, 2, 5)) < 1e-6
    assert value * (1 - 1e-6) <= step <= 2.5 * value * (1 + 1e-6)


def test_the_body_that_is_drawn_is_the_body() -> None:
    """Vertices lie on the ellipsoid within the depth of a facet; normals are those of the mesh."""
    scene = prepare(ellipsoid(2_000), session())
    assert np.abs(BODY.value(scene.body.vertices)).max() < 0.02  # facets cut, a fifth as long as the radius
    assert np.einsum("ij,ij->i", scene.body.normals, BODY.normals(scene.body.vertices)).min() > 0.99


def test_a_moment_holds_all_contacts_of_its_sample_the_strongest_first() -> None:
    contacts = two_contacts()
    scene = prepare(ellipsoid(), contacts)
    assert len(scene) == 100
    assert [len(scene.at(k).contacts) for k in (0, 24, 25, 74, 75, 99)] == [1, 1, 2, 2, 1, 1]
    assert [shown.identity for shown in scene.at(50).contacts] == [2, 1]
    assert [shown.features["area"] for shown in scene.at(50).contacts] == [2e-4, 1e-4]
    assert scene.at(50).sample == 50
    assert np.linalg.norm(contacts.force[scene.strongest[scene.opening]]) == pytest.approx(2.0)
    said = caption(scene.at(50), 1)
    assert "2 contacts" in said
    assert "3.00 N" in said  # 2 and 1
    assert "contact area&nbsp;2.00&nbsp;cm²" in said


def test_plots_of_several_contacts_hold_the_sum_and_the_strongest() -> None:
    contacts = two_contacts()
    _, values = prepare(ellipsoid(), contacts).curves()
    assert values[[10, 50], :2] == pytest.approx(np.array([[1.0, 1.0], [3.0, 2.0]]))
    assert (values[[10, 50], 2] > 0).tolist() == [True, False]  # x of the strongest


def test_a_trail_joins_the_points_of_one_contact_only() -> None:
    """The two lie at opposite ends of a body of 60 mm: no segment leads from one to the other."""
    contacts = two_contacts()
    scene = prepare(ellipsoid(), contacts)
    segments, age = scene.trail(74, 0.5)
    assert len(segments) == 2 * 25
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).max() < 1e-3
    assert (np.diff(age) <= 0).all()
    assert age[-2:].tolist() == [0.0, 0.0]


def test_heat_of_two_contacts_is_the_time_of_both() -> None:
    """2 s of one and 1 s of the other."""
    scene = prepare(ellipsoid(5_000), two_contacts())
    corners = scene.body.vertices[scene.body.faces]
    share = scene.heat[scene.body.faces].mean(axis=1) * _areas(corners)
    right = corners[:, :, 0].mean(axis=1) > 0
    assert [share[right].sum(), share[~right].sum()] == pytest.approx([2.0, 1.0], rel=0.05)


def test_a_body_without_a_mesh_is_as_large_as_its_contacts() -> None:
    contacts = two_contacts()
    scene = prepare(None, contacts)
    assert scene.body is None
    assert scene.bounds == pytest.approx(np.stack([contacts.point.min(axis=0), contacts.point.max(axis=0)]))
    assert prepare(None, session()[:10]).size == pytest.approx(0.1 * 3**0.5)  # nothing was touched


def test_nothing_to_show_is_said() -> None:
    with pytest.raises(InputError, match="nothing to show"):
        prepare(ellipsoid(), session()[:0])


def test_a_robot_is_drawn_where_its_links_are(scene: Scene) -> None:
    """Also at a sample whose pose is not known, and from links that are listed while they move."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    half = np.sqrt(0.5)
    links = {"a": (corners, faces), "b": (corners, faces)}
    quaternions, positions = np.full((2, 2, 4), np.nan), np.full((2, 2, 3), np.nan)
    quaternions[1], positions[1] = [[0.0, 0, 0, 1], [0, 0, half, half]], [[0.0, 0, 0], [5, 0, 0]]
    force = {"one": np.array([np.nan, 0.0]), "other": np.array([1.5, 1.5])}
    layer = RobotLayer(links, quaternions, positions, force, {"one": 50.0, "other": 1e3})
    body = layer.body_at(0)
    wanted = {tuple(p) for p in np.concatenate([corners, corners @ rotation(np.pi / 2).T + [5, 0, 0]]).round(9) + 0.0}
    assert {tuple(p) for p in body.vertices.round(9) + 0.0} == wanted
    assert len(body.faces) == 8
    facets = body.vertices[body.faces]
    across = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    assert (np.einsum("fi,fki->fk", across, body.normals[body.faces]) > 0).all()
    np.testing.assert_allclose([layer.places.min(axis=0), layer.places.max(axis=0)], [[0, 0, 0], [5, 1, 1]], atol=1e-9)
    assert layer.rows(scene, 0) == [("one", "no readings, 50.0 Hz"), ("other", "1.50 N, 1000 Hz")]
    assert layer.rows(scene, 1)[0] == ("one", "nothing touches, 50.0 Hz")
    live = LiveRobotLayer(links, quaternions[0], positions[0])
    assert len(live.body_at(0).faces) == 0
    live.move(quaternions[1], positions[1])
    live.describe([("one", "2 N")])
    assert len(live.body_at(0).faces) == 8
    assert (live.rows(scene, 0), live.legend(), live.covers) == ([("one", "2 N")], [], False)
