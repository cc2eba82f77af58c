"""`palpate rig new`: a commented rig to start from."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import FlagCreatePairsOff

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import Log, MeshFile, Output
from palpate.cli.screen import note, title
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.rig import load_rig
from palpate.io.rig.new import propose_rig

__all__ = ["rig_new"]


def rig_new(log: Log, mesh: MeshFile, /, output: Output, force: Annotated[bool, FlagCreatePairsOff] = False) -> None:
    """Guess a rig from a log and a mesh: columns, units, noise.

    Args:
        log: of wrenches: CSV, Parquet, MCAP or a ROS bag.
        mesh: STL, OBJ, PLY or DAE.
        output: rig.toml to write.
        force: overwrite a rig that is there already.
    """
    keep_inputs(output, (log, mesh))
    if output.exists() and not force:
        raise InputError("is there already.", where=str(output), mend="Add --force to overwrite it.")
    import_mesh_reader()
    proposal = propose_rig(log, mesh, output.parent)
    write_text(output, proposal.text)
    load_rig(output)
    title(f"{log}, {mesh} -> {output}")
    note(proposal.remarks, kind="check")
    note(
        [
            "every line is a guess: read it once, then `palpate calibrate payload`, fill in payload and pose, "
            "then `palpate calibrate mounting`"
        ]
    )
