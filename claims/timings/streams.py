"""Logs and loops beside what a user would otherwise take: rosbags, the mcap library, SciPy, NumPy. In one run."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from claims.clock import in_turns
from claims.evidence.long_logs import RATE, pieces, write_log
from claims.page import table
from palpate.files.contacts import open_contacts
from palpate.files.logs import open_log
from palpate.files.logs.layout import LogLayout
from palpate.sensors.force_torque.compensation import Compensation
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation import simulate_session
from palpate_lab.simulation.session import NOISE, Session

ROUNDS = 3


def report(samples: int) -> str:
    """Return the tables in Markdown: microseconds a sample, the median of the rounds."""
    session = simulate_session(facets=20_000)
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "log.mcap"
        write_log(log, session, samples)
        titled = {
            "Reading an MCAP of a wrench and a pose a sample": _readers(log),
            "Writing contacts": _writers(session, Path(scratch), samples),
            "Through the estimator, 20k facets, payload, full answers": _loops(session, samples),
        }
        tables = list[str]()
        for title, variants in titled.items():
            spent = {name: 1e6 * float(np.median(each)) / samples for name, each in in_turns(variants, ROUNDS).items()}
            first = next(iter(spent.values()))
            rows = [[name, f"{each:,.2f}", f"{each / first:.1f}"] for name, each in spent.items()]
            tables.append(table((title, "us", "over the first"), rows, "---:"))
    return "\n\n".join(tables)


def _readers(log: Path) -> dict[str, Callable[[], Any]]:
    def ours() -> None:
        for _ in open_log(log, LogLayout()).blocks():
            pass

    def rosbags(*, decode: bool) -> None:
        from rosbags.highlevel import AnyReader

        with AnyReader([log]) as reader:
            for connection, _, raw in reader.messages():
                if decode:
                    reader.deserialize(raw, connection.msgtype)

    def library() -> None:
        from mcap.reader import make_reader

        with log.open("rb") as file:
            for _ in make_reader(file).iter_messages(log_time_order=False):
                pass

    return {
        "palpate: joined, checked, in SI": ours,
        "rosbags: bytes": lambda: rosbags(decode=False),
        "rosbags: decoded": lambda: rosbags(decode=True),
        "mcap library: bytes": library,
    }


def _estimator(session: Session, filtered: palpate.Butterworth | None = None) -> palpate.WrenchEstimator:
    mesh = palpate.Mesh.from_arrays(session.vertices, session.faces)
    load = session.load
    covariance = np.diag(np.repeat([1e-3, 1e-3, 1e-5, 1e-5], 3) ** 2)
    weight = np.array([0.0, 0.0, -9.80665 * load.mass])
    payload = palpate.Payload(weight, load.force_bias, load.center_of_mass, load.torque_bias, covariance)
    sensor = palpate.ForceTorque(NOISE)
    locator = palpate.Locator(mesh, noise=NOISE, on=0.5, off=0.3)
    return palpate.WrenchEstimator(
        locator, Compensation(sensor, payload), session.true, np.eye(6) * 1e-8, filtered, RATE
    )


def _recordings(session: Session, samples: int) -> list[palpate.Recording]:
    return [
        palpate.Recording(
            rows[:, 0].copy(),
            {FORCE: rows[:, 1:4].copy(), TORQUE: rows[:, 4:7].copy(), ORIENTATION: rows[:, 7:].copy()},
        )
        for rows in pieces(session, samples)
    ]


def _writers(session: Session, folder: Path, samples: int) -> dict[str, Callable[[], Any]]:
    blocks = list(_estimator(session).pairs(_recordings(session, samples)))

    def ours(suffix: str) -> Callable[[], None]:
        def write() -> None:
            with open_contacts(folder / f"contacts{suffix}") as output:
                for _, found in blocks:
                    output.write(found)

        return write

    return {f"palpate: {suffix}": ours(suffix) for suffix in (".mcap", ".parquet", ".csv")} | {
        "mcap library: one message a sample, bytes given": lambda: _library_writes(folder / "theirs.mcap", samples)
    }


def _library_writes(path: Path, samples: int) -> None:
    from mcap.writer import CompressionType, Writer

    payload = bytes(264)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start("ros2", "benchmark")
        channel = writer.register_channel("/contact", "cdr", writer.register_schema("c", "ros2msg", b""))
        for k in range(samples):
            writer.add_message(channel, k, payload, k)
        writer.finish()


def _loops(session: Session, samples: int) -> dict[str, Callable[[], Any]]:
    blocks = _recordings(session, samples)
    plain, smooth = _estimator(session), _estimator(session, palpate.Butterworth(15.0))
    rows = np.concatenate([block.wrenches() for block in blocks])
    turns = rotation_from_quaternion(np.concatenate([block.channels[ORIENTATION] for block in blocks]))
    out = plain.locator.empty()

    def live(estimator: palpate.WrenchEstimator) -> None:
        for k in range(samples):
            estimator.update_into(k / RATE, rows[k], out, turns[k])

    def scipy_filter() -> None:
        from scipy.signal import butter, sosfilt

        sosfilt(butter(2, 15.0, fs=RATE, output="sos"), rows, axis=0)

    payload = plain.sensor.payload
    return {
        "stream": lambda: list(plain.stream(blocks)),
        "stream, Butterworth": lambda: list(smooth.stream(blocks)),
        "update_into, sample by sample from Python": lambda: live(plain),
        "update_into, Butterworth": lambda: live(smooth),
        "NumPy: Payload.compensate alone": lambda: payload.compensate(rows, turns) if payload else None,
        "SciPy: the Butterworth filter alone": scipy_filter,
    }
