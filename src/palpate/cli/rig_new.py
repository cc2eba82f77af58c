"""`palpate rig new`: a commented rig to start from."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

from palpate.cli.console import note, title
from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import Log, Output, Scalar
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.rig import load_rig
from palpate.io.rig.body import Body
from palpate.io.rig.new import propose_rig

__all__ = ["rig_new"]


@dataclass(frozen=True)
class _Robot:
    """What of a URDF is touched.

    Args:
        link: of the URDF: which is touched.
        package: of the URDF, and where it is, if it is not found; may be given again.
    """

    link: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    package: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=FOLDER", help_behavior_hint="")] = ()


def rig_new(
    log: Log,
    mesh: Annotated[Positional[Path | None], arg(metavar="MESH")] = None,
    /,
    *,
    output: Output,
    sensor: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    rate: Scalar = None,
    topic: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    robot: Annotated[_Robot, arg(name="")],
    force: Annotated[bool, FlagCreatePairsOff] = False,
) -> None:
    """Guess a rig from the log of any sensor, and a mesh: which sensor, columns, units, noise.

    Args:
        log: CSV, Parquet, NumPy, MCAP or a ROS bag: of wrenches, of voltages of load cells, of frames of a taxel sheet.
        mesh: STL, OBJ, PLY or DAE of what is touched, or a robot's URDF.
        output: rig.toml to write.
        sensor: force_torque, load_cells or skin, where the log could be of several.
        rate: of the samples [Hz], where a table has no times, or only a counter.
        topic: of the sensor's readings, where the log has several.
        robot: what of the URDF is touched.
        force: overwrite a rig that is there already.
    """
    keep_inputs(output, (log, mesh))
    if output.exists() and not force:
        raise InputError("is there already.", where=str(output), hint="Add --force to overwrite it.")
    if rate is not None and not 0 < rate < inf:
        raise InputError("must be positive.", where="--rate")
    import_mesh_reader()
    body = None if mesh is None else Body.of(mesh, robot.link, _packages(robot.package))
    proposal = propose_rig(log, body, output.parent, sensor=sensor, topic=topic, rate=rate)
    write_text(output, proposal.text)
    load_rig(output)
    title(f"{log}{'' if mesh is None else f', {mesh}'} -> {output}")
    note([f"taken for {proposal.called}: {proposal.why}"])
    note(proposal.remarks, kind="check")
    note(["every line is a guess: read it once; the comments say which command fills in what is missing"])


def _packages(said: tuple[str, ...]) -> dict[str, Path]:
    pairs = [text.partition("=") for text in said]
    for name, equals, folder in pairs:
        if not (name and equals and folder):
            raise InputError("says where a package is: NAME=FOLDER.", where="--package")
    return {name: Path(folder) for name, _, folder in pairs}
