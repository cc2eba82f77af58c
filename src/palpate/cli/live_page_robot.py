"""Hold what the live page shows of a robot: contacts of all sensors in the base, its links as they are, and figures."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.cli.live_page_stream import SENTENCES, Stream
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.frames import in_base
from palpate.files.urdf import Kinematics
from palpate.live.stream_buffer import StreamBuffer
from palpate.setup.robot import Robot
from palpate.setup.robot_view import drawn_links
from palpate.spatial.pose import Pose
from palpate.spatial.shown import three_digits
from palpate.viewer.live import SECONDS, SILENT, StreamFigures
from palpate.viewer.robot_layer import LiveRobotLayer
from palpate.viewer.scene import no_contacts


class RobotStream:
    """Data of a robot's streams for the page: a picture is the last contacts of each sensor, in the base.

    Args:
        rings: rings of the sensors' streams, and one of joint states, if they are received.
        robot: the robot.

    Attributes:
        ring: the first ring, which requests the stop.
        layer: the robot's links, and the list of its sensors.
        next_one: number of the next picture.
        newest: contacts of the last picture; None before the first.
        window: contacts of the pictures of the last seconds; None before the first.

    Raises:
        InputError: the rig names no URDF, the URDF cannot be used, or the link of a sensor is not known.
    """

    def __init__(self, rings: Sequence[StreamBuffer], robot: Robot) -> None:
        self.ring = rings[0]
        self._streams = {ring.form.origin[0]: Stream(ring, _nothing) for ring in rings if not ring.form.joints}
        sensors = [robot.sensors[name] for name in self._streams]
        mounts = [each.rig.mount() for each in sensors]
        self._mounts = np.stack([each.rotation for each in mounts]), np.stack([each.translation for each in mounts])
        self._frames = [each.require_frame() for each in sensors]
        urdf, links = drawn_links(robot)
        names = dict.fromkeys([*links, *self._frames])
        states = next((ring for ring in rings if ring.form.joints), None)
        self._motion = _Motion(Kinematics(urdf, robot.base, list(names)), states, robot.table.max_gap)
        self.layer = LiveRobotLayer(links, *self._motion.of(list(links)))
        self._drawn, self._read = list(links), 0
        self.next_one = 0
        self.newest: Contacts | None = None
        self.window: Contacts | None = None
        self._pictures = list[Contacts]()

    def tare(self, browser: str) -> None:
        """Request a tare of all sensors, for a browser at that address."""
        for each in self._streams.values():
            each.tare(browser)

    def look(self, watched: bool) -> None:
        """Read new slots of all rings, and make a picture if there are any; `watched`: a browser is connected.

        Without one, only the last slot of each is read, and there is no picture.
        """
        for each in self._streams.values():
            each.look(watched, None if watched else 1)
        if not watched:
            return
        read = sum(each.next_one for each in self._streams.values()) + self._motion.look()
        if read == self._read:
            return
        self._read = read
        self.newest = self._picture()
        self._pictures.append(self.newest)
        self.next_one += 1

    def gather(self) -> None:
        """Add the pictures since the last call to the window, and what was read to the figures."""
        for each in self._streams.values():
            each.count()
        if self._pictures:
            found = Contacts.joined([*([] if self.window is None else [self.window]), *self._pictures])
            self.window = found[found.time > found.time[-1] - SECONDS]
            self._pictures.clear()

    def figures(self) -> StreamFigures:
        """Return the current `StreamFigures` of all sensors: sums, the largest latencies, and all events."""
        each = {name: stream.figures() for name, stream in self._streams.items()}
        self._list(each)
        known = [of.latency for of in each.values() if of.latency is not None]
        events = sorted((at, f"{name}: {sentence}") for name, of in each.items() for at, sentence in of.events)
        return StreamFigures(
            rate=sum(of.rate for of in each.values()),
            latency=tuple(np.max(known, axis=0).tolist()) if known else None,
            lost=sum(of.lost for of in each.values()),
            skipped=sum(of.skipped for of in each.values()),
            silent=min(of.silent for of in each.values()),
            samples=sum(of.samples for of in each.values()),
            taring=any(of.taring for of in each.values()),
            tare=next((sentence for _, sentence in reversed(events) if "tare" in sentence), ""),
            events=tuple(events[-SENTENCES:]),
        )

    def _picture(self) -> Contacts:
        """Return the last contacts of all sensors in the base, at least one row, and move the links."""
        self.layer.move(*self._motion.of(self._drawn))
        parts, which = list[Contacts](), list[int]()
        for k, stream in enumerate(self._streams.values()):
            if stream.silent < SILENT and (own := stream.newest) is not None:
                parts.append(own)
                which += [k] * len(own)
        joined = self._in_base(Contacts.joined(parts), which) if parts else no_contacts()
        shown = np.flatnonzero(joined.answered | (joined.status == Status.SATURATED))
        kept: Contacts = joined[shown if len(shown) else slice(1)]
        return replace(kept, sample=np.full(len(kept), self.next_one), time=np.full(len(kept), time.time()))

    def _in_base(self, found: Contacts, which: Sequence[int]) -> Contacts:
        """Return contacts in the base; `which` has the number of the sensor of each row."""
        (turns, moves), (turned, moved) = self._motion.of(self._frames), self._mounts
        placed = in_base(found.estimate, turns[which], moves[which], Pose(turned[which], moved[which]))
        return found.with_estimate(placed)

    def _list(self, figures: Mapping[str, StreamFigures]) -> None:
        """List the sensors and the joint states in the layer."""
        rows = [(name, self._described(name, of)) for name, of in figures.items()]
        self.layer.describe([*rows, *self._motion.rows()])

    def _described(self, name: str, figures: StreamFigures) -> str:
        """Return text on a sensor: the force of its contacts or its status, and its rate."""
        found = self._streams[name].newest
        if found is None or figures.silent > SILENT:
            return "no readings"
        force = float(np.linalg.norm(found.force[found.answered], axis=1).sum())
        state = f"{three_digits(force)} N" if found.answered.any() else Status(int(found.status[0])).words
        return f"{state}, {three_digits(figures.rate)} Hz"


class _Motion:
    """Follow where the links of a robot are in its base, by the newest joint states; without any, joints are at 0.

    Args:
        kinematics: of the links.
        ring: ring of joint states; None: none are received.
        max_gap: [s] without joint states that is normal.
    """

    def __init__(self, kinematics: Kinematics, ring: StreamBuffer | None, max_gap: float) -> None:
        self._kinematics, self._ring, self._max_gap = kinematics, ring, max_gap
        received = () if ring is None else ring.form.joints
        self._columns = [received.index(joint) if joint in received else -1 for joint in kinematics.joints]
        self._count, self._at = -1, -np.inf
        self._poses = kinematics.poses(np.zeros((1, len(kinematics.joints))))

    def look(self) -> int:
        """Read the newest joint states, and return how many were received."""
        if self._ring is None or not (count := self._ring["answered"]) or count == self._count:
            return max(self._count, 0)
        slots, _ = self._ring.read(count - 1, 1)
        self._count, self._at = count, time.monotonic()
        for values in slots["values"]:
            known = np.append(values, 0.0)[self._columns]  # the last one is of joints that are not received
            self._poses = self._kinematics.poses(known[None])
        return count

    def of(self, links: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return quaternions x, y, z, w (k, 4) and positions (k, 3) [m] of links in the base."""
        rows = [self._kinematics.links.index(link) for link in links]
        return self._poses[0][0, rows], self._poses[1][0, rows]

    def rows(self) -> list[tuple[str, str]]:
        """Return (name, text) pairs on joints whose positions are not known, or old."""
        lacking = [joint for joint, k in zip(self._kinematics.joints, self._columns, strict=True) if k < 0]
        rows = [("not received", f"{', '.join(lacking)}: drawn at 0")] if lacking else []
        since = time.monotonic() - self._at
        if len(lacking) < len(self._columns) and since > max(self._max_gap, SILENT):
            words = "none yet: drawn at 0" if self._count < 0 else f"none for {since:.0f} s: drawn as they were"
            rows.append(("joint states", words))
        return rows


def _nothing(slots: np.ndarray, watched: bool) -> None:
    """Do nothing with new slots: a robot's layer has no cells."""
