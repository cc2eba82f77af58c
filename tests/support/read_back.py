"""What was written, by readers that are not Palpate's: tables by Python's, recordings by the mcap library."""

import csv
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from claims.evidence.logs_written import ROS2


def rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, by column."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return log time [ns] and message, by topic, in the order of the file, which must be that of time."""
    found, times = dict[str, list[tuple[int, Any]]](), list[int]()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            times.append(message.log_time)
            read = ROS2.deserialize_cdr(message.data, schema.name)
            found.setdefault(channel.topic, []).append((message.log_time, read))
    assert times == sorted(times)
    return found
