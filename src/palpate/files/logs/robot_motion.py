"""Read the motion of a robot's links from a log: their poses in the base, from joint states or from /tf."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.decoding import seconds
from palpate.files.logs.joints import joint_positions, joint_stamps, joint_topic
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.opening import messages_of, read_recording
from palpate.files.logs.transforms import TreePoses, read_frames, tree_topics
from palpate.files.messages import MessageFile, Topic
from palpate.files.urdf import Kinematics, Urdf
from palpate.signals._curvature import turns
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose_track import PoseTrack

TF = "/tf"
"""Name that stands for /tf and /tf_static as the source of the links' poses."""
_CHUNK = 4096  # joint samples whose poses are computed at once
_KEPT = 4  # chunks that are kept: sensors are read side by side in time
_JUMP = 3.0  # of a joint's speed limit, beyond which a step cannot be its motion
_FASTEST = 50.0  # rad/s, m/s: without a limit
_BEYOND, _OFTEN = 0.05, 0.01  # of a joint's range, and share of its samples: beyond the limits by more, and more often
_STILL, _HUNG, _CHANGES = 1.0, 100, 0.9  # s and samples that a hung encoder repeats at least; of its others that change
_SLIGHT = 3e-5  # rad, m: errors of the interpolation that are none
_LOST = 1.0  # s of a log without joint states, beyond which that is stated


@takes_arrays
class JointSamples:
    """Positions of joints over time, and the poses of the links that they move.

    Args:
        kinematics: of the links.
        time: (m,) [s] stamps that rise.
        positions: (m, j) [rad, m] of `kinematics.joints`.
        max_gap: [s] between neighbours, beyond which there is no answer between them.

    Raises:
        InputError: arrays of other shapes.
    """

    def __init__(
        self, kinematics: Kinematics, time: Float[np.ndarray, " m"], positions: Float[np.ndarray, "m j"], max_gap: float
    ) -> None:
        self.kinematics, self.time, self.positions, self._max_gap = kinematics, time, positions, max_gap
        self._chunks = dict[int, tuple[np.ndarray, np.ndarray]]()

    def at(self, link: str, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] of a link in the base; NaN where not known.

        At a joint sample they are exact; between two the pose is interpolated as by `PoseTrack`.

        Raises:
            InputError: time has another shape.
        """
        track = PoseTrack(0.0, self._max_gap)
        for near in self._near(link, time, 0):
            track.add(*near)
        track.complete()
        return track.at(time)

    def _near(self, link: str, time: np.ndarray, more: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield stamps, quaternions and positions of a link about times, with so many samples `more` at each end."""
        known = time[np.isfinite(time)]
        first, last = (known.min(), known.max()) if len(known) else (np.inf, -np.inf)
        start = max(int(np.searchsorted(self.time, first, side="right")) - 1 - more, 0)
        end = min(int(np.searchsorted(self.time, last)) + 1 + more, len(self.time))
        place = self.kinematics.links.index(link)
        for chunk in range(start // _CHUNK, -(-end // _CHUNK)):
            quaternion, position = self._poses(chunk)
            rows = slice(max(start - chunk * _CHUNK, 0), end - chunk * _CHUNK)
            stamps = self.time[chunk * _CHUNK : (chunk + 1) * _CHUNK][rows]
            yield stamps, quaternion[rows, place], position[rows, place]

    def _poses(self, chunk: int) -> tuple[Float[np.ndarray, "c k 4"], Float[np.ndarray, "c k 3"]]:
        """Return the poses of all links at the joint samples of a chunk."""
        if chunk not in self._chunks:
            while len(self._chunks) >= _KEPT:
                del self._chunks[min(self._chunks)]
            self._chunks[chunk] = self.kinematics.poses(self.positions[chunk * _CHUNK : (chunk + 1) * _CHUNK])
        return self._chunks[chunk]

    def covariance(self, link: str, time: Float[np.ndarray, " n"], encoder: float) -> Float[np.ndarray, "n 6 6"]:
        """Return covariances (n, 6, 6) of the rotation vector [rad] and translation [m] of a link's poses, in the base.

        They are those of the encoders at the nearest joint sample, and of the interpolation between two; NaN without
        any sample.

        Args:
            link: name of the link.
            time: (n,) [s].
            encoder: standard deviation [rad] of the position of each joint that turns.

        Raises:
            InputError: time has another shape.
        """
        if not len(self.time):
            return np.full((len(time), 6, 6), np.nan)
        between = self._between(link, time)
        if not encoder:
            return between
        nearest = np.searchsorted((self.time[1:] + self.time[:-1]) / 2.0, time)
        rows, row_of = np.unique(nearest, return_inverse=True)
        slope = self.kinematics.jacobians(self.positions[rows], link)[..., self.kinematics.turning]
        return (encoder**2 * slope @ np.swapaxes(slope, 1, 2))[row_of] + between

    def _between(self, link: str, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 6 6"]:
        """Return the covariances (n, 6, 6) of poses between two joint samples, by the accelerations at both.

        At a share s of a step h, interpolation misses what an acceleration a does: s (1 - s) h^2 a / 2.
        """
        stamps, quaternion, position = (np.concatenate(part) for part in zip(*self._near(link, time, 1), strict=True))
        if len(stamps) < 3:
            return np.zeros((len(time), 6, 6))
        steps, moved = np.diff(stamps), np.column_stack([turns(quaternion), np.diff(position, axis=0)])
        bends = np.diff(moved / steps[:, None], axis=0) / (0.5 * (steps[1:] + steps[:-1]))[:, None]
        if steps.max() ** 2 / 8.0 * np.abs(bends).max() < _SLIGHT:
            return np.zeros((len(time), 6, 6))
        step = np.clip(np.searchsorted(stamps, time, side="right") - 1, 0, len(steps) - 1)
        share = np.clip((time - stamps[step]) / steps[step], 0.0, 1.0)
        off = (0.5 * share * (1.0 - share) * steps[step] ** 2)[:, None]
        ends = (off * bends[np.clip(step - 1 + end, 0, len(bends) - 1)] for end in (0, 1))
        return sum((0.5 * each[:, :, None] * each[:, None] for each in ends), np.zeros((len(time), 6, 6)))


class _Tree:
    """Poses of links from transforms."""

    def __init__(self, source: MessageFile, base: str, links: Sequence[str], max_gap: float, where: str) -> None:
        frames = read_frames(source, tree_topics(source.topics()))
        if not frames.edges:
            raise InputError("the log has no transforms (/tf).", where=where, hint="Name a topic as joints in [robot].")
        self._links = {link: TreePoses(frames, base, link, 0.0, max_gap, where) for link in links}
        names = {topic.name for each in self._links.values() for topic in each.topics}
        for messages in source.messages(names) if names else ():
            for each in self._links.values():
                each.add(messages)

    def at(self, link: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._links[link].track.at(time)


class RobotMotion:
    """The poses of links in the base over time, which a log of joint states or transforms states.

    Attributes:
        samples: positions of the joints; None: poses are from /tf.
    """

    def __init__(
        self, poses: JointSamples | _Tree, encoder: float, notes: Sequence[str], warnings: Sequence[str]
    ) -> None:
        self._poses, self._encoder, self._notes, self._warnings = poses, encoder, tuple(notes), tuple(warnings)
        self.samples = poses if isinstance(poses, JointSamples) else None

    @classmethod
    def read(
        cls,
        log: Path,
        urdf: Urdf,
        base: str,
        links: Sequence[str],
        *,
        joints: str | Mapping[str, str] | None,
        max_gap: float = 0.25,
        encoder: float = 0.0,
    ) -> RobotMotion:
        """Read the motion of a robot from a log.

        Args:
            log: file, or folder of a bag.
            urdf: the robot.
            base: link in whose frame poses are given.
            links: names of the other links.
            joints: topic of joint states, None: the only one; `TF`; or joint -> column of a table, in rad and m.
            max_gap: [s] between joint samples, beyond which no pose is known between them.
            encoder: standard deviation [rad] of the position of each joint.

        Raises:
            InputError: the log cannot be read, or has no such topic, no such column or no position of a joint that
                moves a link; a joint seems to be in degrees; or as for `Kinematics`.
        """
        source = messages_of(log)
        if joints == TF:
            if source is None:
                raise InputError(
                    "is a table, and has no /tf.", where=str(log), hint="Name columns as joints in [robot]."
                )
            return cls(_Tree(source, base, links, max_gap, str(log)), encoder, (), ())
        kinematics = Kinematics(urdf, base, links)
        if source is None:
            if not isinstance(joints, Mapping):
                hint = 'Write joints = { JOINT = "COLUMN" } in [robot].'
                raise InputError("is a table, and has no topic of joint states.", where=str(log), hint=hint)
            time, values = _of_table(log, kinematics.joints, joints)
            name, notes, duration = str(log), list[str](), float(np.ptp(time)) if len(time) else 0.0
        else:
            topic = joint_topic(source.topics(), joints if isinstance(joints, str) else None, str(log))
            time, values, notes = _of_topic(source, topic, kinematics.joints)
            name, duration = topic.name, source.duration
        lacking = [joint for joint, row in zip(kinematics.joints, values.T, strict=True) if np.isnan(row).all()]
        if lacking:
            what = f"{name!r} has no position of the joint {', '.join(map(repr, lacking))}."
            raise InputError(what, where=str(log), hint="Record it, or choose a base link after this joint.")
        if np.isnan(values).any():
            time, values = _filled(time, values, max_gap)
            notes.append(f"some states on {name!r} lack joints: their positions are those between the next ones")
        known = np.isfinite(values).all(axis=1) & np.isfinite(time)
        time, values = time[known], values[known]
        newer = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1]) if len(time) else known[known]
        time, values = time[newer], values[newer]
        kinematics.require_radians(values, name)
        samples = JointSamples(kinematics, time, values, max_gap)
        lost = _lost(name, time, duration, max_gap)
        idle, hung = _still(kinematics.joints, time, values)
        jumps = _jumps(urdf, kinematics, time, values)
        return cls(samples, encoder, notes + idle, (*lost, *jumps, *hung, *_beyond(urdf, samples)))

    def at(self, link: str, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] of a link in the base; NaN where not known."""
        return self._poses.at(link, time)

    def covariance(self, link: str, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 6 6"]:
        """Return covariances (n, 6, 6) of the rotation vector [rad] and translation [m] of a link's poses, in the base.

        They are 0 for poses from /tf.
        """
        if self.samples is None:
            return np.zeros((len(time), 6, 6))
        return self.samples.covariance(link, time, self._encoder)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the motion, one sentence each."""
        return self._notes

    def warnings(self) -> tuple[str, ...]:
        """Return what may be wrong with the joints' positions, one sentence each."""
        return self._warnings


def _of_table(log: Path, names: Sequence[str], columns: Mapping[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions of joints in a table; raise InputError for a joint without a column."""
    for name in names:
        if name not in columns:
            what = f"joint {name!r} moves a sensor, and no column is named for it."
            raise InputError(what, where="[robot] joints", hint="Add it.")
    channel = ArrayChannel("joints", (len(names),), tuple(columns[name] for name in names), table="robot")
    recording = read_recording(log, LogLayout(wrench=None, arrays=(channel,)))
    return recording.time, recording.channels["joints"]


def _of_topic(source: MessageFile, topic: Topic, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times and positions of joints in messages, and notes; a message may have some of the joints."""
    stamped = source.has_stamps(topic, lambda messages: joint_stamps(messages, topic))
    times, values, unread, count = [np.empty(0)], [np.empty((0, len(names)))], 0, 0
    for messages in source.messages([topic.name]):
        own = messages.of(topic)
        stamp, found, sound, concerned = joint_positions(own, topic, names)
        count, unread = count + len(sound), unread + int(np.count_nonzero(~sound))
        good = sound & concerned
        times.append(seconds(stamp if stamped else own.time)[good])
        values.append(found[good])
    notes = [f"{unread} of {count} messages of {topic.name!r} cannot be read"] if unread else []
    if not stamped:
        notes.append(f"messages of {topic.name!r} have no stamps: the times at which they were recorded are used")
    return np.concatenate(times), np.concatenate(values), notes


def _filled(time: np.ndarray, values: np.ndarray, max_gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times in order and positions, those that lack between two at most `max_gap` apart on a straight line."""
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    for column in values.T:
        lacks, known = np.flatnonzero(np.isnan(column)), np.flatnonzero(np.isfinite(column))
        place = np.searchsorted(known, lacks)
        inside = (place > 0) & (place < len(known))
        lacks, before, after = lacks[inside], known[place[inside] - 1], known[place[inside]]
        step = column[after] - column[before]
        near = (time[after] - time[before] <= max_gap) & (np.abs(step) < np.pi)  # not where a joint begins a new turn
        lacks = lacks[near]
        column[lacks] = np.interp(time[lacks], time[known], column[known])
    return time, values


def _jumps(urdf: Urdf, kinematics: Kinematics, time: np.ndarray, values: np.ndarray) -> list[str]:
    """Return a sentence for each joint that moves faster in some step than it can."""
    said, joints = list[str](), {joint.name: joint for joint in urdf.joints}
    steps = np.diff(time)
    for k, name in enumerate(kinematics.joints):
        joint = joints[name]
        stated = urdf.limits(joint)[2] if joint.element.find("limit") is not None else 0.0
        fastest = _JUMP * stated if stated > 0 else _FASTEST
        moved = np.abs(np.diff(values[:, k]))
        if joint.kind == "continuous":
            moved = np.minimum(moved % (2 * np.pi), 2 * np.pi - moved % (2 * np.pi))
        jumped = np.flatnonzero(moved > fastest * np.maximum(steps, 1e-3))
        if len(jumped):
            at, way = time[jumped[0] + 1], moved[jumped[0]]
            said.append(
                f"joint {name!r} jumps by {way:.3g} {'m' if joint.kind == 'prismatic' else 'rad'} at {at:.3f} s"
                f"{f' and {len(jumped) - 1} times more' if len(jumped) > 1 else ''}: contacts of the links that it "
                "moves are in the wrong place in the base around then"
            )
    return said


def _still(names: Sequence[str], time: np.ndarray, values: np.ndarray) -> tuple[list[str], list[str]]:
    """Return a note on joints that never move while others do, and a sentence for each that stops changing at all."""
    changes, idle, hanging = np.diff(values, axis=0) != 0, list[str](), list[str]()
    for name, own in zip(names, changes.T, strict=True):
        moving = 2 * (np.count_nonzero(changes, axis=1) - own) > len(names) - 1
        moves, when = own[moving], time[1:][moving]
        edges = np.flatnonzero(np.concatenate([[True], moves, [True]]))
        longest = int(np.argmax(np.diff(edges)))
        still = slice(edges[longest], edges[longest + 1] - 1)
        others, when = np.delete(moves, still), when[still]
        if not moves.any() and len(when) >= _HUNG:
            idle.append(repr(name))
        elif len(when) >= _HUNG and np.ptp(when) >= _STILL and np.mean(others) > _CHANGES:
            hanging.append(
                f"joint {name!r} stands still from {when[0]:.3f} s to {when[-1]:.3f} s, while most others move: if it "
                "moved, its encoder hangs, and contacts of the links that it moves are in the wrong place"
            )
    return [f"the position of {', '.join(idle)} never changes, and those of most joints do"] if idle else [], hanging


def _lost(name: str, time: np.ndarray, duration: float, max_gap: float) -> list[str]:
    """Return a sentence if much of a log has no joint states."""
    steps = np.diff(time)
    missing = duration - steps[steps <= max_gap].sum()
    if missing <= _LOST:
        return []
    ends = f"; the last is at {time[-1]:.3f} s" if len(time) else ""
    return [
        f"{missing:.1f} s of the {duration:.1f} s of the log have no states of all joints within {max_gap:g} s "
        f"on {name!r}{ends}: contacts have no place in the base then"
    ]


def _beyond(urdf: Urdf, samples: JointSamples) -> list[str]:
    """Return a sentence for each joint that is often beyond its limits."""
    said, joints = list[str](), {joint.name: joint for joint in urdf.joints}
    for name, values in zip(samples.kinematics.joints, samples.positions.T, strict=True):
        if joints[name].element.find("limit") is None:
            continue
        low, high, _ = urdf.limits(joints[name])
        past = np.maximum(low - values, values - high)
        if low < high and np.isfinite(high - low) and np.mean(past > _BEYOND * (high - low)) > _OFTEN:
            said.append(
                f"joint {name!r} reads {values[past.argmax()]:.3g}, beyond its limits {low:g} to {high:g}: its zero, "
                "or the URDF, may be another robot's"
            )
    return said
