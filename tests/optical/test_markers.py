"""Blobs and the tracker on pictures whose markers stand at known places."""

from collections import deque

import cv2
import numpy as np
import pytest

from palpate.errors import InputError
from palpate.optical._markers import measure_windows, sampled, score_image
from palpate.optical.fisheye import RingView
from palpate.optical.markers import SCORES, FrameProblem, MarkerColour, MarkerTracker, find_blobs, find_colour
from tests.support.drawn_markers import drawn, nominal_view

VIEW = nominal_view()
REST = VIEW.from_plane(VIEW.rest)
RED = MarkerColour("red", 0.5, 0.007)
CLOSE = 0.15  # px: the drawing's own sixteenths, and rounding to 256 levels
COLOURS = {
    "red": ((40, 40, 200), (150, 150, 150)),
    "green": ((60, 180, 50), (120, 125, 130)),
    "blue": ((200, 60, 50), (30, 30, 30)),
    "bright": ((220, 230, 225), (25, 20, 20)),
    "dark": ((20, 20, 20), (150, 160, 150)),
}


def _tracker(view: RingView = VIEW, radius: float = 5.0) -> MarkerTracker:
    rest = view.from_plane(view.rest, view.heights)
    blobs = find_blobs(drawn(rest, radius), RED)
    nearest = np.linalg.norm(blobs.pixels[None] - rest[:, None], axis=-1).argmin(axis=1)
    return MarkerTracker(view, RED, blobs.pixels[nearest], blobs.areas[nearest])


def _run(tracker: MarkerTracker, frames: list[np.ndarray]) -> tuple[np.ndarray, list[bool], list[FrameProblem]]:
    out, searched, told = np.empty((len(frames), 24, 2)), list[bool](), list[FrameProblem]()
    for frame, row in zip(frames, out, strict=True):
        found = tracker.track(frame, row)
        assert np.array_equal(found, np.isfinite(row).all(axis=1))
        searched.append(tracker.searched)
        told.append(tracker.frame)
    return out, searched, told


@pytest.mark.parametrize("score", SCORES)
def test_the_colour_of_an_unloaded_frame_is_found(score: str) -> None:
    marker, skin = COLOURS[score]
    image = drawn(REST, marker=marker, skin=skin, noise=2.0, rng=np.random.default_rng(0))
    colour = find_colour(image, 24)
    blobs = find_blobs(image, colour)
    assert len(blobs) == 24
    assert np.linalg.norm(blobs.pixels[None] - REST[:, None], axis=-1).min(axis=1).max() <= CLOSE
    # whichever score tells them apart will do, but only one of colour survives another light
    assert colour.score == score or marker[0] == marker[1] == marker[2]


def test_no_colour_is_said() -> None:
    with pytest.raises(InputError, match=r"24 markers.*State"):
        find_colour(drawn(REST[:20]), 24)
    with pytest.raises(InputError, match=r"score of a pixel.*Use"):
        MarkerColour("purple")
    assert len(find_blobs(np.zeros((480, 640, 3), np.uint8), RED)) == 0


@pytest.mark.parametrize("radius", [2.5, 5.0, 12.0, 22.0])
@pytest.mark.parametrize(("brightness", "hue"), [(1.0, 0), (0.5, 0), (2.0, 0), (1.0, 10), (1.0, -10)])
def test_brightness_and_hue_do_not_move_blobs(radius: float, brightness: float, hue: int) -> None:
    """Markers of 5 to 44 px. The hue in OpenCV's units of 2 degrees."""
    few = REST[::2]
    image = drawn(few, radius, marker=(30, 30, 120), skin=(90, 90, 90), noise=1.5, rng=np.random.default_rng(1))
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0].astype(int) + hue) % 180
    image = np.clip(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR) * brightness, 0, 255).astype(np.uint8)
    blobs = find_blobs(image, MarkerColour("red", 0.5, 12 * np.pi * radius**2 / (640 * 480)))
    assert len(blobs) == 12
    assert np.linalg.norm(blobs.pixels[None] - few[:, None], axis=-1).min(axis=1).max() <= 2 * CLOSE


@pytest.mark.parametrize("score", SCORES)
def test_the_window_s_kernel_is_its_plain_twin(score: str) -> None:
    marker, skin = COLOURS[score]
    image = drawn(REST, marker=marker, skin=skin, noise=4.0, rng=np.random.default_rng(2))
    image.flags.writeable = False  # as the tracker hands it over, or the loop is compiled once more
    expected = REST + np.random.default_rng(3).uniform(-6, 6, REST.shape)
    expected[3] = np.nan
    expected[4] = (-30.0, 10.0)
    expected[5] = (2.0, 479.0)
    halves = np.full(24, 17)
    out = np.empty((24, 7))
    measure_windows(image, MarkerColour(score).weights, expected, halves, out)
    for i in range(24):
        assert out[i] == pytest.approx(_plain(image, score, expected[i], 17), abs=1e-9)


def test_the_kernel_that_samples_rows_is_its_plain_twin() -> None:
    frames = np.random.default_rng(4).integers(0, 60, (2, 100, 9, 3), dtype=np.uint8)
    frames.flags.writeable = False
    sample = np.zeros((3, 27), np.uint8)
    before = np.zeros_like(sample)
    for frame in (frames[0], frames[0], frames[1]):
        rows = frame[16::32].reshape(3, 27)
        assert sampled(frame, 32, 40, sample) == (np.count_nonzero(rows > 40), np.array_equal(rows, before))
        assert np.array_equal(sample, rows)
        before = rows


def _plain(image: np.ndarray, score: str, expected: np.ndarray, half: int) -> list[float]:
    """One window by NumPy and a queue."""
    if not (np.isfinite(expected).all() and (expected > -0.5).all() and (expected < (639.5, 479.5)).all()):
        return [0, 0, 0, 0, 0, 0, 1]
    cx, cy = np.rint(expected).astype(int)
    x0, y0 = max(0, cx - half), max(0, cy - half)
    b, g, r = np.moveaxis(image[y0 : cy + half + 1, x0 : cx + half + 1].astype(int), -1, 0)
    grey = 2 * b + 9 * g + 5 * r
    sums = {"red": 22 * r - 6 * (r + g + b), "green": 22 * g - 6 * (r + g + b), "blue": 22 * b - 6 * (r + g + b)}
    s = np.clip((sums | {"bright": grey, "dark": 255 * 16 - grey})[score] // 16, 0, 255)
    rim = np.ones(s.shape, bool)
    rim[1:-1, 1:-1] = False
    base = s[rim & (2 * s <= s.max() + s.min())].mean()
    level = s[2 * s > s.max() + base].mean()
    over = 2 * s > level + base
    ys, xs = np.nonzero(over)
    if not len(ys):
        return [0, 0, 0, 0, 0, 0, 1]
    ex, ey = expected[0] - x0, expected[1] - y0
    near, nearest = (int(np.rint(ey)), int(np.rint(ex))), np.argmin((xs - ex) ** 2 + (ys - ey) ** 2)
    queue = deque([near if over[near] else (int(ys[nearest]), int(xs[nearest]))])
    blob = {queue[0]}
    while queue:
        y, x = queue.popleft()
        for there in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
            if 0 <= there[0] < s.shape[0] and 0 <= there[1] < s.shape[1] and over[there] and there not in blob:
                blob.add(there)
                queue.append(there)
    y, x = np.array(sorted(blob)).T
    w = np.minimum(s[y, x] - (level + base) / 2, 0.3 * (level - base))
    mx, my = np.average(x, weights=w), np.average(y, weights=w)
    spread = np.average((x - mx) ** 2 + (y - my) ** 2, weights=w)
    cut = 2.0 * bool(rim[y, x].any())
    told = [len(y), spread, level - base, over.sum() - len(y), cut]
    if 10 * (over.sum() - len(y)) > len(y):
        return [x0 + mx, y0 + my, *told]
    taken = np.zeros(s.shape, bool)
    taken[y, x] = True
    own = {"red": r, "green": g, "blue": b}.get(score, s)
    value = own if own[taken].mean() - own[~over].mean() >= 0.8 * (level - base) else s
    whole = _value_everywhere(image, score, own is value and own is not s)
    low, high = value[~over].mean(), value[taken].mean()
    place = _plain_centroid(whole, low, high, 1.25 * np.sqrt(len(y) / np.pi) + 2.0, np.array([x0 + mx, y0 + my]))
    return [*place, *told]


def _value_everywhere(image: np.ndarray, score: str, own: bool) -> np.ndarray:
    """The markers' own channel, or the score."""
    if own:
        return image[..., ["blue", "green", "red"].index(score)].astype(float)
    out, histogram = np.empty(image.shape[:2], np.uint8), np.empty(256, np.int64)
    score_image(image, MarkerColour(score).weights, out, histogram)
    return out.astype(float)


def _plain_centroid(value: np.ndarray, low: float, high: float, reach: float, place: np.ndarray) -> np.ndarray:
    """Weights that rise from 30 to 60 % of the contrast, in a disc; twice."""
    near = tuple(slice(max(0, int(middle - reach - 3)), int(middle + reach + 4)) for middle in place[::-1])
    y, x = (each[near] for each in np.indices(value.shape))
    rising = np.clip(((value[near] - low) / (high - low) - 0.3) / 0.3, 0, 1)
    for _ in range(2):
        dx, dy = x - place[0], y - place[1]
        weight = rising * np.clip(reach + 0.5 - np.hypot(dx, dy), 0, 1)
        weight[(np.abs(dx) > reach) | (np.abs(dy) > reach)] = 0
        place = place + np.array([np.average(dx, weights=weight), np.average(dy, weights=weight)])
    return place


def test_following_markers_that_move() -> None:
    """After the first frame no search is needed, and pixels are as good as the drawing's own."""
    rng, tracker = np.random.default_rng(4), _tracker()
    moved = [REST + np.array([3.0 * np.sin(0.3 * k), 1.5 * k]) for k in range(12)]
    out, searched, told = _run(tracker, [drawn(each, noise=2.0, rng=rng) for each in moved])
    assert np.abs(out - moved).max() <= 3 * CLOSE
    assert searched == [True] + 11 * [False]
    assert set(told) == {FrameProblem.OK}


def test_a_jump_and_a_hidden_marker_are_searched_for() -> None:
    rng, tracker = np.random.default_rng(5), _tracker()
    jump = REST + np.array([4.0, -3.0])
    seen = np.arange(24) != 7
    places = [REST, jump, jump[seen], jump[seen], *5 * [jump]]
    out, searched, told = _run(tracker, [drawn(each, noise=2.0, rng=rng) for each in places])
    assert np.abs(out[1] - jump).max() <= 2 * CLOSE
    assert searched[2]
    assert np.isnan(out[2:4, 7]).all()
    assert np.abs(out[2:4, seen] - jump[seen]).max() <= 2 * CLOSE
    assert np.abs(out[-1] - jump).max() <= 2 * CLOSE
    assert not searched[-1]
    assert set(told) == {FrameProblem.OK}


def test_a_blob_that_runs_into_a_marker_does_not_carry_it_away() -> None:
    """As large as a marker, and beside it for one frame: both together are not 1.7 times as large, and 2.8 px off."""
    rng, tracker = np.random.default_rng(6), _tracker()
    beside = np.concatenate([REST, REST[[7]] + np.array([0.0, 5.5])])
    out, searched, told = _run(tracker, [drawn(each, noise=2.0, rng=rng) for each in (REST, REST, beside, REST, REST)])
    assert np.isnan(out[2, 7]).all()
    assert np.nanmax(np.abs(out - REST)) <= 2 * CLOSE
    assert searched == [True, False, True, True, False]
    assert set(told) == {FrameProblem.OK}


def test_what_a_stray_blob_pulls_away_is_left_out_of_a_search() -> None:
    """Strays of any size and distance at six markers of a first frame: none is farther off than half its radius."""
    rng, tracker, off = np.random.default_rng(9), _tracker(), list[float]()
    for _ in range(40):
        tracker.reset()
        struck = rng.choice(24, 6, replace=False)
        radii, turn = rng.uniform(2.0, 5.0, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
        away = (5.0 + radii + rng.uniform(-3.0, 1.0, 6))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        pixels, sizes = np.concatenate([REST, REST[struck] + away]), np.concatenate([np.full(24, 5.0), radii])
        out = np.empty((24, 2))
        found = tracker.track(drawn(pixels, sizes, noise=2.0, rng=rng), out)
        assert np.delete(found, struck).all()
        off += np.linalg.norm(out - REST, axis=1)[found].tolist()
    assert max(off) <= 2.5


def test_one_that_stands_alone_in_a_first_frame_must_be_seen_twice() -> None:
    """Three neighbours hidden, and a stray of a marker's size 13 px from the one between them, which is hidden, too."""
    tracker, seen = _tracker(), np.setdiff1d(np.arange(24), (9, 10, 11))
    inward = (REST.mean(axis=0) - REST[10]) / np.linalg.norm(REST.mean(axis=0) - REST[10])
    stray = drawn(np.concatenate([REST[seen], REST[[10]] + 13.0 * inward]))
    out = np.empty((24, 2))
    assert not tracker.track(stray, out)[10]
    assert not tracker.track(drawn(REST[seen]), out)[10]
    tracker.reset()
    assert tracker.track(drawn(np.delete(REST, (9, 11), axis=0)), out)[10]  # where it rests it is believed at once


def test_hidden_markers_stay_missing_among_stray_blobs_of_their_colour() -> None:
    """Four hidden, ten stray blobs of 2 to 10 px elsewhere in every frame: none is taken for a marker."""
    rng, tracker = np.random.default_rng(8), _tracker()
    hidden = rng.permutation(24)[:4]
    seen = np.setdiff1d(np.arange(24), hidden)
    for k in range(30):
        places = REST + np.array([2.0 * np.sin(0.2 * k), 0.0])
        stray, radii = rng.uniform((0, 0), (640, 480), (10, 2)), rng.uniform(2, 10, 10)
        pixels = np.concatenate([places[seen], stray]) if k else places
        frame = drawn(pixels, np.concatenate([np.full(20, 5.0), radii]) if k else 5.0, noise=2.0, rng=rng)
        out = np.empty((24, 2))
        found = tracker.track(frame, out)
        if not k:
            continue
        apart = np.linalg.norm(stray[None] - places[:, None], axis=-1) - radii
        clear = seen[apart[seen].min(axis=1) > 8]
        assert not found[hidden].any()
        assert found[clear].mean() >= 0.9
        assert np.nanmax(np.abs(out - places)[clear]) <= 2 * CLOSE


def test_frames_that_cannot_be_used_are_told_and_those_after_them_are() -> None:
    rng, tracker = np.random.default_rng(7), _tracker()
    good = [drawn(REST, noise=2.0, rng=rng) for _ in range(3)]
    few = drawn(REST[:10], noise=2.0, rng=rng)
    frames = [good[0], np.zeros_like(good[0]), good[1][:100], *6 * [good[1]], few, good[2]]
    out, _, told = _run(tracker, frames)
    f = FrameProblem
    assert told == [f.OK, f.BLACK, f.WRONG_SIZE, *5 * [f.OK], f.FROZEN, f.LOST, f.OK]
    assert np.isnan(out[[1, 2]]).all()
    assert np.isfinite(out[8]).all()  # a frozen picture still shows markers
    assert np.isfinite(out[9, :10]).all()
    assert np.isnan(out[9, 10:]).all()


def test_a_tracker_says_what_does_not_fit() -> None:
    with pytest.raises(InputError, match="24 markers"):
        MarkerTracker(VIEW, RED, REST[:20], np.full(20, 80.0))
    with pytest.raises(InputError, match="out"):
        _tracker().track(drawn(REST), np.empty((23, 2)))


def test_rings_one_behind_the_other_keep_their_labels() -> None:
    """Three rings, 8 mm deep dents in all of them: a marker pressed in stands where the next ring's marker rested.

    Frame by frame without a past, and followed; four markers of each ring are hidden in half of the touches.
    """
    view = nominal_view(rings=(0.0, 0.01, -0.01))
    tracker, rng = _tracker(view, 3.0), np.random.default_rng(11)
    out = np.empty((72, 2))
    for touch in range(8):
        apart = view.angles - rng.uniform(0, 2 * np.pi)
        dent = np.exp(-0.5 * (np.arctan2(np.sin(apart), np.cos(apart)) / 0.25) ** 2)
        dent *= np.where(view.heights == 0.0, 1.0, 0.7)
        hidden = np.concatenate([24 * ring + rng.permutation(24)[: 4 * (touch % 2)] for ring in range(3)])
        seen = np.setdiff1d(np.arange(72), hidden)
        tracker.reset()
        for share in (1.0, 0.0, 0.3, 0.7, 1.0):
            places = view.rest * (1.0 - share * 0.008 / 0.051 * dent)[:, None]
            pixels = view.from_plane(places, view.heights)
            tracker.track(drawn(pixels[seen], 3.0, noise=1.0, rng=rng), out)
            off = np.linalg.norm(out - pixels, axis=1)
            found = np.isfinite(off)
            assert not found[hidden].any()
            assert off[found].max() < 1.0
            assert found.sum() >= len(seen) - 2
