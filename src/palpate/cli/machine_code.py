"""The first time, the longest work of the compiler is shared with processes of their own.

Every compiled function is kept on disk and compiled by one process (`surfaces._jit`), so whoever needs it next finds it
there or waits: these processes need to be told nothing and asked nothing.
"""

from __future__ import annotations

import subprocess
import sys
from functools import cache

import numpy as np

from palpate.cli.console import wait
from palpate.contact.locate import Locator
from palpate.io.rig import Rig
from palpate.sensors.filters import Butterworth
from palpate.sensors.smoothing import Forward
from palpate.surfaces.mesh import Mesh

__all__ = ["compile_beside", "main", "preparing"]

HALF, ALL = "half", "all"
WRENCHES = ("force_torque", "load_cells")  # sensors whose contacts are located from wrenches


def preparing(rig: Rig, sensor: str) -> None:
    """Say what is waited for before a surface is prepared, and start what makes it shorter."""
    wait("preparing the surface and compiling kernels (compiling happens once)")
    if sensor in WRENCHES and rig.surface is not None and rig.surface.kind == "mesh":
        compile_beside()


@cache
def compile_beside() -> None:
    """Where this version was never run here, start the processes that compile for contacts on a mesh."""
    from palpate.contact import _kernel  # compiled: loaded when first needed
    from palpate.surfaces._jit import on_disk

    if not on_disk(_kernel.estimate_many):
        _STARTED.extend(_start(part) for part in (HALF, ALL))


_STARTED: list[subprocess.Popen[bytes]] = []  # they end by themselves


def _start(part: str) -> subprocess.Popen[bytes]:
    nowhere = subprocess.DEVNULL
    command = [sys.executable, "-m", "palpate.cli.machine_code", part]
    return subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere)


def main(part: str) -> None:
    """Compile for contacts on a mesh: one half and a filter, or all that is not there yet."""
    from palpate.contact import _kernel

    if part == HALF:
        _kernel.compile_half()
        Forward(Butterworth(10.0).recursion(100.0), 100.0)(np.zeros(1), np.zeros(1, np.int8), np.zeros((1, 6)))
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
    Locator(Mesh.from_arrays(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])))


if __name__ == "__main__":
    main(*sys.argv[1:])
