"""Compiled: match the touches of a frame with those of the frames before."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry

TRACKS = 128  # touches that are remembered
TRACK = 8  # identity (-1: free), position (3), velocity (3), time it was last seen


@entry(
    """
    time float, points n 3, count int, tracks out 128 8, following out int64 1, reach float, speed float, patience
    float, identity out int64 m
    """
)
def follow(time, points, count, tracks, following, reach, speed, patience, identity):
    """Write identities of `count` touches at `points` (n, 3) [m]; `tracks` (TRACKS, TRACK) and `following` (1,) change.

    Touches and predicted tracks are paired from the nearest on, within reach + speed dt. A touch that is lost is waited
    for during `patience` [s]: two that merge for a moment separate with their old identities. Distances are measured in
    space, so that the seam of a sheet is no gap.
    """
    count = min(count, len(points), len(identity))
    for t in range(len(tracks)):
        if tracks[t, 0] >= 0.0 and not abs(time - tracks[t, 7]) <= patience:
            tracks[t, 0] = -1.0
    taken = np.zeros(len(tracks), dtype=np.bool_)
    identity[:count] = -1
    for _ in range(count):
        best, which, whose = np.inf, -1, -1
        for t in range(len(tracks)):
            if tracks[t, 0] < 0.0 or taken[t]:
                continue
            dt = time - tracks[t, 7]
            limit = reach + speed * abs(dt)
            for i in range(count):
                if identity[i] >= 0:
                    continue
                still, ahead = 0.0, 0.0
                for c in range(3):
                    apart = points[i, c] - tracks[t, 1 + c]
                    still += apart * apart
                    ahead += (apart - tracks[t, 4 + c] * dt) ** 2
                if still <= limit * limit and ahead < best:
                    best, which, whose = ahead, i, t
        if which < 0:
            break
        taken[whose] = True
        identity[which] = int(tracks[whose, 0])
        dt = time - tracks[whose, 7]
        for c in range(3):
            if dt > 0.0:
                tracks[whose, 4 + c] += 0.5 * ((points[which, c] - tracks[whose, 1 + c]) / dt - tracks[whose, 4 + c])
            tracks[whose, 1 + c] = points[which, c]
        tracks[whose, 7] = time
    for i in range(count):
        if identity[i] >= 0:
            continue
        identity[i] = following[0]
        following[0] += 1
        for t in range(len(tracks)):
            if tracks[t, 0] < 0.0:
                tracks[t, 0] = identity[i]
                tracks[t, 1:4] = points[i]
                tracks[t, 4:7] = 0.0
                tracks[t, 7] = time
                break
