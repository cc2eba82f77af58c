"""The pictures of the documentation, each by a function of its name, from the project's own commands and library.

Run: `make pictures`, after `make demo`; or `python docs/pictures/make.py FOLDER [NAME ...]`, of another demo's and only
those that are named. Sessions that several pictures share are made once, in FOLDER/pictures. Pages are photographed in
chromium (`make browser`).
"""

from __future__ import annotations

import sys
from pathlib import Path

import others
import peers
import probe
import skins
from drawing import HERE

OF_THE_DEMO = (probe.demo, probe.ellipses, probe.candidates, probe.report, probe.view)
SIMULATED = (
    *(skins.skin_map, skins.skin_contacts, skins.fusion, skins.taxels),
    *(others.design, others.fingertip, others.drift, others.marker_ring, others.phantom, others.arena, others.robot),
    peers.benchmark,
)


def main(folder: Path, names: list[str]) -> None:
    """Make those that are named, or all."""
    folder = folder.resolve()
    made = folder / "pictures"
    made.mkdir(parents=True, exist_ok=True)
    for maker in (*OF_THE_DEMO, *SIMULATED):
        if not names or maker.__name__ in names:
            maker(folder if maker in OF_THE_DEMO else made)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1] / "demo", sys.argv[2:])
