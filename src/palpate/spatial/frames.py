"""A tree of frames, and the pose of one frame in another over time."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose
from palpate.spatial.pose_track import PoseTrack

Edge = Pose | PoseTrack  # T_parent_child: always, or over time


class FrameTree:
    """Tree of frames, each with its pose in its parent.

    Args:
        edges: parent, child, and T_parent_child of each.
    """

    def __init__(self, edges: Iterable[tuple[str, str, Edge]] = ()) -> None:
        self._parents: dict[str, dict[str, Edge]] = {}  # child -> its parents; more than one is an error on a path
        for parent, child, edge in edges:
            self.add(parent, child, edge)

    def add(self, parent: str, child: str, edge: Edge) -> None:
        """Add the edge T_parent_child to the tree; it replaces an earlier edge of the same two frames."""
        self._parents.setdefault(parent, {})
        self._parents.setdefault(child, {})[parent] = edge

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, a tuple in the order in which they were added."""
        return tuple(self._parents)

    def up(self, frame: str) -> tuple[str, ...]:
        """Return the names of a frame, its parent, and so on up to the root, as a tuple.

        Raises:
            InputError: there is no such frame; one on the way has two parents, or is its own ancestor.
        """
        return self._climb(frame, None)

    def path(self, base: str, sensor: str) -> FramePath:
        """Return the edges from one frame to another as a `FramePath`, by way of their nearest common ancestor.

        Raises:
            InputError: there is no such frame; nothing joins the two; one on the way has two parents, or is its own
                ancestor.
        """
        up = self._climb(sensor, base)
        if up[-1] == base:
            return FramePath((base, *up[-2::-1]), self._down(up))
        down = self._climb(base, None)
        meet = next((frame for frame in up if frame in down), None)
        if meet is None:
            raise InputError(
                f"no transform joins frame {base!r} (tree of {down[-1]!r}) and frame {sensor!r} (tree of {up[-1]!r}).",
                hint="Name frames of one tree, or record the transform between the two trees.",
            )
        up, down = up[: up.index(meet) + 1], down[: down.index(meet) + 1]
        back = tuple((edge, True) for edge, _ in reversed(self._down(down)))
        return FramePath((*down, *up[-2::-1]), (*back, *self._down(up)))

    def _down(self, up: tuple[str, ...]) -> tuple[tuple[Edge, bool], ...]:
        """Return the edges from the last frame down to the first."""
        pairs = list(zip(up[1:], up, strict=False))
        return tuple((self._parents[child][parent], False) for parent, child in reversed(pairs))

    def _climb(self, frame: str, top: str | None) -> tuple[str, ...]:
        """Return the frames from one up to `top`, if that is above it, else to the root."""
        for name in (frame, top):
            if name is not None and name not in self._parents:
                close = difflib.get_close_matches(name, self.frames, n=6, cutoff=0.0)
                listed = ", ".join(close) or "none"
                raise InputError(
                    f"there is no frame {name!r}.",
                    hint=f"Use one of the {len(self.frames)} frames, of which these are nearest in name: {listed}.",
                )
        way = [frame]
        while way[-1] != top and (parents := self._parents[way[-1]]):
            if len(parents) > 1:
                raise InputError(
                    f"frame {way[-1]!r} has {len(parents)} parents: {', '.join(parents)}.",
                    hint="Stop one of the publishers that contradict each other, or name a base below that frame.",
                )
            above = next(iter(parents))
            if above in way:
                loop = " -> ".join((*way[way.index(above) :], above))
                raise InputError(
                    f"the frames form a loop: {loop}.", hint="Remove a transform, so that they form a tree."
                )
            way.append(above)
        return tuple(way)


@frozen_value
class FramePath:
    """The edges between two frames, as one track of poses with the methods of a `PoseTrack`.

    Attributes:
        frames: from the target (base) to the source (sensor).
        steps: edge, and whether it is passed from the child to its parent; one fewer than frames.
    """

    frames: tuple[str, ...]
    steps: tuple[tuple[Edge, bool], ...]

    @property
    def tracks(self) -> tuple[PoseTrack, ...]:
        """Moving edges, a tuple of `PoseTrack`."""
        return tuple(edge for edge, _ in self.steps if isinstance(edge, PoseTrack))

    def at(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4), positions (n, 3) [m] of the source in the target: T_0_1 @ T_1_2 @ ...

        They are at times (n,) [s]; each edge is interpolated as by `PoseTrack.at`. NaN where one has no answer.

        Raises:
            InputError: the times are not (n,) numbers.
        """
        from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

        if len(self.steps) == 1 and not self.steps[0][1]:
            return _edge_at(self.steps[0][0], time)
        poses = [_edge_at(edge, time) for edge, _ in self.steps]
        known = np.ones(len(time), dtype=bool)
        for quaternion, _ in poses:
            known &= np.isfinite(quaternion).all(axis=1)
        count = int(np.count_nonzero(known))
        turn, position = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 3))
        for (quaternion, shift), (_, inverted) in zip(poses, self.steps, strict=True):
            turned, moved = Rotation.from_quat(quaternion[known]), shift[known]
            with np.errstate(invalid="ignore"):  # an infinite position
                if inverted:
                    turned = turned.inv()
                    moved = -turned.apply(moved)
                position = position + Rotation.from_quat(turn).apply(moved)
            turn = _product(turn, turned.as_quat())
        answers = np.full((len(time), 7), np.nan)
        answers[known, :4], answers[known, 4:] = turn, position
        return answers[:, :4], answers[:, 4:]

    @property
    def stamps(self) -> Float[np.ndarray, " k"]:
        """Stamps of the edge with the most poses, (k,) [s]; empty if no edge moves."""
        return max((track.stamps for track in self.tracks), key=len, default=np.zeros(0))

    def answerable(self, time: Float[np.ndarray, " n"]) -> int:
        """Return how many of the times (n,) [s], from the first on, have answers that later poses will not change.

        Raises:
            InputError: time has another shape.
        """
        return min((track.answerable(time) for track in self.tracks), default=len(time))

    def complete(self) -> None:
        """Declare that no more poses will come: `answerable` then counts all times."""
        for track in self.tracks:
            track.complete()

    def forget(self, before: float) -> None:
        """Drop the poses that answers at `before` [s] and later do not need."""
        for track in self.tracks:
            track.forget(before)

    def notes(self) -> tuple[str, ...]:
        """Return how many poses of each moving edge were left out and why, a tuple of sentences; () without any."""
        names = zip(self.frames, self.frames[1:], strict=False)
        return tuple(
            f"between frames {first} and {second}: {note}"
            for (first, second), (edge, _) in zip(names, self.steps, strict=True)
            if isinstance(edge, PoseTrack)
            for note in edge.notes()
        )


def _edge_at(edge: Edge, time: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    if isinstance(edge, PoseTrack):
        return edge.at(time)
    return np.tile(edge.quaternion(), (len(time), 1)), np.tile(edge.translation, (len(time), 1))


def _product(left: Float[np.ndarray, "n 4"], right: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Return Hamilton's product, the rotation `right` before `left`; SciPy's takes twenty times as long."""
    (a, b, c, w), (x, y, z, v) = left.T, right.T
    parts = (w * x + a * v + b * z - c * y, w * y - a * z + b * v + c * x, w * z + a * y - b * x + c * v)
    return np.stack([*parts, w * v - a * x - b * y - c * z], axis=1)
