"""Compiled: from pixels to the centroids of markers, and from candidates around a ring to its labels.

Every loop runs over one frame in one order: the last bits do not depend on how a video is cut.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner

__all__ = ["blob_sums", "doubtful", "label_path", "measure_windows", "plausible", "score_image"]

_OK, _NOTHING, _RIM = 0.0, 1.0, 2.0
_MANY = 1e18
_CAP = 0.3  # of the contrast: a pixel well inside a marker counts no more for being brighter, which is noise


@inlined
def _score(image, y, x, weights):
    """How much a pixel looks like a marker, 0 to 255: a weighted sum of its channels, in sixteenths."""
    blue, green, red = np.int32(image[y, x, 0]), np.int32(image[y, x, 1]), np.int32(image[y, x, 2])
    total = (weights[0] * blue + weights[1] * green + weights[2] * red + weights[3]) >> 4
    return min(max(total, 0), 255)


@entry
def score_image(image, weights, out, histogram):
    """The score of every pixel (h, w) uint8, and how often each score (256,) int64 occurs in every other row."""
    histogram[:] = 0
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            out[y, x] = _score(image, y, x, weights)
        if y % 2 == 0:
            for x in range(image.shape[1]):
                histogram[out[y, x]] += 1


@entry
def blob_sums(score, labels, boxes, base, levels, sums):
    """Of every label: pixels above half of its level, and their score above it: count, w, wx, wy, wxx, wxy, wyy.

    Args:
        score: (h, w) uint8.
        labels: (h, w) int32, 0 is no blob.
        boxes: (k, 5) int32, left, top, width and height of each label.
        base: score of what is no marker.
        levels: (k,) is filled: mean score of the pixels above half of the peak.
        sums: (k, 7) is filled; x and y from the box's corner, so that small numbers keep their bits.
    """
    levels[:] = 0.0
    sums[:] = 0.0
    for k in range(1, len(boxes)):
        left, top, width, height = boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3]
        peak, total, count = 0, 0, 0
        for y in range(top, top + height):
            for x in range(left, left + width):
                if labels[y, x] == k:
                    peak = max(peak, np.int32(score[y, x]))
        for y in range(top, top + height):
            for x in range(left, left + width):
                if labels[y, x] == k and 2 * np.int32(score[y, x]) > peak + base:
                    total += np.int32(score[y, x])
                    count += 1
        levels[k] = total / max(count, 1)
        least, most = 0.5 * (base + levels[k]), _CAP * (levels[k] - base)
        for y in range(top, top + height):
            for x in range(left, left + width):
                weight = score[y, x] - least
                if labels[y, x] == k and weight > 0.0:
                    weight = min(weight, most)
                    dx, dy = x - left, y - top
                    sums[k, 0] += 1.0
                    sums[k, 1] += weight
                    sums[k, 2] += weight * dx
                    sums[k, 3] += weight * dy
                    sums[k, 4] += weight * dx * dx
                    sums[k, 5] += weight * dx * dy
                    sums[k, 6] += weight * dy * dy


@inlined
def _scores(image, weights, x0, y0, height, width, window):
    """Fills a window's scores; their peak and their lowest."""
    peak, low = 0, 255
    for y in range(height):
        for x in range(width):
            score = _score(image, y0 + y, x0 + x, weights)
            window[y, x] = score
            peak = max(peak, score)
            low = min(low, score)
    return peak, low


@inlined
def _value(image, y, x, weights, own):
    """What a pixel is weighed by: its score, or the markers' own channel, which the others' noise does not reach."""
    if own >= 0:
        return np.int32(image[y, x, own])
    return _score(image, y, x, weights)


@inner
def _contrast(image, weights, own, x0, y0, height, width, window, least):
    """Mean value of a window's pixels that are of no marker, and of the blob's, which are marked as taken."""
    inside, outside, count, others = 0.0, 0.0, 0, 0
    for y in range(height):
        for x in range(width):
            if window[y, x] < 0:
                inside += _value(image, y0 + y, x0 + x, weights, own)
                count += 1
            elif window[y, x] <= least:
                outside += _value(image, y0 + y, x0 + x, weights, own)
                others += 1
    return outside / max(others, 1), inside / max(count, 1)


@inner
def _refined(image, weights, own, base, level, reach, middle):
    """The centroid of what stands out around `middle`, into it: weights rise from 30 to 60 % of the contrast.

    So a pixel of the edge counts by how far it is covered, and noise on either side of the edge does not.
    """
    low, span = base + 0.3 * (level - base), 0.3 * (level - base)
    if not span > 0.0:
        return
    for _ in range(2):
        x0, x1 = max(0, int(np.ceil(middle[0] - reach))), min(image.shape[1] - 1, int(np.floor(middle[0] + reach)))
        y0, y1 = max(0, int(np.ceil(middle[1] - reach))), min(image.shape[0] - 1, int(np.floor(middle[1] + reach)))
        total, sx, sy = 0.0, 0.0, 0.0
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                dx, dy = x - middle[0], y - middle[1]
                inside = min(max(reach + 0.5 - np.sqrt(dx * dx + dy * dy), 0.0), 1.0)  # no jump as the disc moves
                weight = inside * min(max((_value(image, y, x, weights, own) - low) / span, 0.0), 1.0)
                total += weight
                sx += weight * dx
                sy += weight * dy
        if not total > 0.0:
            return
        middle[0] += sx / total
        middle[1] += sy / total


@inlined
def _levels(window, height, width, peak, low):
    """The score of what is no marker, the mean of the rim's dimmer part, and of markers, of all above the half."""
    total, count = 0, 0
    for y in range(height):
        step = 1 if y == 0 or y == height - 1 else max(1, width - 1)
        for x in range(0, width, step):
            if 2 * window[y, x] <= peak + low:
                total += window[y, x]
                count += 1
    base = total / count if count else 0.5 * (peak + low)
    half = np.int32(np.floor(0.5 * (peak + base)))  # whole scores are above it as they are above the half
    total, count = 0, 0
    for y in range(height):
        for x in range(width):
            above = window[y, x] > half
            total += window[y, x] * above
            count += above
    return base, (total / count if count else base)


@inlined
def _seed(window, height, width, least, row, column):
    """The pixel above the threshold that is nearest to where the marker is expected; -1: none."""
    if window[int(np.rint(row)), int(np.rint(column))] > least:
        return int(np.rint(row)) * width + int(np.rint(column))
    nearest, best = -1, _MANY
    for y in range(height):
        for x in range(width):
            if window[y, x] > least:
                away = (x - column) * (x - column) + (y - row) * (y - row)
                if away < best:
                    nearest, best = y * width + x, away
    return nearest


@entry
def measure_windows(image, weights, expected, halves, window, stack, out):
    """Each marker's blob, measured in a square window about where it is expected.

    The threshold is half of the window's level, the mean of what is above half of its peak; the blob is what hangs
    together (4 neighbours) with the nearest pixel above it. Its centroid is refined in the markers' own channel.

    Args:
        image: (h, w, 3) uint8.
        weights: (4,) int32 of the score.
        expected: (m, 2) [px]; NaN: not looked for.
        halves: (m,) int64, half the side of each window [px].
        window: (s, s) int32, scratch of the largest window, s = 2 max(halves) + 1.
        stack: (s s,) int32, scratch.
        out: (m, 7) is filled: x, y, pixels, spread (trace of the second moments) [px^2], level above the base,
            pixels above the threshold that belong to something else, and 0 (measured), 1 (nothing) or 2 (cut by rim).
    """
    own, middle = -1, np.empty(2)
    for c in range(3):
        if weights[c] > 0 and weights[(c + 1) % 3] <= 0 and weights[(c + 2) % 3] <= 0:
            own = c
    for i in range(len(expected)):
        out[i, :6] = 0.0
        out[i, 6] = _NOTHING
        ex, ey = expected[i, 0], expected[i, 1]
        if not (ex > -0.5 and ey > -0.5 and ex < image.shape[1] - 0.5 and ey < image.shape[0] - 0.5):
            continue
        cx, cy, half = int(np.rint(ex)), int(np.rint(ey)), halves[i]
        x0, y0 = max(0, cx - half), max(0, cy - half)
        width = min(image.shape[1], cx + half + 1) - x0
        height = min(image.shape[0], cy + half + 1) - y0
        peak, low = _scores(image, weights, x0, y0, height, width, window)
        base, level = _levels(window, height, width, peak, low)
        half, most = 0.5 * (level + base), _CAP * (level - base)
        least = np.int32(np.floor(half))
        above = 0
        for y in range(height):
            for x in range(width):
                above += window[y, x] > least
        seed = _seed(window, height, width, least, ey - y0, ex - x0)
        if seed < 0:
            continue
        count, total, sx, sy, sq, rim = 0, 0.0, 0.0, 0.0, 0.0, False
        stack[0], top = seed, 1
        ax, ay = seed % width, seed // width  # moments about the seed: small numbers keep their bits
        window[ay, ax] = -window[ay, ax] - 1
        while top > 0:
            top -= 1
            place = stack[top]
            y, x = place // width, place % width
            count += 1
            rim |= x == 0 or y == 0 or x == width - 1 or y == height - 1
            weight = min(-window[y, x] - 1 - half, most)
            total += weight
            dx, dy = x - ax, y - ay
            sx += weight * dx
            sy += weight * dy
            sq += weight * (dx * dx + dy * dy)
            for turn in range(4):
                nx = x + (turn == 0) - (turn == 1)
                ny = y + (turn == 2) - (turn == 3)
                if 0 <= nx < width and 0 <= ny < height and window[ny, nx] > least:
                    window[ny, nx] = -window[ny, nx] - 1  # taken, and its score kept
                    stack[top] = ny * width + nx
                    top += 1
        mx, my = sx / total, sy / total
        middle[0], middle[1] = x0 + ax + mx, y0 + ay + my
        reach, which = 1.25 * np.sqrt(count / np.pi) + 2.0, own
        dim, bright = _contrast(image, weights, own, x0, y0, height, width, window, least)
        if bright - dim < 0.8 * (level - base):  # on a bright skin the channel alone tells less than the score
            which = -1
            dim, bright = _contrast(image, weights, which, x0, y0, height, width, window, least)
        _refined(image, weights, which, dim, bright, reach, middle)
        out[i, 0], out[i, 1] = middle[0], middle[1]
        out[i, 2], out[i, 3] = count, sq / total - mx * mx - my * my
        out[i, 4], out[i, 5] = level - base, above - count
        out[i, 6] = _RIM if rim else _OK


@entry
def plausible(got, rest, seen, size, contrast, fits):
    """Which windows show what may be a marker: whole, and of the area, shape and contrast of one.

    Args:
        got: (m, 7) of `measure_windows`.
        rest: (m, 2) area and spread at rest.
        seen: (m,) bool, in the last frame: their mean contrast is the usual one.
        size: greatest ratio of areas.
        contrast: least level above the base.
        fits: (m,) bool is filled.
    """
    total, count = 0.0, 0
    for i in range(len(got)):
        if seen[i]:
            total += got[i, 4]
            count += 1
    least = max(contrast, 0.4 * total / count) if count else contrast
    for i in range(len(got)):
        area = got[i, 2] / rest[i, 0]
        shape = got[i, 3] / rest[i, 1]
        fits[i] = got[i, 6] == _OK and area * size > 1.0 and area < size and shape < 3.0 * area and got[i, 4] > least


@entry
def doubtful(got, fits, seen, sizes, size, alone, rest, gaps):
    """Whether any window leaves a doubt about which marker is where.

    Args:
        got: as of `plausible`, as fits, seen, size and rest.
        fits: (m,) bool.
        seen: (m,) bool.
        sizes: (m,) areas in the last frame.
        size: greatest ratio of areas.
        alone: (m,) bool, no neighbour at rest reaches into the window.
        rest: (m, 2) area and spread at rest.
        gaps: (m,) to the nearest neighbour at rest [px].
    """
    m = len(got)
    for i in range(m):
        if fits[i] != seen[i]:
            return True
        if not seen[i]:
            continue
        if got[i, 2] * size <= sizes[i] or got[i, 2] >= sizes[i] * size:
            return True
        if alone[i] and got[i, 5] >= 0.25 * rest[i, 0]:
            return True
        j = (i + 1) % m
        if seen[j] and np.hypot(got[i, 0] - got[j, 0], got[i, 1] - got[j, 1]) < 0.3 * gaps[i]:
            return True
    return False


@inlined
def _rough(a, b, gap, steady, share):
    """What it costs that two markers `gap` apart are displaced by a and b: small where both are, free where steep."""
    scale = (steady + share * max(np.hypot(a[0], a[1]), np.hypot(b[0], b[1]))) * np.sqrt(gap)
    return ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / (2.0 * scale * scale)


@entry
def label_path(first, moved, own, settings, chosen):
    """The candidates around a ring that are cheapest together.

    A path runs twice around the ring, from candidate to candidate, and may leave markers out; the middle turn is the
    answer, so that it matters nowhere where the path begins. [Viterbi 1967]

    Args:
        first: (m + 1,) int64, candidates first[i] to first[i + 1] are of marker i.
        moved: (k, 2) their displacement from rest.
        own: (k,) what each costs by itself.
        settings: (4,) cost of a marker left out; scale of displacement at rest; its share of the displacement; longest
            gap over which neighbours tell anything.
        chosen: (m,) int64 is filled, -1: missing.
    """
    m, k = len(first) - 1, len(moved)
    missing, steady, share, longest = settings[0], settings[1], settings[2], int(settings[3])
    cost = np.full(2 * k + 1, _MANY)
    back = np.full(2 * k + 1, -1)
    marker = np.empty(k, np.int64)
    for i in range(m):
        for c in range(first[i], first[i + 1]):
            marker[c] = i
    for late in range(2 * k):
        c, i = late % k, marker[late % k] + m * (late // k)
        cost[late] = own[c] + missing * i  # the path may begin here
        for early in range(late):
            j = marker[early % k] + m * (early // k)
            gap = i - j
            if gap < 1:
                continue
            price = missing * (gap - 1) + own[c] + cost[early]
            if gap <= longest:
                price += _rough(moved[early % k], moved[c], gap, steady, share)
            if price < cost[late]:
                cost[late], back[late] = price, early
    best, last = _MANY, -1
    for late in range(2 * k):
        price = cost[late] + missing * (2 * m - 1 - marker[late % k] - m * (late // k))
        if price < best:
            best, last = price, late
    chosen[:] = -1
    while last >= 0:
        i = marker[last % k] + m * (last // k)
        if m // 2 <= i < m // 2 + m:
            chosen[i % m] = last % k
        last = back[last]
