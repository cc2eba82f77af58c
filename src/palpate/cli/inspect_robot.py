"""Print the sensors of a robot's rig and what is missing, for `palpate inspect`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from palpate.cli.estimate_robot import facts_of
from palpate.cli.inspect_log import inspect_readings, say_contents
from palpate.console.console import lines, note, part, table, title
from palpate.errors import PalpateError
from palpate.files.logs import contents
from palpate.files.logs.layout import LogLayout
from palpate.setup.robot import Robot, RobotSensor

_BODY = ("mesh", "urdf", "kinematics")  # files that are not a sensor's model


def inspect_robot(robot: Robot) -> None:
    """Print a robot: what it consists of, a row for each sensor, and what is missing, one sentence each."""
    title(f"{robot.path}: a rig of a robot")
    lines(facts_of(robot))
    header = ("sensor", "kind", "link", "size", "model", "source")
    table(header, [_row(each) for each in robot.sensors.values()])
    missing = [f"{name}: {problem}" for name, problem in robot.faulty.items()]
    missing += [f"{each.name}: {said}" for each in robot.sensors.values() for said in _missing(each)]
    note(missing, kind="warning")


def inspect_robot_log(file: Path, robot: Robot, sensors: str | None) -> bool:
    """Print figures of a robot's log: its topics, and the readings of each sensor; return whether it is cut off.

    Args:
        file: the log.
        robot: the robot.
        sensors: names of sensors, with commas between; None: all.

    Raises:
        InputError: there is no sensor of a name, or the log cannot be read.
    """
    title(f"{file}: a log")
    there, torn = contents(file), False
    say_contents(there)
    for each in robot.picked(sensors):
        part(each.name)
        lines([("sensor", each.name)])
        try:
            torn |= inspect_readings(file, there, each.rig, None, None)[1]
        except PalpateError as problem:
            note([f"{each.name}: {problem}"], kind="warning")
    return torn


def _row(sensor: RobotSensor) -> tuple[str, ...]:
    models = [path.name for _, path in _models(sensor)]
    topics = [str(table.topic) for table in sensor.rig.sensors.values() if getattr(table, "topic", None)]
    live = "" if sensor.rig.source is None else sensor.rig.source.kind
    return (
        sensor.name,
        sensor.kind.name,
        sensor.link or "-",
        _size(sensor),
        ", ".join(models) or "-",
        ", ".join([*topics, *filter(None, [live])]) or "-",
    )


def _models(sensor: RobotSensor) -> Iterator[tuple[str, Path]]:
    for key, path in sensor.rig.files().items():
        if not key.startswith(_BODY):
            yield key, path


def _size(sensor: RobotSensor) -> str:
    """Return the numbers of one reading."""
    try:
        layout: LogLayout = sensor.rig.layout()
    except PalpateError:  # which `_missing` states
        return "-"
    shapes = [" x ".join(map(str, array.shape)) for array in layout.arrays]
    return ", ".join(["6"] * (layout.wrench is not None) + shapes) or "image"


def _missing(sensor: RobotSensor) -> Iterator[str]:
    """Yield what is missing of a sensor."""
    if not sensor.link:
        yield "the link that it is on is not stated, so its contacts have no base frame"
    absent = [path for path in sensor.rig.files().values() if not path.exists()]
    yield from (f"{path} does not exist yet" for path in absent)
    if not absent:
        try:
            sensor.rig.layout()
        except PalpateError as problem:
            yield str(problem)
