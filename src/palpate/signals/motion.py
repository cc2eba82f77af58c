"""Inertial share of a reading: accelerations from recorded ones or from poses, or the error of leaving them out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.signals._curvature import Curvature, WindowSettings, curvature, part_of, pose_period, settings_of
from palpate.signals._delayed import with_columns
from palpate.signals.imu import Imu
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION, UNSTEADY, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

SOURCES = ("none", "poses", "motion", "imu")
CHUNK = 8192  # rows worked on at a time, counted from the first of the log: answers know nothing of its blocks
SCALES = (0.5, 1.5)  # times the window, to see an arm move: long ones see slow motion, short ones quick motion
SEEN = 4.0  # times the standard deviation of the acceleration's length: at rest less than one in a million windows
ARM = 0.5  # m from the sensor to where the arm turns, where only orientations are recorded
LOSS = 14.0  # a swing at f loses (pi f window)^2 over it
UNKNOWN = 10.0  # m/s^2: about 1 g, for the rows where the acceleration should be known and is not


@takes_arrays
class Motion:
    """A source of a sensor's acceleration, which adds it to a recording row by row, with its standard deviation.

    | source | ACCELERATION [m/s^2], sensor frame, without gravity | UNSTEADY [m/s^2] |
    |---|---|---|
    | none | none: at rest | size of the acceleration left out, where the poses show any; 0 at rest |
    | poses | second derivative of the lever's path p + R c | of the derivative's noise |
    | motion | as recorded, plus that of the lever, R c | of the added part and the accelerometer |
    | imu | as recorded, a specific force: f + R^T g, plus that of the lever, R c | of both, too |

    Near the ends of the log and of gaps, the nearest acceleration is kept, with a standard deviation as large as
    itself; where there is none, it is 0 and UNSTEADY about 1 g.

    Args:
        source: one of the table.
        window: [s] over which paths are fitted. A swing at f loses (pi f window)^2 / 14 of its acceleration.
        gravity: (3,) [m/s^2] in the base, which an IMU needs (`Payload.gravity`).
        lever: (3,) [m] c, the payload's centre of mass in the sensor's frame; None: the sensor's origin.
        accelerometer: bias and rotation that are removed from recorded accelerations, with their covariance and noise
            (`imu_at_rest`); None: accelerations without error.

    Raises:
        InputError: an unknown source, or an IMU without gravity.
    """

    def __init__(
        self,
        source: str = "none",
        *,
        window: float = 0.2,
        gravity: Float[np.ndarray, "3"] | None = None,
        lever: Float[np.ndarray, "3"] | None = None,
        accelerometer: Imu | None = None,
    ) -> None:
        if source not in SOURCES:
            raise InputError(
                f"the source of acceleration {source!r} is unknown.", hint=f"Use one of {', '.join(SOURCES)}."
            )
        if source == "imu" and (gravity is None or not np.isfinite(gravity).all()):
            what = "an IMU also measures gravity, and its direction in the base is not known."
            raise InputError(what, where="acceleration", hint="Use a payload, which states it, or another kind.")
        self.source, self.gravity = source, gravity
        self.window, self.accelerometer = window, accelerometer
        self.lever = np.zeros(3) if lever is None else np.asarray(lever, dtype=np.float64)
        self._placed = True  # positions are recorded
        self.reset()

    def stream(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        """Return an iterator over the blocks with ACCELERATION (n, 3) and UNSTEADY (n, 1) [m/s^2].

        With source "none" they have UNSTEADY alone.

        A block comes up to 16,384 rows late.

        Raises:
            InputError: the channels that the source needs are missing.
        """
        self.reset()
        return with_columns(blocks, self._answers, self._with_channels, 4)

    def live(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the channels of live samples with accelerations as by `stream`, but for the lever's.

        Those that need later samples, and accelerations of no use, are left out.

        Raises:
            KeyError: an IMU's accelerations come without orientations.
        """
        known = dict(channels)
        felt = known.pop(ACCELERATION, None)
        if felt is None or self.source not in ("motion", "imu"):
            return known
        felt, error = self._corrected(felt)
        unsteady = np.hypot(known.get(UNSTEADY, 0.0), error)
        return known | {ACCELERATION: self._without_gravity(felt, known), UNSTEADY: unsteady}

    def notes(self, mass: float | None = None) -> tuple[str, ...]:
        """Return notes on the rows so far, one sentence each; in newtons if the payload's mass [kg] is given."""
        if not self._rows:
            return ()
        size = f"{self._largest:.2g} m/s^2" if mass is None else f"{mass * self._largest:.2g} N"
        share = self._moving / self._rows
        said: list[str] = []
        if self.source == "none" and share:
            assumed = "" if self._placed else f" (positions are unknown: for an arm of {ARM:g} m)"
            said.append(
                f"the sensor moved in {share:.1%} of the samples, and no acceleration is known: "
                f"covariances were widened by up to {size}{assumed}"
            )
        elif self.source == "poses" and self._largest:
            said.append(f"accelerations were computed from poses: covariances were widened by up to {size}")
        elif self.source in ("motion", "imu") and self.accelerometer is not None:
            bias, turned, noise = _sizes(self.accelerometer)
            wide = f"{noise:.2g} m/s^2" if mass is None else f"{mass * noise:.2g} N"
            said.append(
                f"the accelerometer's bias of {bias:.2g} m/s^2 and its turn by {turned:.2g} degrees, found where the "
                f"poses show no motion, were removed: covariances were widened by {wide} or more for the rest"
            )
        if said and self._span > 1.5 * self.window:
            said.append(f"poses have a low rate: motion is seen over {self._span:.2g} s, and faster motion is not seen")
        if self._unknown:
            said.append(f"{self._unknown} samples near ends or gaps of the poses have no acceleration from them")
        return tuple(said)

    def reset(self) -> None:
        """Forget the rows that `notes` are about."""
        self._rows = self._moving = self._unknown = 0
        self._largest = self._span = 0.0

    def _taken(self, block: Recording) -> Float[np.ndarray, "n 8"]:
        """Return time, quaternion and position, (n, 8)."""
        self._require(block)
        taken = np.full((len(block), 8), np.nan)
        taken[:, 0] = block.time
        for name, columns in ((ORIENTATION, slice(1, 5)), (POSITION, slice(5, 8))):
            if name in block.channels:
                taken[:, columns] = block.channels[name]
        return taken

    def _require(self, block: Recording) -> None:
        has = set(block.channels)
        if self.source in ("motion", "imu") and ACCELERATION not in has:
            raise InputError(
                "the log has no acceleration.",
                where=block.source,
                hint="Name its columns or topic in the rig's [acceleration], or write from_poses = true there.",
            )
        if self.source == "poses" and not {ORIENTATION, POSITION} <= has:
            raise InputError(
                "accelerations from poses need positions and orientations.",
                where=block.source,
                hint="Add columns x, y, z and qx, qy, qz, qw, or name them or a topic of poses in [orientation].",
            )
        if self.source == "imu" and ORIENTATION not in has:
            raise InputError(
                "an IMU also measures gravity, and the log has no orientation with which to remove it.",
                where=block.source,
            )

    def _answers(self, blocks: Iterator[Recording]) -> Iterator[Float[np.ndarray, "m 4"]]:
        """Yield acceleration and UNSTEADY, (m, 4), by chunks."""
        settings: WindowSettings | None = None
        before, rows = np.zeros((0, 8)), np.zeros((0, 8))
        for piece, last in _gathered(map(self._taken, blocks)):
            rows = np.concatenate([rows, piece])
            if settings is None and (last or len(rows) >= CHUNK):
                settings = settings_of(rows[:CHUNK, 0], self.window, SCALES[-1], CHUNK)
                self._placed = bool(np.isfinite(rows[:CHUNK, 5:]).any())
            while settings is not None and len(rows) and (last or len(rows) >= CHUNK + settings.reach):
                near = np.concatenate([before, rows[: CHUNK + settings.reach]])
                done = slice(len(before), len(before) + min(CHUNK, len(rows)))
                yield self._of_chunk(near, done, settings)
                before = near[: done.stop][-settings.reach :]
                rows = rows[CHUNK:]

    def _of_chunk(
        self, near: Float[np.ndarray, "n 8"], done: slice, settings: WindowSettings
    ) -> Float[np.ndarray, "m 4"]:
        rotations = rotation_from_quaternion(np.where(near[:, 1:5].any(axis=1, keepdims=True), near[:, 1:5], np.nan))
        path = rotations @ self.lever
        if self.source == "none" and not self._placed:
            path = rotations.reshape(-1, 9)
        elif self.source in ("none", "poses"):
            path = path + near[:, 5:]
        choices = [(scale, 0.5) for scale in SCALES] if self.source == "none" else [(1.0, 2.0)]
        period = pose_period(near, settings)
        parts = {part_of(period, settings, *choice) for choice in choices}
        found = [curvature(near[:, 0], path, settings, *part) for part in sorted(parts)]
        answers = self._left_out(found) if self.source == "none" else self._felt(found[0], rotations)
        self._span = max(self._span, 2 * found[0].half * settings.step)
        unknown = ~np.isfinite(found[0].value[:, 0])
        self._count(answers[done], unknown[done], np.isfinite(path[done, 0]))
        return answers[done]

    def _left_out(self, scales: list[Curvature]) -> Float[np.ndarray, "n 4"]:
        """Return acceleration 0, and as UNSTEADY the size of the motion, (n, 4)."""
        size = np.zeros(len(scales[0].value))
        for found in scales:
            length = np.linalg.norm(found.value, axis=1)
            seen = length > SEEN * np.maximum(found.noise, found.usual)  # not NaN
            size = np.maximum(
                size, np.where(_widened(seen, found.half), length, 0.0), where=np.isfinite(length), out=size
            )
        # |a| / sqrt 3 is a's rms along an axis. Of R'' = A R, |A d| is |A| |d| / sqrt 3 for a d of any direction.
        share = 1.0 / 3**0.5 if self._placed else ARM / 3.0
        return np.column_stack([np.zeros((len(size), 3)), share * size])

    def _felt(self, found: Curvature, rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 4"]:
        """Return the acceleration in the sensor's frame, and its noise, (n, 4)."""
        value, lost = found.value, ~np.isfinite(found.value[:, 0])
        noise = np.hypot(found.noise, _lost(value, found.half))
        unsure = np.where(found.borrowed, np.hypot(np.linalg.norm(value, axis=1), noise), noise) / 3**0.5
        inside = np.einsum("nji,nj->ni", rotations, np.where(lost[:, None], 0.0, value))
        inside[~np.isfinite(inside).all(axis=1)] = 0.0  # no pose: the row gets no answer anyway
        unknown = UNKNOWN if self.source == "poses" else UNKNOWN * float(np.linalg.norm(self.lever)) / ARM
        return np.column_stack([inside, np.where(lost, unknown, unsure)])

    def _count(self, answers: np.ndarray, unknown: np.ndarray, posed: np.ndarray) -> None:
        self._rows += len(answers)
        self._moving += int(np.count_nonzero(answers[:, 3]))
        self._unknown += int(np.count_nonzero(unknown & posed)) if self.source != "none" else 0
        self._largest = max(self._largest, float(answers[:, 3].max(initial=0.0, where=~unknown)))

    def _with_channels(self, block: Recording, answers: Float[np.ndarray, "n 4"]) -> Recording:
        channels = dict(block.channels)
        acceleration, unsteady = answers[:, :3], answers[:, 3:]
        if self.source == "none":
            channels.pop(ACCELERATION, None)
            return replace(block, channels={**channels, UNSTEADY: unsteady})
        if self.source in ("motion", "imu") and (not self.lever.any() or ORIENTATION not in channels):
            acceleration, unsteady = np.zeros_like(acceleration), np.zeros_like(unsteady)
        if self.source in ("motion", "imu"):
            felt, error = self._corrected(channels[ACCELERATION])
            unsteady = np.hypot(unsteady, error)
            acceleration = self._without_gravity(felt + acceleration, channels)
        return replace(block, channels={**channels, ACCELERATION: acceleration, UNSTEADY: unsteady})

    def _corrected(
        self, recorded: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 1"]]:
        """Return recorded accelerations (n, 3) without the accelerometer's errors, and what remains of these (n, 1)."""
        if self.accelerometer is None:
            return recorded, np.zeros((len(recorded), 1))
        felt = self.accelerometer.forces(recorded)
        return felt, self.accelerometer.deviations(felt)

    def _without_gravity(
        self, acceleration: Float[np.ndarray, "n 3"], channels: Mapping[str, np.ndarray]
    ) -> Float[np.ndarray, "n 3"]:
        """Return recorded accelerations without the gravity that an IMU measures too."""
        if self.source != "imu" or self.gravity is None:
            return acceleration
        return acceleration + np.einsum("nji,j->ni", rotation_from_quaternion(channels[ORIENTATION]), self.gravity)


def _sizes(accelerometer: Imu) -> tuple[float, float, float]:
    """Return the lengths of its bias [m/s^2] and rotation [degrees], and its noise [m/s^2]."""
    turned = 2.0 * np.arctan2(np.linalg.norm(accelerometer.quaternion[:3]), abs(accelerometer.quaternion[3]))
    return float(np.linalg.norm(accelerometer.bias)), float(np.degrees(turned)), accelerometer.noise


def _lost(value: Float[np.ndarray, "n k"], half: int) -> Float[np.ndarray, " n"]:
    """Return the size of what a window loses, by the second difference over its halves, (pi f window)^2 of a swing."""
    change = np.zeros(len(value))
    if len(value) > 2 * half:
        bend = value[2 * half :] - 2 * value[half:-half] + value[: -2 * half]
        change[half:-half] = np.nan_to_num(np.linalg.norm(bend, axis=1))
    return change / LOSS


def _widened(seen: Bool[np.ndarray, " n"], half: int) -> Bool[np.ndarray, " n"]:
    """Return also the rows half a window around a seen one: a swinging acceleration passes through zero."""
    counts = np.concatenate([np.zeros(half + 1, dtype=int), np.cumsum(seen), np.full(half, np.count_nonzero(seen))])
    return counts[2 * half + 1 :] > counts[: -2 * half - 1]


def _gathered(pieces: Iterator[np.ndarray]) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield pieces joined until they are long enough to work on, and whether they are the last."""
    small, count = [np.zeros((0, 8))], 0
    for piece in pieces:
        small.append(piece)
        count += len(piece)
        if count >= CHUNK // 8:
            yield np.concatenate(small), False
            small, count = [piece[:0]], 0
    yield np.concatenate(small), True
