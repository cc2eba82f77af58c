"""A six-axis force/torque sensor in a rig: payload, inertia, noise, the layout of its log, and how a log is guessed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from palpate.contact.plausibility import lines_of_action
from palpate.errors import InputError
from palpate.files.logs import LogContents, join, open_log
from palpate.files.logs.layout import LogLayout, axis_matrix
from palpate.files.logs.opening import survey
from palpate.files.logs.topics import NONE
from palpate.files.models import read_model
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, to_si
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.setup import guess
from palpate.setup.body import GivenBody
from palpate.setup.built import FIRST, BuiltEstimator, Guess
from palpate.setup.guess_columns import WrenchColumns, acceleration_table, columns_guess, columns_of_pose
from palpate.setup.guess_pose import PoseGuess, guess_pose
from palpate.setup.names import made_up
from palpate.setup.setup import SensorKind, SensorSection, Setup, seen_first
from palpate.setup.wrench_table import RigForceTorque
from palpate.signals.acceleration import turned_from_gravity, wrong_acceleration
from palpate.signals.imu_at_rest import imu_at_rest
from palpate.signals.motion import Motion
from palpate.signals.noise import Noise, NoiseSpectrum, estimate_noise, log_noise, wrong_noise
from palpate.signals.payload import Payload
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, TORQUE, UNSTEADY, Recording
from palpate.signals.wrench_sensor import Measured

_LONG_ARM, _LONGEST_ARM = 0.5, 2.0  # m: lever arm of a force about a sensor, doubtful and impossible
_TURNED = 20.0  # degrees between an IMU and gravity, at the median of a log: more than a mounting by hand
_TEXT = """\
{time}[force_torque]
{wrench}
units = {{ force = "{force_unit}", torque = "{torque_unit}" }}{torque_remark}
axes = ["x", "y", "z"]               # which logged axis is the sensor's x, y, z; "-x" flips
# left_handed = true                 # if axes has to mirror: a driver that swaps two axes, or reports the reaction
frame = "{frame}"                     # "sensor", or "base", which needs an orientation
{meaning}{unsure}{noise}   # of one reading: {noise_source}
# range = {{ force = 200, torque = 10 }}     # of the sensor: a reading at it is saturated
# payload = "payload.toml"           # written by: palpate calibrate payload

{orientation}{acceleration}"""
_MEANING = """\
# acts_on = "environment"            # if the wrench is what the robot does to the world: touches come out opposite
# reference = [0, 0, 0.1]            # m in the sensor's frame: the point of the torque, if not its origin; or "base"
"""
_USUAL = {
    "time": "",
    "force_unit": "N",
    "torque_remark": "",
    "frame": "sensor",
    "meaning": _MEANING,
    "unsure": "",
    "acceleration": "",
}


class ForceTorqueSection(SensorSection):
    """A six-axis force/torque sensor as a rig states it."""

    name: ClassVar[str] = "force_torque"
    called: ClassVar[str] = "a six-axis force/torque sensor"
    table: RigForceTorque

    @cached_property
    def payload(self) -> Payload | None:
        """`Payload` from the file that the rig names; None where it names none.

        Raises:
            InputError: the file cannot be read, or has no payload.
        """
        return None if self.table.payload is None else read_model(self.link.folder / self.table.payload, Payload)


def _layout(setup: Setup) -> LogLayout:
    wrench = setup.of(ForceTorqueSection).table
    return LogLayout(
        wrench=wrench.columns,
        force_unit=wrench.units.force,
        torque_unit=wrench.units.torque,
        axes=wrench.axes,
        left_handed=wrench.left_handed,
        torque_axes=wrench.torque_axes,
        acts_on=wrench.acts_on,
        frame=wrench.frame,
        torque_frame=wrench.torque_frame,
        reference=wrench.reference,
        wrench_range=None if wrench.range is None else tuple(wrench.range.six().tolist()),
        wrench_topic=wrench.topic,
        **setup.common,
    )


def stated_sensor(setup: Setup, recording: Recording | None = None) -> ForceTorque:
    """Return the `ForceTorque` that a rig states; noise that it does not state is estimated from the recording.

    Raises:
        InputError: the rig has no [force_torque], its payload's file cannot be read, or the recording has no forces or
            torques, no positions although accelerations come from poses, or accelerations of another kind than stated.
    """
    return _stated(setup, recording, None if recording is None else _noise_of(setup, recording)[0])


def _stated(setup: Setup, recording: Recording | None, seen: Noise | None) -> ForceTorque:
    wrench = setup.of(ForceTorqueSection).table
    deviation, spectrum = (None, None) if seen is None else (seen.deviation, seen.spectrum)
    if wrench.noise is not None:
        deviation = wrench.noise.six()
        rate = setup.filter.rate or (None if recording is None else recording.rate())
        if wrench.noise.corner is not None and rate is not None:
            spectrum = NoiseSpectrum.of_corner(wrench.noise.corner, rate)
    limits, drift = (None if pair is None else pair.six() for pair in (wrench.range, wrench.drift))
    return ForceTorque(deviation, limits, wrench.frame, spectrum, wrench.gain_error, drift)


def free_wrenches(setup: Setup, recording: Recording) -> Float[np.ndarray, "n 6"]:
    """Return the wrenches (n, 6) [N, N m] of a recording without payload and inertia; NaN in unusable samples.

    Raises:
        InputError: the rig has no [force_torque], an orientation is needed and there is none, the payload's file cannot
            be read, or the recording has no forces or torques, or accelerations of another kind than stated.
    """
    limits = setup.of(ForceTorqueSection).table.range
    made = _measured(setup, recording, None if limits is None else limits.six())
    return np.concatenate([np.where((part.status < 0)[:, None], part.wrench, np.nan) for part in made])


def accelerated(setup: Setup, recording: Recording) -> bool:
    """Return whether poses show that the payload is accelerated, while the rig names no source of accelerations.

    Raises:
        InputError: the payload's file cannot be read, or accelerations are of another kind than stated.
    """
    motion = _motion(setup, recording)
    if motion is None or motion.source != "none" or ORIENTATION not in recording.channels:
        return False
    return any(bool((block.channels[UNSTEADY] > 0.0).any()) for block in motion.stream(iter([recording])))


def _noise_warnings(setup: Setup, recording: Recording) -> list[str]:
    stated = setup.of(ForceTorqueSection).table.noise is not None
    return _wrong_noise(setup, _noise_of(setup, recording)[0]) if stated else []


def _wrong_noise(setup: Setup, seen: Noise | None) -> list[str]:
    stated = setup.of(ForceTorqueSection).table.noise
    doubt = "" if stated is None or seen is None else wrong_noise(stated.six(), seen.deviation)
    return [doubt] if doubt else []


def _noise_of(setup: Setup, recording: Recording) -> tuple[Noise | None, str]:
    """Return the noise of a recording without its payload, and where it comes from or why it is not known."""
    payload, quaternions = setup.of(ForceTorqueSection).payload, recording.channels.get(ORIENTATION)
    gravity = ORIENTATION if payload is None or payload.imu is None else ACCELERATION
    if payload is None or gravity not in recording.channels:
        wrenches = recording.wrenches()
    else:  # the payload moves with the arm and is not noise
        wrenches = free_wrenches(setup, recording)
    return log_noise(recording.time, wrenches, quaternions, wander=setup.drift is None)


def _measured(setup: Setup, recording: Recording, limits: Float[np.ndarray, "6"] | None = None) -> Iterator[Measured]:
    """Return the wrenches of a recording without payload and inertia, block by block."""
    section = setup.of(ForceTorqueSection)
    sensor = ForceTorque(limits=limits, frame=section.table.frame)
    compensated = Compensation(sensor, section.payload, _motion(setup, recording))
    return map(compensated.measure, compensated.ready([recording]))


def compensation(setup: Setup, head: Recording | None) -> Compensation:
    """Return the sensor and payload that a rig states; noise that it does not state is estimated from a log's start.

    Raises:
        InputError: the rig has no [force_torque], its payload's file cannot be read, or the log has no forces or
            torques, or accelerations of another kind than stated.
    """
    return Compensation(stated_sensor(setup, head), setup.of(ForceTorqueSection).payload, _motion(setup, head))


def _build(setup: Setup) -> BuiltEstimator:
    from palpate.setup.wrench import wrench_estimator  # here: to guess at a log needs nothing of it

    table, head = setup.of(ForceTorqueSection).table, setup.head
    seen, where = (None, "there is no log") if head is None else _noise_of(setup, head)
    payload = setup.of(ForceTorqueSection).payload
    stated, sensor = table.noise is not None, Compensation(_stated(setup, head, seen), payload, _motion(setup, head))
    made = wrench_estimator(setup, sensor, tare=setup.estimate.tare, drift=setup.followed(6))
    if made.estimator.plausibility is not None:
        made.estimator.plausibility.stated = {
            "reference": table.reference,
            "acts_on": table.acts_on,
            "axes": table.axes,
            "torque_axes": table.torque_axes or table.axes,
            "form": setup.layout().orientation_form,
        }
    made.settings["noise_source"] = "given" if stated else "unknown" if sensor.noise is None else "rest of the log"
    noted = [] if stated or seen is None or head is None else [_noise_note(seen, where, head)]
    made.notes[:0] = [*noted, *([] if payload is not None else [_no_payload(table.acts_on, setup.estimate.tare)])]
    if sensor.noise is None:
        made.warnings.append(
            f"the noise is not known, so there are no covariances: {where}; state noise in the rig's [force_torque] "
            "or log a second at rest"
        )
    made.warnings += [] if head is None else [*_wrong_noise(setup, seen), *_turned(sensor, head), *_late(setup, head)]
    return made


def _late(setup: Setup, head: Recording) -> list[str]:
    """Return a warning if the forces fit the weight far better with another clock of the poses, in a list."""
    payload = setup.of(ForceTorqueSection).payload
    if payload is None or payload.imu is not None or head.frame == "base" or ORIENTATION not in head.channels:
        return []
    from palpate.calibration.clock import suspected_offset

    offset = suspected_offset(head.time, head.wrenches(), head.channels[ORIENTATION], payload)
    if not offset:
        return []
    way = "late" if offset < 0 else "early"
    return [f"the orientations seem to be {abs(offset):.2g} s {way}: run `palpate calibrate clock` on this log"]


def _turned(sensor: Compensation, head: Recording) -> list[str]:
    motion = sensor.motion
    if motion is None or motion.source != "imu" or motion.gravity is None or ORIENTATION not in head.channels:
        return []
    turned = turned_from_gravity(head.channels[ACCELERATION], head.channels[ORIENTATION], motion.gravity)
    doubt = (
        f"gravity as the IMU measures it is {turned:.0f} degrees from gravity by the orientation: check that the IMU's "
        "axes are the sensor's"
    )
    return [doubt] if turned > _TURNED else []


def _noise_note(seen: Noise, where: str, head: Recording) -> str:
    force, torque = seen.deviation[:3].max(), seen.deviation[3:].max()
    rate = head.rate()
    size = f"{seen.samples:,} samples" if rate is None else f"{seen.samples / rate:.3g} s"
    return f"noise taken from {size} of the log {where}: {force:.3g} N, {torque:.3g} N m"


def _no_payload(acts_on: str, tare: float | None) -> str:
    tared = "the tare of the wrenches holds only while the sensor keeps its orientation"
    untared = "wrenches are taken as they are, so they must be tared"
    sign = f'their sign is that of acts_on = "{acts_on}", which a touch at a known place checks'
    return f"no payload model: {untared if tare is None else tared}; {sign}"


def _motion(setup: Setup, head: Recording | None) -> Motion | None:
    stated, payload = setup.acceleration, setup.of(ForceTorqueSection).payload
    if payload is None or not payload.weight.any():
        return None
    if payload.imu is not None and (stated.kind != "imu" or stated.from_poses):
        what = "the payload takes gravity from the IMU with which it was calibrated."
        hint = 'Name the IMU\'s columns or topic there, and write kind = "imu".'
        raise InputError(what, where="[acceleration] of the rig", hint=hint)
    felt = head is None or ACCELERATION in head.channels
    if head is not None and felt and stated.recorded:
        wrong = wrong_acceleration(head.channels[ACCELERATION], stated.kind)
        if wrong:
            raise InputError(f"{wrong}.", where=f"{head.source}, [acceleration] of the rig")
    source = "poses" if stated.from_poses else stated.kind if felt else "none"
    if payload.imu is not None or (head is None and source != "imu"):
        return None
    made = Motion(source=source, window=stated.window, gravity=payload.gravity, lever=payload.center_of_mass)
    if head is not None and source in ("motion", "imu"):
        made.accelerometer = imu_at_rest(head, made)
    return made


def _check(table: RigForceTorque | None, path: Path) -> None:
    wrench = table or RigForceTorque()
    axis_matrix(wrench.axes, left_handed=wrench.left_handed, where=f"{path}: force_torque.axes")
    if wrench.torque_axes is not None:
        axis_matrix(wrench.torque_axes, left_handed=None, where=f"{path}: force_torque.torque_axes")
    to_si(wrench.units.force, FORCE_UNITS, where=f"{path}: force_torque.units.force")
    to_si(wrench.units.torque, TORQUE_UNITS, where=f"{path}: force_torque.units.torque")


def _guess(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    found = _topics_of(log, contents, body) if contents.topics else columns_guess(log, contents)
    if found is None:
        return None
    pose, bare = found.pose, replace(found.layout, frames=None, orientation_topic=NONE)  # no poses of topics yet
    quaternion = pose is not None and pose.form == "quaternion"
    if pose is not None and (quaternion or contents.poses is not None):
        bare = replace(bare, orientation=pose.orientation, orientation_form=pose.form)
    opened = open_log(log, bare)
    recording = join(list(opened.blocks()))
    if found.time is not None or found.pose_table:
        timed = found.time is not None and found.time.column
        if timed and made_up(contents.names) and (np.diff(recording.time) <= 0).mean() > 0.1:
            return None  # the first of seven columns without names is no time
        if pose is not None and quaternion:
            from palpate.sensors.force_torque.orientation_form import confirmed_pose

            pose = confirmed_pose(pose, recording, based=found.layout.frame == "base")
        found = found.looked_at(recording, contents.stated, opened.time_unit, pose)
        found = found if contents.poses is None else replace(found, remarks=(*found.remarks, *opened.notes()))
    elif ACCELERATION in recording.channels:
        found = _with_imu(found, recording)
    found = _with_torques(found, recording, None if body is None else body.size)
    lacking = "" if found.time is None else found.time.lacking
    text = _TEXT.format_map({**_USUAL, **found.fields})
    return Guess(found.why, found.layout, text, found.remarks, lacking, found.fields.get("called", ""))


def _with_torques(found: WrenchColumns, recording: Recording, size: float | None) -> WrenchColumns:
    """Return the columns with the noise and the torque's unit, guessed where nothing states it."""
    fields, remarks, layout = dict(found.fields), list(found.remarks), found.layout
    wrenches = recording.wrenches()
    if "torque_unit" not in fields:
        known = wrenches[np.isfinite(wrenches).all(axis=1)]
        free = known - np.median(known, axis=0) if len(known) else known
        fields["torque_unit"] = torque_unit = _torque_unit(free, size)
        layout = replace(layout, torque_unit=torque_unit)
        wrenches = wrenches * np.repeat([1.0, TORQUE_UNITS[torque_unit]], 3)
        if torque_unit != "N m":
            fields["torque_remark"] = "   # guessed: as N m they do not fit the body"
            remarks.append("the torques only fit a body if they are N mm: check units.torque")
        elif size is None and (arm := _arm(free)) > _LONG_ARM:
            fields["unsure"] = "# "  # the unit that will stand there decides
            doubt = (
                f"forces act {arm:.2g} m from the sensor's origin at the median: if torques are N mm, correct it, as"
            )
            remarks.append(f'{doubt} units = {{ force = "{fields.get("force_unit", "N")}", torque = "N mm" }}')
    seen, why = log_noise(recording.time, wrenches, recording.channels.get(ORIENTATION))
    if seen is None:
        fields |= {"noise": "# noise = { force = 0.02, torque = 0.001 }", "noise_source": "the log does not show it"}
        remarks.append(f"the noise is not found: {why}; state it in [force_torque]")
    else:
        white = estimate_noise(wrenches) or seen  # at rest, unknown weights would count as drift
        deviation = np.minimum(seen.deviation, white.deviation)
        force, torque = deviation[:3].max(), deviation[3:].max()
        fields |= {"noise": f"noise = {{ force = {force:.2g}, torque = {torque:.2g} }}", "noise_source": "from the log"}
    return replace(found, layout=layout, fields=fields, remarks=tuple(remarks))


def _topics_of(log: Path, contents: LogContents, body: GivenBody | None) -> WrenchColumns | None:
    wrenches = guess.topics_of(contents, "wrench")
    if not wrenches or (seen := survey(log)) is None:
        return None
    several = (
        f"{len(wrenches)} topics hold wrenches: {', '.join(wrenches)}; the first is taken, and --topic chooses another"
    )
    layout = LogLayout(wrench_topic=wrenches[0])
    named, lines, read = columns_of_pose(contents)
    pose = PoseGuess(replace(layout, **read), "", []) if lines else guess_pose(seen, layout, body)
    why = f"topic {wrenches[0]!r} holds forces and torques"
    fields = {
        "wrench": f"topic = {guess.quoted(wrenches[0])}",
        "orientation": pose.text,
        "called": seen.named.get(wrenches[0], ("", ""))[0],  # the sensor's frame; "frame" is the rig's key
    }
    remarks = [*([several] if len(wrenches) > 1 else []), *pose.remarks]
    imus, layout = guess.imu_topics(contents), pose.layout
    nowhere = layout.frames is None and layout.orientation_topic in (None, NONE) and not lines
    if imus and nowhere:  # gravity comes from nowhere else
        layout = replace(layout, acceleration_topic=imus[0])
    elif imus:
        remarks.append(f"topic {imus[0]!r} of an IMU is not used: if it is on the sensor, name it in [acceleration]")
    return WrenchColumns(why, layout, fields, tuple(remarks), pose=named, pose_table=lines)


def _with_imu(found: WrenchColumns, recording: Recording) -> WrenchColumns:
    """Return the guess with the [acceleration] of its topic, and a remark on it."""
    topic = str(found.layout.acceleration_topic)
    text, remark = acceleration_table("topic", topic, f"topic {topic!r} is", None, recording)
    said = "it gives gravity if it is fixed to the sensor, as no pose is in the log (palpate calibrate payload)"
    return replace(found, fields={**found.fields, "acceleration": text}, remarks=(*found.remarks, remark, said))


def _torque_unit(free: np.ndarray, size: float | None) -> str:
    """Return "N mm" if N m puts the lines of action off a body of this size [m] and N mm does not, else "N m"."""
    if size is None or not len(free):
        return "N mm" if _arm(free) > _LONGEST_ARM else "N m"
    for unit in ("N m", "N mm"):
        scaled = free * np.repeat([1.0, TORQUE_UNITS[unit]], 3)
        if not lines_of_action(scaled, np.zeros(3), 10 * size):  # the mounting is not known yet
            return unit
    return "N m"


def _arm(free: np.ndarray) -> float:
    """Return the median lever arm [m], torque over force; NaN without a wrench."""
    arms = np.linalg.norm(free[:, 3:], axis=1) / np.linalg.norm(free[:, :3], axis=1).clip(1e-12)
    return float(np.median(arms)) if len(arms) else np.nan


FORCE_TORQUE = SensorKind(
    name="force_torque",
    called=ForceTorqueSection.called,
    table=RigForceTorque,
    section=ForceTorqueSection,
    channels=(FORCE, TORQUE),
    layout=_layout,
    build=_build,
    guess=_guess,
    paths=("payload",),
    check=_check,
    options=("payload", "noise"),
    drift="palpate.sensors.force_torque.drift.wrench_drift",
    warnings=_noise_warnings,
    view="palpate.sensors.force_torque.view.ForceTorqueView",
    start=lambda setup: seen_first(setup) or (FIRST if setup.of(ForceTorqueSection).table.noise is None else 0.0),
)
