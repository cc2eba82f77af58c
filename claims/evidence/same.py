"""Same answers: one session in every format, in blocks of every size, sample by sample, to the last bit.

The session is the demonstration's, its numbers with all of their bits; polars, the mcap library and rosbags write it.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from claims.command import must
from claims.evidence.logs_written import (
    POSE,
    WRENCH,
    Session,
    write_csv,
    write_mcap,
    write_parquet,
    write_ros1,
    write_ros2,
)
from claims.row import Row, scratch
from palpate import Recording
from palpate.contact import ContactEstimate, Contacts, Locator, WrenchEstimator
from palpate.files.contacts import read_contacts
from palpate.files.logs import read_recording
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.section import ForceTorqueSection, stated_sensor
from palpate.setup import load_rig
from palpate.setup.tables import RigFilter
from palpate.signals import Butterworth, Kalman
from palpate.signals.filters import Filter
from palpate.signals.motion import Motion
from palpate.signals.recording import ORIENTATION
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation import simulate_session, write_session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC


def _packed(compression: CompressionType) -> Callable[[Path, Session], None]:
    return lambda path, log: write_mcap(path, log.messages(), compression=compression, chunk_size=50_000)


FORMATS: dict[str, Callable[[Path, Session], None]] = {
    "log.csv": write_csv,
    "log.parquet": write_parquet,
    "none.mcap": _packed(CompressionType.NONE),
    "lz4.mcap": _packed(CompressionType.LZ4),
    "zstd.mcap": _packed(CompressionType.ZSTD),
    "ros1.bag": write_ros1,
    "ros2 bag (SQLite)": lambda path, log: write_ros2(path, log.messages(), StoragePlugin.SQLITE3),
    "ros2 bag (MCAP)": lambda path, log: write_ros2(path, log.messages(), StoragePlugin.MCAP),
}
FILTERS: dict[str, Filter | None] = {
    "no filter": None,
    "Kalman": Kalman(),
    "Butterworth": Butterworth(15.0),
    "zero phase": Butterworth(15.0, zero_phase=True),
}
SIZES = (1, 17, 4096)
WHOLE = 1 << 40  # samples


def rows(small: bool) -> Iterator[Row]:
    with scratch() as folder:
        log = written(folder, touches=2 if small else 20, facets=320 if small else 20_000)
        yield from _formats(folder, log, 3 if small else len(FORMATS))
        recording = read_recording(folder / "log.parquet", load_rig(folder / "rig.toml").layout())
        yield from _blocks(folder, recording.picked(slice(0, 250 if small else None)))


def written(folder: Path, touches: int, facets: int, unposed: slice = slice(0)) -> Session:
    """A session's rig, mesh and payload, and its touches, with a pose for every wrench but the unposed."""
    session = simulate_session(touches=touches, facets=facets)
    write_session(session, folder)
    rig = (folder / "rig.toml").read_text().replace(WRENCH_TOPIC, WRENCH).replace(POSE_TOPIC, POSE)
    (folder / "rig.toml").write_text(rig)
    must("calibrate", "payload", folder / "free_motion.csv", "-o", folder / "payload.toml")
    touched = session.touches
    stamp = np.rint(1e9 * touched.time).astype(np.int64) + 1_700_000_000_123_456_789
    position = np.tile([0.4, 0.0, 0.6], (len(touched), 1))
    quaternion = touched.channels[ORIENTATION].copy()
    quaternion[unposed] = 0.0
    return Session(stamp, touched.wrenches(), quaternion, position)


def _formats(folder: Path, log: Session, count: int) -> Iterator[Row]:
    """Through the command; Parquet holds what was found as it is. tests/laws tries all of them."""
    first: Contacts | None = None
    for name, write in list(FORMATS.items())[:count]:
        write(folder / name, log)
        found = estimated(folder, name, "contacts.parquet")
        first = first or found
        same = np.count_nonzero(found.time == log.table[:, 0])
        got = f"{differing(first, found)} of {len(_columns(found))} columns differ from those of log.csv"
        got += f"; {same:,} of {len(log.stamp):,} times are the stamps"
        met = differing(first, found) == 0 and same == len(log.stamp) == len(found)
        yield Row(f"{name} in, {len(found):,} samples", "0, all", got, met)
    for result in ("contacts.csv", "contacts.mcap"):
        found = estimated(folder, "log.csv", result)
        differ = differing(first, found)
        got = f"{differ} of {len(_columns(found))} columns differ from those of contacts.parquet"
        yield Row(f"log.csv in, {result} out and read back", "0", got, differ == 0)


def estimated(folder: Path, log: str, result: str, *options: str) -> Contacts:
    """What the command finds in a log of the folder, written and read back."""
    must("estimate", folder / log, "--rig", folder / "rig.toml", "-o", folder / result, *options)
    return read_contacts(folder / result)


def _columns(contacts: Contacts) -> dict[str, np.ndarray]:
    found = {field.name: getattr(contacts.estimate, field.name) for field in fields(ContactEstimate)}
    del found["residual"]  # files do not hold it
    found["covariance"] = found["covariance"][:, *np.triu_indices(3)]  # and tables only this half
    return {"sample": contacts.sample, "time": contacts.time, "contact": contacts.identity, **found}


def differing(one: Contacts | None, other: Contacts) -> int:
    return -1 if one is None else unlike(_columns(one), _columns(other))


def unlike(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> int:
    """How many columns have other bits; NaN is NaN whatever it carries."""
    return sum(_bits(one[name]) != _bits(other[name]) for name in one)


def _bits(values: np.ndarray) -> bytes:
    known = np.where(np.isnan(values), np.nan, values) if values.dtype == np.float64 else values
    return str(values.shape).encode() + np.ascontiguousarray(known).tobytes()


# --- blocks


def _blocks(folder: Path, recording: Recording) -> Iterator[Row]:
    """Blocks of the same log for each filter, then single samples as a control loop gives them."""
    for name, made in FILTERS.items():
        chain = chain_of(folder, made)
        whole = streamed(chain, recording, WHOLE)
        counts = {f"blocks of {size}": unlike(whole, streamed(chain, recording, size)) for size in SIZES}
        if not chain.filter or not chain.filter.zero_phase:
            counts["update, sample by sample"] = unlike(whole, _updated(chain, recording))
        got = ", ".join(f"{what}: {count}" for what, count in counts.items())
        what = f"{name}, {len(recording):,} samples: columns of {len(whole)} that differ from those of one block"
        yield Row(what, "0", got, not any(counts.values()))


def chain_of(folder: Path, made: Filter | None, source: str = "none") -> WrenchEstimator:
    """Of the folder's rig, with a filter of its own and accelerations from `source`."""
    rig = load_rig(folder / "rig.toml")
    setup = rig.resolve("force_torque")
    payload, base = setup.of(ForceTorqueSection).payload, replace(rig, filter=RigFilter()).estimator()
    motion = None if payload is None else Motion(source, gravity=payload.gravity, lever=payload.center_of_mass)
    locator = Locator(base.locator.surface, noise=base.locator.noise, on=base.locator.on, off=base.locator.off)
    return WrenchEstimator(
        locator, Compensation(stated_sensor(setup), payload, motion), base.mount, filter=made, rate=200.0
    )


def streamed(chain: WrenchEstimator, recording: Recording, size: int) -> dict[str, np.ndarray]:
    """The columns of a recording's contacts, given in blocks of a size."""
    chain.reset()
    starts = range(0, len(recording), size)
    answers = chain.stream(recording.picked(slice(start, start + size)) for start in starts)
    return vars(ContactEstimate.joined([found.estimate for found in answers]))


def _updated(chain: WrenchEstimator, recording: Recording) -> dict[str, np.ndarray]:
    chain.reset()
    rotations = rotation_from_quaternion(recording.channels[ORIENTATION])
    samples = zip(recording.time.tolist(), recording.wrenches(), rotations, strict=True)
    return vars(ContactEstimate.joined([chain.update(*sample).estimate for sample in samples]))
