"""Compiled: from pixels to the centroids of markers, and from candidates around a ring to its labels.

Every loop runs over one image in one order: the last bits do not depend on how a video is cut.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner, released

_OK, _NOTHING, _RIM = 0.0, 1.0, 2.0
_MANY = 1e18
_GROWN, _OFF, _TORN = 0.15, 0.25, 12.0  # deviations of a log area and of a place over the radius; squares that doubt
_PULLED = 0.4  # of a marker's root mean square radius: farther a stray blob that has run into it may not move it
_CAP = 0.3  # of the contrast: a pixel well inside a marker counts no more for being brighter, which is noise


@inner
def _score(flat, at, weights):
    """Return how much the pixel that begins at `at` looks like a marker, 0 to 255: its channels' weighted sum over 16.

    Indices are unsigned, and numbers have 32 bits, so that loops over it become vector instructions.
    """
    blue, green, red = np.int32(flat[at]), np.int32(flat[at + np.uintp(1)]), np.int32(flat[at + np.uintp(2)])
    total = np.int32(np.int32(weights[0] * blue + weights[1] * green + weights[2] * red + weights[3]) >> 4)
    return np.uint8(min(max(total, np.int32(0)), np.int32(255)))


@released("image uint8 h w 3, every int, lit int, sample out uint8 a b")
def sampled(image, every, lit, sample):
    """Count the bytes above `lit` in every `every`-th row, and tell whether those rows equal `sample`, which is filled.

    Args:
        image: (h, w, 3) uint8, contiguous.
        every: rows; the first is at half of it.
        lit: level.
        sample: (rows, 3 w) uint8.
    """
    count, changed, least = 0, 0, np.uint8(lit)
    for k in range(len(sample)):
        row, before = image[every // 2 + k * every].reshape(-1), sample[k]
        bright, off = np.int32(0), np.uint8(0)
        for x in range(len(before)):
            bright = np.int32(bright + np.int32(row[x] > least))
            off = np.uint8(off | (row[x] ^ before[x]))
            before[x] = row[x]
        count += bright
        changed |= off
    return count, changed == 0


@released("image uint8 h w 3, weights int32 4, out out uint8 h w, histogram out int64 256")
def score_image(image, weights, out, histogram):
    """Compute the score of every pixel, (h, w) uint8, and the histogram (256,) int64 of every other row's scores."""
    histogram[:] = 0
    for y in range(image.shape[0]):
        row = image[y].reshape(-1)
        for x in range(image.shape[1]):
            out[y, x] = _score(row, np.uintp(3 * x), weights)
        if y % 2 == 0:
            for x in range(image.shape[1]):
                histogram[out[y, x]] += 1


@released("score uint8 h w, labels int32 h w, boxes int32 k 5, base float, levels out k, sums out k 7")
def blob_sums(score, labels, boxes, base, levels, sums):
    """Sum for every label the pixels above half of its level, weighted by score: count, w, wx, wy, wxx, wxy, wyy.

    Args:
        score: (h, w) uint8.
        labels: (h, w) int32, 0 is no blob.
        boxes: (k, 5) int32, left, top, width, height and area of each label.
        base: score of the background.
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


@inner
def _scores(flat, columns, weights, own, x0, y0, width, scores, values):
    """Fill a window's scores, row after row, and the values that weigh its pixels.

    The values are the scores, or the markers' own channel, which the noise of the other channels does not reach.
    """
    for y in range(len(scores) // width):
        first = 3 * ((y0 + y) * columns + x0)
        row, score = flat[first : first + 3 * width], scores[y * width : (y + 1) * width]
        for x in range(width):
            score[x] = _score(row, np.uintp(3 * x), weights)
        value = values[y * width : (y + 1) * width]
        if own >= 0:
            for x in range(width):
                value[x] = row[np.uintp(3 * x + own)]
        else:
            for x in range(width):
                value[x] = score[x]


@inner
def _range(scores):
    """Return the lowest and the highest score."""
    low, peak = np.uint8(255), np.uint8(0)
    for score in scores:
        low, peak = min(low, score), max(peak, score)
    return np.int64(low), np.int64(peak)


@inner
def _above(scores, least):
    """Return the number of scores above a threshold, and their sum."""
    count, total = np.int32(0), np.int32(0)
    for score in scores:
        above = np.int32(score > least)
        count = np.int32(count + above)
        total = np.int32(total + np.int32(score) * above)
    return np.int64(count), np.int64(total)


@inner
def _others(scores, values, least):
    """Return the sum of the values of pixels whose scores are not above a threshold."""
    total = np.int32(0)
    for k in range(len(scores)):
        total = np.int32(total + np.int32(values[k]) * np.int32(scores[k] <= least))
    return np.int64(total)


@inner
def _base(scores, width, peak, low):
    """Return the score of the background: the mean of the rim's dimmer part."""
    height, total, count = len(scores) // width, 0, 0
    for y in range(height):
        step = 1 if y == 0 or y == height - 1 else max(1, width - 1)
        for x in range(0, width, step):
            score = np.int64(scores[y * width + x])
            if 2 * score <= peak + low:
                total += score
                count += 1
    return total / count if count else 0.5 * (peak + low)


@inner
def _seed(scores, width, least, row, column):
    """Return the pixel above the threshold that is nearest to where the marker is expected; -1: none."""
    middle = int(np.rint(row)) * width + int(np.rint(column))
    if scores[middle] > least:
        return middle
    nearest, best = -1, _MANY
    for y in range(len(scores) // width):
        for x in range(width):
            if scores[y * width + x] > least:
                away = (x - column) * (x - column) + (y - row) * (y - row)
                if away < best:
                    nearest, best = y * width + x, away
    return nearest


@inner
def _refined(flat, rows, columns, weights, own, base, level, reach, middle, bright):
    """Refine `middle` to the centroid of the bright pixels around it: weights rise from 30 to 60 % of the contrast.

    So a pixel of the edge counts by how far it is covered, and noise on either side of the edge does not. `bright`
    (n, 3) int32 is scratch: only pixels that weigh anything are gone through.
    """
    low, span = base + 0.3 * (level - base), 0.3 * (level - base)
    if not span > 0.0:
        return
    near, far = max(reach - 0.5, 0.0) ** 2 * (1.0 - 1e-9), (reach + 0.5) ** 2 * (1.0 + 1e-9)
    for _ in range(2):
        x0, x1 = max(0, int(np.ceil(middle[0] - reach))), min(columns - 1, int(np.floor(middle[0] + reach)))
        y0, y1 = max(0, int(np.ceil(middle[1] - reach))), min(rows - 1, int(np.floor(middle[1] + reach)))
        count = np.uintp(0)
        for y in range(y0, y1 + 1):
            at = np.uintp(3 * (y * columns + x0))
            for x in range(x0, x1 + 1):
                value = flat[at + np.uintp(own)] if own >= 0 else _score(flat, at, weights)
                at += np.uintp(3)
                bright[count, 0], bright[count, 1], bright[count, 2] = x, y, value
                count += np.uintp(value > low)
        total, sx, sy = 0.0, 0.0, 0.0
        for k in range(count):
            dx, dy = bright[k, 0] - middle[0], bright[k, 1] - middle[1]
            square = dx * dx + dy * dy
            if square > far:
                continue
            weight = min((bright[k, 2] - low) / span, 1.0)
            if square > near:  # no jump as the disc moves
                weight *= min(max(reach + 0.5 - np.sqrt(square), 0.0), 1.0)
            total += weight
            sx += weight * dx
            sy += weight * dy
        if not total > 0.0:
            return
        middle[0] += sx / total
        middle[1] += sy / total


@inner
def _window(expected, half, rows, columns):
    """Return left, top, width and height of a marker's window, and whether the marker is looked for at all."""
    ex, ey = expected[0], expected[1]
    if not (ex > -0.5 and ey > -0.5 and ex < columns - 0.5 and ey < rows - 0.5):
        return 0, 0, 0, 0, False
    cx, cy = int(np.rint(ex)), int(np.rint(ey))
    x0, y0 = max(0, cx - half), max(0, cy - half)
    return x0, y0, min(columns, cx + half + 1) - x0, min(rows, cy + half + 1) - y0, True


@inner
def _fetched(flat, rows, columns, expected, halves):
    """Read a byte of each cache line of the windows; the sum that it returns means nothing.

    Reads that nothing waits for go on side by side: an image that is not in the cache is measured a quarter faster.
    """
    total = 0
    for i in range(len(expected)):
        x0, y0, width, height, there = _window(expected[i], halves[i], rows, columns)
        if there:
            for y in range(y0, y0 + height):
                first = 3 * (y * columns + x0)
                for k in range(first, first + 3 * width, 64):
                    total += flat[k]
                total += flat[first + 3 * width - 1]
    return total


@released("image uint8 h w 3, weights int32 4, expected n 2, halves int64 n, out out n 7")
def measure_windows(image, weights, expected, halves, out):
    """Measure each marker's blob in a square window about where it is expected.

    The threshold is half of the window's level, the mean of the scores above half of its peak; the blob is the pixels
    above it that are connected (4 neighbours) to the nearest one. Its centroid is refined in the markers' own channel.

    Args:
        image: (h, w, 3) uint8, contiguous.
        weights: (4,) int32 of the score.
        expected: (n, 2) [px]; NaN: not looked for.
        halves: (n,) int64, half the side of each window [px].
        out: (n, 7) is filled: x, y, pixels, spread (trace of the second moments) [px^2], level above the base,
            pixels above the threshold that belong to something else, and 0 (measured), 1 (nothing) or 2 (cut by rim).
    """
    own, middle, side = -1, np.empty(2), 0
    for c in range(3):
        if weights[c] > 0 and weights[(c + 1) % 3] <= 0 and weights[(c + 2) % 3] <= 0:
            own = c
    for half in halves:
        side = max(side, 2 * half + 1)
    rows, columns, flat = image.shape[0], image.shape[1], image.reshape(-1)
    all_scores, all_values = np.empty(side * side, np.uint8), np.empty(side * side, np.uint8)
    stack = np.empty((side * side, 2), np.int32)
    bright = np.empty(((int(1.5 * side) + 8) ** 2, 3), np.int32)  # as wide as a disc that fills a window is refined in
    bright[0, 0] = _fetched(flat, rows, columns, expected, halves)
    for i in range(len(expected)):
        out[i, :6] = 0.0
        out[i, 6] = _NOTHING
        x0, y0, width, height, there = _window(expected[i], halves[i], rows, columns)
        if not there:
            continue
        size = width * height
        scores, values = all_scores[:size], all_values[:size]
        _scores(flat, columns, weights, own, x0, y0, width, scores, values)
        low, peak = _range(scores)
        base = _base(scores, width, peak, low)
        count, sum_ = _above(scores, np.uint8(np.floor(0.5 * (peak + base))))  # whole scores: as above the half
        level = sum_ / count if count else base
        half, most = 0.5 * (level + base), _CAP * (level - base)
        least = np.uint8(np.floor(half))
        above, _ = _above(scores, least)
        dark = _others(scores, values, least)
        seed = _seed(scores, width, least, expected[i, 1] - y0, expected[i, 0] - x0)
        if seed < 0:
            continue
        count, total, sx, sy, sq, rim = 0, 0.0, 0.0, 0.0, 0.0, False
        sum_, lit = 0, 0  # of the blob's scores and values
        ax, ay = seed % width, seed // width  # moments about the seed: small numbers keep their bits
        stack[0, 0], stack[0, 1], top = seed, scores[seed], 1
        scores[seed] = 0  # taken
        while top > 0:
            top -= 1
            place, score = np.int64(stack[top, 0]), np.int64(stack[top, 1])
            y, x = place // width, place % width
            count += 1
            sum_ += score
            lit += values[place]
            rim |= x == 0 or y == 0 or x == width - 1 or y == height - 1
            weight = min(score - half, most)
            total += weight
            dx, dy = x - ax, y - ay
            sx += weight * dx
            sy += weight * dy
            sq += weight * (dx * dx + dy * dy)
            for turn in range(4):
                nx = x + (turn == 0) - (turn == 1)
                ny = y + (turn == 2) - (turn == 3)
                if 0 <= nx < width and 0 <= ny < height:
                    beside = ny * width + nx
                    if scores[beside] > least:
                        stack[top, 0], stack[top, 1] = beside, scores[beside]
                        scores[beside] = 0
                        top += 1
        mx, my = sx / total, sy / total
        middle[0], middle[1] = x0 + ax + mx, y0 + ay + my
        if 10 * (above - count) <= count:  # nothing else stands out nearby, which the disc would take in
            reach, which = 1.25 * np.sqrt(count / np.pi) + 2.0, own
            outside, inside = dark / max(size - above, 1), lit / count
            if inside - outside < 0.8 * (level - base):  # on a bright skin the channel alone tells less than the score
                which = -1
                outside, inside = _others(scores, scores, least) / max(size - above, 1), sum_ / count
            _refined(flat, rows, columns, weights, which, outside, inside, reach, middle, bright)
        out[i, 0], out[i, 1] = middle[0], middle[1]
        out[i, 2], out[i, 3] = count, sq / total - mx * mx - my * my
        out[i, 4], out[i, 5] = level - base, above - count
        out[i, 6] = _RIM if rim else _OK


@entry("got n 7, rest n 2, seen bool n, size float, contrast float, fits out bool n")
def plausible(got, rest, seen, size, contrast, fits):
    """Mark the windows that show one complete marker alone, of its usual area, shape and contrast.

    A stray blob of q times the marker's mass, at a distance D, moves the centroid of both by s = D q / (1 + q), and
    adds D^2 q / (1 + q)^2 = s^2 / q to the second moments: so if area and moments are too large by q and by e times
    the marker's own, s is the root of q e times its root mean square radius.

    Args:
        got: (n, 7) of `measure_windows`.
        rest: (n, 2) area and spread at rest.
        seen: (n,) bool, in the last image, or found in this: their mean contrast and area are the usual ones.
        size: greatest ratio of areas.
        contrast: least level above the base.
        fits: (n,) bool is filled.
    """
    total, large, count = 0.0, 0.0, 0
    for i in range(len(got)):
        if seen[i]:
            total += got[i, 4]
            large += got[i, 2] / rest[i, 0]
            count += 1
    least = max(contrast, 0.4 * total / count) if count else contrast
    usual = large / count if count else 1.0
    for i in range(len(got)):
        area = got[i, 2] / rest[i, 0]
        shape = got[i, 3] / rest[i, 1]
        alone = max(area / usual - 1.0, 0.0) * max(shape / usual - 1.0, 0.0) < _PULLED * _PULLED
        like = area * size > 1.0 and area < size and shape < 3.0 * area
        fits[i] = got[i, 6] == _OK and like and alone and got[i, 4] > least


@inner
def _doubtful(got, fits, seen, expected, sizes, size, alone, rest, gaps, pairs):
    """Return whether any window leaves open which marker is where.

    A marker that changes its size and leaves its path at the same time may have something of its colour next to it.

    Args:
        got: see `plausible`, also for fits, seen, size and rest.
        fits: (m,) bool.
        seen: (m,) bool.
        expected: (m, 2) [px].
        sizes: (m,) areas in the last image.
        size: greatest ratio of areas.
        alone: (m,) bool, no neighbour at rest reaches into the window.
        rest: (m, 2) area and spread at rest.
        gaps: (m,) to the nearest neighbour at rest [px].
        pairs: (p, 2) int64, markers that must not be in the same place.
    """
    for i in range(len(got)):
        if fits[i] != seen[i]:
            return True
        if not seen[i]:
            continue
        if got[i, 2] * size <= sizes[i] or got[i, 2] >= sizes[i] * size:
            return True
        off = (got[i, 0] - expected[i, 0]) ** 2 + (got[i, 1] - expected[i, 1]) ** 2
        if (np.log(got[i, 2] / sizes[i]) / _GROWN) ** 2 + np.pi * off / (_OFF * _OFF * rest[i, 0]) > _TORN:
            return True
        if alone[i] and got[i, 5] >= 0.25 * rest[i, 0]:
            return True
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if seen[i] and seen[j] and np.hypot(got[i, 0] - got[j, 0], got[i, 1] - got[j, 1]) < 0.3 * gaps[i]:
            return True
    return False


@released(
    """
    image uint8 h w 3, weights int32 4, known (int64 n, n 2, bool n, n, int64 m 2), limits (float, float, float),
    got out n 7, seen bool n, expected out n 2, last out n 2, step out n 2, sizes out n, age out int64 n, out out
    n 2
    """
)
def follow(image, weights, known, limits, got, seen, expected, last, step, sizes, age, out):
    """Measure the markers in their windows and take the result, unless a window is ambiguous; return whether it did.

    Args:
        image: see `measure_windows`.
        weights: see `measure_windows`.
        known: half sides of the windows (n,) int64; areas and spreads at rest (n, 2); no neighbour at rest reaches into
            the window (n,) bool; gaps to the nearest neighbour at rest (n,) [px]; `pairs` of `_doubtful`.
        limits: greatest ratio of areas, least level above the base, the longest step that is continued [px].
        got: (n, 7) is filled by `measure_windows`.
        seen: (n,) bool, in the last image.
        expected: (n, 2) [px] of the markers not seen; filled for those seen: one step on.
        last: (n, 2) last places of the markers [px]; changed if the result is taken, like the following arrays.
        step: (n, 2) from the image before the last [px].
        sizes: (n,) areas.
        age: (n,) int64, images since a marker was seen.
        out: (n, 2) is filled if the result is taken: equal to `last`, NaN for markers not seen.
    """
    halves, rest, alone, gaps, pairs = known
    size, contrast, longest = limits
    for i in range(len(got)):
        for a in range(2):
            if seen[i]:
                expected[i, a] = last[i, a] + min(max(step[i, a], -longest), longest)
    measure_windows(image, weights, expected, halves, got)
    fits = np.empty(len(got), np.bool_)
    plausible(got, rest, seen, size, contrast, fits)
    if _doubtful(got, fits, seen, expected, sizes, size, alone, rest, gaps, pairs):
        return False
    for i in range(len(got)):
        for a in range(2):
            step[i, a] = got[i, a] - last[i, a] if seen[i] else 0.0
            last[i, a] = got[i, a] if seen[i] else last[i, a]
            out[i, a] = got[i, a] if seen[i] else np.nan
        sizes[i] = got[i, 2] if seen[i] else sizes[i]
        age[i] = 0 if seen[i] else age[i] + 1
    return True


@inlined
def _rough(a, b, gap, steady, share):
    """Return the cost of displacements a and b of two markers `gap` apart: their difference, over its usual size."""
    scale = (steady + share * max(np.hypot(a[0], a[1]), np.hypot(b[0], b[1]))) * np.sqrt(gap)
    return ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / (2.0 * scale * scale)


@released("first int64 m+1, moved k 2, own k, settings 4, chosen out int64 m")
def label_path(first, moved, own, settings, chosen):
    """Choose the candidates around a ring that are cheapest together.

    A path runs twice around the ring, from candidate to candidate, and may leave markers out; the middle turn is the
    answer, so that the start of the path matters nowhere [Viterbi 1967].

    Args:
        first: (m + 1,) int64, candidates first[i] to first[i + 1] are of marker i.
        moved: (k, 2) their displacement from rest.
        own: (k,) each candidate's own cost.
        settings: (4,) cost of a marker left out; scale of displacement at rest; its share of the displacement; longest
            gap over which neighbours predict anything.
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
