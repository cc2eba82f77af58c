"""Run `palpate rig new`: write a commented rig to start from."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

from palpate.console.console import note, title
from palpate.console.options import FileOption, NameOption, Output, Scalar
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.datasets import is_dataset, read_dataset, write_named
from palpate.files.urdf import Urdf
from palpate.live.capture import listen, stated_source
from palpate.setup import load_rig
from palpate.setup.body import GivenBody
from palpate.setup.guess import quoted
from palpate.setup.load import load_robot
from palpate.setup.new import propose_rig
from palpate.setup.robot_new import propose_robot

_BODIES = (".stl", ".obj", ".ply", ".dae", ".urdf")


@dataclass(frozen=True)
class _Robot:
    """The touched part of a URDF.

    Args:
        link: link of the URDF that is touched.
        package: package that the URDF names, and its folder, if it is not found; may be given again.
    """

    link: NameOption = None
    package: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=FOLDER", help_behavior_hint="")] = ()


def rig_new(
    log: Annotated[Positional[Path | None], arg(metavar="LOG")] = None,
    mesh: Annotated[Positional[Path | None], arg(metavar="MESH")] = None,
    /,
    *,
    output: Output,
    sensor: NameOption = None,
    rate: Scalar = None,
    topic: NameOption = None,
    poses: FileOption = None,
    source: Annotated[NameOption, arg(metavar="KIND:ADDRESS")] = None,
    robot: Annotated[_Robot, arg(name="")],
    force: Annotated[bool, FlagCreatePairsOff] = False,
) -> None:
    """Guess a rig from a log and a mesh.

    Guess a rig from the log of any sensor, and a mesh: which sensor, columns, units, noise.

    Args:
        log: CSV, Parquet, NumPy, MCAP or a ROS bag: of wrenches, of voltages of load cells, of frames of a taxel sheet.
            Or the folder of a LeRobot data set, whose features state names.
            With --source it may be omitted: then three seconds of the untouched device are used.
        mesh: STL, OBJ, PLY or DAE of what is touched, or a robot's URDF: without --link every topic of the log that is
            a sensor's is put on its link.
        output: rig.toml to write.
        sensor: force_torque, load_cells or skin, where the log could be of several.
        rate: sampling rate [Hz], where a table has no times, or only a counter.
        topic: topic of the sensor's readings, where the log has several.
        poses: second table, of the sensor's poses on the log's clock, where the log has none.
        source: live samples: netft:NAME, serial:/dev/ttyUSB0, ros2, camera:0 or replay:LOG; `palpate live` uses it.
        robot: touched part of the URDF.
        force: overwrite a rig that is there already.

    Raises:
        InputError: a file or an option cannot be used, the log is not recognised, the output exists and `force` is not
            set, or neither log nor source is given.
        OSError: the device cannot be read.
        GeometryError: the mesh has no usable surface.
    """
    live = None if source is None else stated_source(source)
    if live is not None and mesh is None and log is not None and log.suffix.lower() in _BODIES:
        log, mesh = None, log
    keep_inputs(output, (log, mesh, poses))
    if output.exists() and not force:
        raise InputError("already exists.", where=str(output), hint="Add --force to overwrite it.")
    if rate is not None and not 0 < rate < inf:
        raise InputError("must be positive.", where="--rate")
    if log is not None and mesh is not None and mesh.suffix.lower() == ".urdf" and robot.link is None:
        _write_robot(log, Urdf(mesh, _packages(robot.package)), output)
        return
    body = None if mesh is None else GivenBody.of(mesh, robot.link, _packages(robot.package))
    with TemporaryDirectory() as scratch:
        seen = log if log is not None or live is None else listen(live, Path(scratch))
        if seen is None:
            raise InputError("is missing: give a log, or a device to listen to.", where="LOG or --source")
        named = dict[str, str]()
        if is_dataset(seen):
            if poses is not None:
                raise InputError("is for tables, not for a data set.", where="--poses", hint="Leave it out.")
            data, seen = read_dataset(seen), Path(scratch) / seen.resolve().name
            named = write_named(data, seen)
        proposal = propose_rig(seen, body, output.parent, sensor=sensor, topic=topic, rate=rate, poses=poses)
    text = proposal.text + ("" if live is None else live.text())
    for name, column in named.items():
        text = text.replace(quoted(name), quoted(column))
    write_text(output, text)
    load_rig(output)
    title(f"{', '.join(str(each) for each in (log or source, mesh) if each)} -> {output}")
    note([f"taken for {proposal.called}: {proposal.why}"])
    note(proposal.remarks, kind="check")
    note(["every line is a guess: check each one; the comments name the commands that find missing values"])


def _write_robot(log: Path, urdf: Urdf, output: Path) -> None:
    """Write the rig of a robot with a sensor for each topic of the log."""
    proposal = propose_robot(log, urdf, output.parent)
    write_text(output, proposal.text)
    load_robot(output)
    title(f"{log}, {urdf.path} -> {output}")
    note([f"taken for {proposal.called}: {proposal.why}"])
    note(proposal.remarks, kind="check")
    note(["every line is a guess: check each one; `palpate inspect` lists the sensors, and what is missing"])


def _packages(options: tuple[str, ...]) -> dict[str, Path]:
    pairs = [text.partition("=") for text in options]
    for name, equals, folder in pairs:
        if not (name and equals and folder):
            raise InputError("must state where a package is, as NAME=FOLDER.", where="--package")
    return {name: Path(folder) for name, _, folder in pairs}
