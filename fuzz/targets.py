"""What is fuzzed: a function of bytes for each reader, which may raise nothing but a `PalpateError`."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from fuzz.messages import messages
from fuzz.packets import door, frames, net_ft, net_ft_page, page, ring
from palpate.errors import PalpateError
from palpate.files.arm import load_arm
from palpate.files.ati import AtiCalibration
from palpate.files.contacts import read_contacts
from palpate.files.ground_truth import read_ground_truth
from palpate.files.logs import contents, open_log
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.opening import frames_named, topic_fields, topic_shapes
from palpate.files.mcap.regain import regained
from palpate.files.models import read_model
from palpate.files.urdf import Kinematics, Urdf
from palpate.live.cobs import CobsFrames
from palpate.live.lines import LineFrames
from palpate.sensors.marker_ring.lens_file import read_lens
from palpate.sensors.taxels.place_formats import holds_taxels, read_taxel_places
from palpate.sensors.taxels.poking.files import read_pokes
from palpate.sensors.taxels.skin_map.files import read_skin_map
from palpate.setup.load import load_rig, robot_of
from palpate.surfaces import Mesh

Target = Callable[[bytes], None]
_MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
FOLDER = Path(tempfile.mkdtemp(prefix="palpate-fuzz-", dir=_MEMORY))
"""Where the input lies as a file, with the files that a good rig names."""
_SKIN = LogLayout(arrays=(ArrayChannel("cells", (8, 8)),), wrench=None, rate=100.0)


def _file(suffix: str, *readers: Callable[[Path], object]) -> Target:
    """Return the target that writes the bytes to a file and reads it in all of these ways."""
    path = FOLDER / f"input{suffix}"

    def target(data: bytes) -> None:
        path.write_bytes(data)
        for read in readers:
            with suppress(PalpateError):
                read(path)

    return target


def _log(path: Path, layout: LogLayout | None = None) -> None:
    for _ in open_log(path, layout).blocks():
        pass


def _topics(path: Path) -> None:
    """Read a log of messages in the ways that a command looks at one first."""
    topic_shapes(path), topic_fields(path)
    there = contents(path).topics
    frames_named(path, there)
    tree, urdf = LogLayout(frames=("world", "ft_sensor")), FOLDER / "wrist.urdf"
    for layout in (tree, LogLayout(frames=("base_link", "ft_sensor"), urdf=urdf, joints_topic="/joint_states")):
        with suppress(PalpateError):
            _log(path, layout)


def _urdf(path: Path) -> None:
    urdf = Urdf(path)
    for link in urdf.links[:8]:
        with suppress(PalpateError):
            urdf.root(link)
            urdf.body(link)
    for link in urdf.links[:8]:
        with suppress(PalpateError):
            moved = Kinematics(urdf, urdf.links[0], link)
            moved.poses(np.ones((2, len(moved.joints))))
        with suppress(PalpateError):
            load_arm(path, urdf.links[0], link)


def _robot(path: Path) -> None:
    robot = robot_of(path)
    for each in [] if robot is None else robot.sensors.values():
        with suppress(PalpateError):
            each.rig.files()
            each.rig.estimator(rate=200.0)


def _rig(path: Path) -> None:
    rig = load_rig(path)
    rig.files()
    rig.estimator(rate=200.0)


def _mesh(suffix: str) -> Target:
    return _file(suffix, lambda path: Mesh.load(path, unit="mm"))


TARGETS: dict[str, Target] = {
    "netft": net_ft,
    "lines": frames(6, lambda: LineFrames(6)),
    "lines_named": frames(3, lambda: LineFrames(3, (0, 2, 5))),
    "cobs": frames(6, lambda: CobsFrames(6)),
    "messages": messages,
    "csv": _file(".csv", contents, _log),
    "rig": _file(".toml", _rig),
    "robot": _file(".toml", _robot),
    "urdf": _file(".urdf", _urdf),
    "mcap": _file(".mcap", contents, _log, _topics),
    "mcap_torn": _file(".part", regained),
    "places": _file(".txt", holds_taxels, read_taxel_places),
    "netft_page": net_ft_page,
    "page": page,
    "door": door,
    "ring": ring(FOLDER / "input.ring"),
    "model": _file(".toml", read_model),
    "contacts": _file(".csv", read_contacts),
    "contacts_mcap": _file(".mcap", read_contacts),
    "truth": _file(".csv", read_ground_truth),
    "pokes": _file(".csv", read_pokes),
    "skin_map": _file(".csv", read_skin_map),
    "ati": _file(".cal", AtiCalibration.of),
    "lens": _file(".yaml", read_lens),
    "npy": _file(".npy", contents, _log, lambda path: _log(path, _SKIN)),
    "npz": _file(".npz", contents, _log),
    "bag": _file(".bag", contents, _log),
    "db3": _file(".db3", contents, _log),
    "parquet": _file(".parquet", contents, _log),
    "contacts_parquet": _file(".parquet", read_contacts),
    "stl": _mesh(".stl"),
    "obj": _mesh(".obj"),
    "ply": _mesh(".ply"),
    "dae": _mesh(".dae"),
    "video": _file(".avi", contents),
}
"""Name -> target; those that read bytes by code of this project come first."""
