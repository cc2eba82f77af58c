"""Whether contacts have a row for every sample of a log, both counted without palpate."""

import contextlib
import re
import sqlite3
from pathlib import Path

import polars as pl

from claims.evidence.good_files import SAMPLES
from claims.evidence.mcap_records import MAGIC, counted
from palpate_lab.simulation.session_files import WRENCH_TOPIC

CONTACT = "/palpate/contact/estimate", ("palpate_msgs/Contact",)
WRENCHES = ("geometry_msgs/WrenchStamped", "geometry_msgs/Wrench")


def unanswered(command: str, bad: Path, out: Path) -> str:
    words = command.split()
    if words[0] != "estimate":
        return ""
    log = Path(words[1])
    topic = WRENCH_TOPIC if "--rig" in words else None
    least, most = _samples(log, topic) if log == bad else (SAMPLES, SAMPLES)
    rows, numbered = _rows(out)
    if not least <= rows <= most:
        return f"{rows} rows out of {least} to {most} samples"
    return "" if numbered else "samples are not numbered from 0 in order"


def _rows(out: Path) -> tuple[int, bool]:
    if out.suffix == ".mcap":
        return counted(out.read_bytes(), *CONTACT)[0], True
    table = pl.read_csv(out, infer_schema=False) if out.suffix == ".csv" else pl.read_parquet(out)
    return table.height, table["sample"].cast(pl.Int64).to_list() == list(range(table.height))


def _samples(log: Path, topic: str | None) -> tuple[int, int]:
    """The least and the most that a log has, counted without palpate."""
    if log.is_dir():
        return _of_database(next(log.glob("*.db3")))
    data = log.read_bytes()
    if data.startswith(MAGIC):
        return counted(data, topic, WRENCHES)
    if data.startswith(b"#ROSBAG"):
        return _of_bag(log)
    if data.startswith(b"PAR1"):
        return (int(pl.scan_parquet(log, glob=False).select(pl.len()).collect().item()),) * 2
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", errors="replace").encode()
    lines = data.removeprefix(b"\xef\xbb\xbf").split(b"\n" if b"\n" in data else b"\r")
    rows = [line.strip() for line in lines if line.strip() and not line.startswith((b"#", b"%", b"//"))]
    named = not rows or not re.match(rb"[-+.\d]", rows[0])  # without names the first line is a sample
    return len(rows) - 1, len(rows) - named


def _of_database(file: Path) -> tuple[int, int]:
    query = "select count(*) from messages, topics where topics.id = topic_id and name = ?"
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.text_factory = bytes
        return (int(database.execute(query, [WRENCH_TOPIC]).fetchone()[0]),) * 2


def _of_bag(file: Path) -> tuple[int, int]:
    from rosbags.rosbag1 import Reader

    with Reader(file) as bag:
        count = sum(1 for connection, *_ in bag.messages() if connection.topic == WRENCH_TOPIC)
    return count, count
