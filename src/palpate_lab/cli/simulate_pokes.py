"""`palpate simulate pokes`: record a skin of unknown taxel positions that is poked on an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.console.console import lines, note, title, wait
from palpate.errors import InputError
from palpate_lab.cli.simulate import complete_session, require_new

_PACE = (0.9, 0.1, 0.3, 1.0, 0.6)  # s: from poke to poke, rising, held, at rest before, moving: a quick hand
_MOST = 5000  # pokes: four hours of log, which are made in memory
_RIG = """# A forearm with {taxels} taxels, poked: to find where each of them sits. Lengths in metres.
[surface]
mesh = "forearm.stl"                 # the link's, in the link's frame
unit = "m"

[force_torque]
topic = "{wrench_topic}"

[skin]
topic = "{taxel_topic}"
count = {taxels}                          # numbers of a frame

[pokes]
urdf = "arm.urdf"                    # its joints are read from the log's joint states
sensor = "ft_sensor"                 # links of it
link = "forearm"
layout = "ring12"                    # of the modules
start = "cad.txt"                    # where CAD has the taxels; without it they are found from nothing
"""
_TOUCHES = """# The same skin in use, once `palpate calibrate taxels` has found its taxels.
[surface]
mesh = "forearm.stl"
unit = "m"

[skin]
topic = "{taxel_topic}"
bits = 8
taxels = "skin.toml"                 # of `palpate calibrate taxels`
"""


def simulate_pokes(
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")],
    seed: Annotated[int, arg(metavar="N")] = 0,
    pokes: Annotated[int, arg(metavar="N")] = 300,
) -> None:
    """Simulate a forearm whose taxels are poked.

    Record a simulated forearm whose taxels are poked in seven poses of the elbow, and touches of it afterwards.

    Args:
        output: folder to make: pokes.mcap, rig.toml, arm.urdf, forearm.stl, cad.txt, truth.csv; touches.mcap,
            touches.toml, touches_truth.csv; pairs.mcap, pairs_truth.csv; pokes.csv and other logs as tables.
        seed: seed of everything random.
        pokes: number of pokes; five per taxel are plenty.
    """
    require_new(output)
    if seed < 0:
        raise InputError("must not be negative.", where="--seed")
    if not 7 <= pokes <= _MOST:
        raise InputError(f"must be from 7 (one in each pose of the elbow) to {_MOST:,}, not {pokes}.", where="--pokes")
    from palpate_lab.simulation import poke_session_files as files  # here: with them comes scipy
    from palpate_lab.simulation.forearm import Forearm
    from palpate_lab.simulation.poke_bench import PokeBench
    from palpate_lab.simulation.poke_log import Timing

    wait("poking")
    rng = np.random.default_rng(seed)
    skin = Forearm.of()
    session = PokeBench.drawn(rng, skin=skin).session(rng, pokes)
    with complete_session(output) as part:
        log = files.write_poke_session(session, skin.cone, skin.cad(rng), part, rng, timing=Timing(*_PACE))
        names = {"wrench_topic": files.WRENCH_TOPIC, "taxel_topic": files.TAXEL_TOPIC, "taxels": len(skin.places)}
        (part / "rig.toml").write_text(_RIG.format(**names), encoding="utf-8")
        (part / "touches.toml").write_text(_TOUCHES.format(**names), encoding="utf-8")
    title(f"forearm with {len(skin.places)} taxels, seed {seed} -> {output}")
    lines(
        [
            ("pokes.mcap", f"{len(session.pokes)} pokes in {log.time[-1]:.0f} s, {len(session.bench.arm.table)} poses"),
            ("touches.mcap", "60 touches of the same skin; pairs.mcap: two at once"),
        ]
    )
    note(["truth.csv is where the taxels are, touches_truth.csv where it was touched; estimates never see them"])
