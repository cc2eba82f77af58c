"""The front door with wrong arguments: a sentence that says what is taken and the line to write, never a raw error."""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl
import trimesh

import palpate
from claims.row import ROOT, Row
from palpate.setup import Rig
from palpate.setup.tables import RigSurface
from palpate_lab.papers.navigator import PaperNavigator

SHOWN = 3  # calls that are named in a row
INTERNAL = re.compile(  # what only those know who have read the code, or Python
    r"(?<![\w\"'.])_\w+|has no attribute|positional argument|NoneType|<class|<function|weak reference|codec|dtype|"
    r"unsupported operand|jaxtyping|beartype|palpate\.\w+\._"
)
LINE = re.compile(r"Write .*\w[\w.]*[(=\[]|Write .*palpate\.\w")


class Tensor:
    """What another library computes on another device: NumPy cannot read it."""

    shape = (6,)

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("can't convert cuda:0 device type tensor to numpy")

    def __len__(self) -> int:
        return 6


class Foreign:
    """A value of somebody else's class."""


def _wrong_values() -> dict[str, Any]:
    return {
        "None": None,
        "text": "probe",
        "a path": Path("probe.stl"),
        "a number": 3.5,
        "an array": np.zeros((2, 6)),
        "texts": np.array(["a", "b"]),
        "lists of two lengths": [[1.0, 2.0], [3.0]],
        "a mapping": {"force": [0.0, 0.0, 1.0]},
        "a function": len,
        "a class": palpate.Mesh,
        "a tensor": Tensor(),
        "a DataFrame": pl.DataFrame({"name": ["a", "b"]}),
        "a Payload": palpate.Payload(mass=0.4),
        "somebody's": Foreign(),
    }


_NO_NUMBERS = ("None", "text", "a path", "texts", "lists of two lengths", "a mapping", "a function", "a tensor")
_WRONG: dict[str, tuple[str, ...]] = {  # kind of an argument -> what it cannot be
    "numbers": (*_NO_NUMBERS, "a class", "a DataFrame", "a Payload", "somebody's"),
    "number": ("text", "a path", "an array", "a mapping", "a function", "a tensor", "a Payload"),
    "surface": ("None", "a number", "an array", "a mapping", "a function", "a tensor", "a DataFrame", "a Payload"),
    "path": ("None", "a number", "an array", "a mapping", "a function", "a tensor", "a Payload", "somebody's"),
    "log": ("None", "a number", "a function", "a tensor", "a Payload", "somebody's"),
    "rig": ("a number", "an array", "a mapping", "a function", "a tensor", "a DataFrame", "a Payload"),
    # of an enumeration, which compares arrays itself before anything else is called
    "status": ("None", "text", "a number", "a mapping", "a function", "somebody's"),
    "value": ("None", "text", "a number", "an array", "a mapping", "a function", "a DataFrame", "somebody's"),
}


_KINDS = {  # of arguments, by their names; what is not here is a value
    "numbers": "wrench noise wrenches positions normals force torque vector rotation translation quaternion_xyzw "
    "matrix weight rotations limits time vertices faces point normal goal origin heading",
    "number": "friction rate mass cutoff q track",
    "surface": "surface locator",
    "path": "path",
    "log": "log",
    "rig": "rig",
}
_KIND = {name: kind for kind, names in _KINDS.items() for name in names.split()}


def _calls(probe: Path) -> list[tuple[str, Callable[..., Any], dict[str, Any], str]]:
    """Calls with their arguments, and which of these are spoilt; NAME=KIND where the name does not say the kind."""
    mesh, box = palpate.plane([0, 0, 0], [0, 0, 1]), trimesh.creation.box()
    wrench, pose = np.array([0, 0, -5.0, 0.02, 0, 0]), palpate.Pose.identity()
    contact, locator = palpate.locate(wrench, mesh), palpate.Locator(mesh)
    sensor = palpate.ForceTorque(noise=(0.02, 1e-3))
    contacts = palpate.WrenchEstimator(locator, sensor).update(0.0, wrench)
    turns, many = np.tile([0, 0, 0, 1.0], (9, 1)), np.tile(wrench, (9, 1))
    time, rig, zero = np.arange(9.0), Rig(RigSurface("plane")), np.zeros(3)
    body, anywhere = palpate.TaxelBody, {"positions": turns[:, :3], "normals": turns[:, 1:]}
    wrenches = {"wrenches": many, "rotations": turns}
    mounting = {"wrenches": many, "surface": mesh, "initial": pose}
    mapping = {"mesh": mesh, "sheet": palpate.Sheet(6, 22, (0.01, 0.01)), "origin": zero, "heading": np.ones(3)}
    estimator = {"locator": locator, "sensor": sensor, "mount": pose}
    turned = {"quaternion_xyzw": turns[0], "translation": zero}
    mesh_of, arrays = palpate.Mesh.from_trimesh, {"vertices": mesh.vertices, "faces": mesh.faces}
    return [
        ("locate", palpate.locate, {"wrench": wrench, "surface": mesh}, "wrench surface"),
        ("locate", palpate.locate, {"wrench": wrench, "surface": mesh, "noise": (0.02, 1e-3)}, "noise"),
        ("Locator", palpate.Locator, {"surface": mesh}, "surface"),
        ("Locator", palpate.Locator, {"surface": mesh, "friction": 1.0}, "friction"),
        ("Locator.run", locator.run, {"wrenches": many}, "wrenches"),
        ("estimate", palpate.estimate, {"log": "log.csv", "rig": rig}, "log rig"),
        ("open_log", palpate.open_log, {"log": "log.csv", "rig": rig}, "log rig"),
        ("load_rig", palpate.load_rig, {"path": "rig.toml"}, "path"),
        ("open_live", palpate.open_live, {"rig": rig}, "rig"),
        ("rig.estimator", rig.estimator, {"rate": 200.0}, "rate"),
        ("WrenchEstimator", palpate.WrenchEstimator, estimator, "locator sensor mount"),
        ("Compensation", palpate.Compensation, {"sensor": sensor, "payload": None}, "sensor"),
        ("TaxelEstimator", palpate.TaxelEstimator, {"body": None}, "body"),
        ("RingEstimator", palpate.RingEstimator, {"ring": None}, "ring"),
        ("LoadCellArray", palpate.LoadCellArray, {"cells": None}, "cells"),
        ("TaxelBody.anywhere", body.anywhere, anywhere, "positions normals"),
        ("TaxelBody.sheet", body.sheet, {"place": None}, "place"),
        ("Wrench", palpate.Wrench, {"force": wrench[:3], "torque": wrench[3:]}, "force torque"),
        ("Wrench.from_vector", palpate.Wrench.from_vector, {"vector": wrench}, "vector"),
        ("Wrench.transformed", palpate.Wrench.from_vector(wrench).transformed, {"pose": pose}, "pose"),
        ("Pose", palpate.Pose, {"rotation": np.eye(3), "translation": zero}, "rotation translation"),
        ("Pose.from_quaternion", palpate.Pose.from_quaternion, turned, "quaternion_xyzw translation"),
        ("Pose.from_matrix", palpate.Pose.from_matrix, {"matrix": np.eye(4)}, "matrix"),
        ("Payload", palpate.Payload, {"mass": 0.4}, "mass"),
        ("Payload", palpate.Payload, {"weight": [0, 0, -4.0]}, "weight"),
        ("Payload.load", palpate.Payload.load, {"path": "payload.toml"}, "path"),
        ("identify_payload", palpate.identify_payload, wrenches, "wrenches rotations"),
        ("identify_mounting", palpate.identify_mounting, mounting, "wrenches surface=value initial"),
        ("map_skin", palpate.map_skin, mapping, "mesh sheet origin heading"),
        ("ForceTorque", palpate.ForceTorque, {"noise": (0.02, 1e-3)}, "noise"),
        ("ForceTorque", palpate.ForceTorque, {"limits": np.ones(6)}, "limits"),
        ("Recording", palpate.Recording, {"time": time, "channels": {}}, "time channels"),
        ("Butterworth", palpate.Butterworth, {"cutoff": 10.0}, "cutoff"),
        ("Kalman", palpate.Kalman, {"q": 1e-6}, "q"),
        ("Mesh.load", palpate.Mesh.load, {"path": probe, "unit": "mm"}, "path"),
        ("Mesh.from_trimesh", mesh_of, {"mesh": box, "unit": "mm"}, "mesh"),
        ("Mesh.from_arrays", palpate.Mesh.from_arrays, arrays, "vertices faces"),
        ("plane", palpate.plane, {"point": zero, "normal": np.ones(3)}, "point normal"),
        ("contact.in_frame", contact.in_frame, {"pose": pose}, "pose"),
        ("contacts.in_frame", contacts.in_frame, {"pose": pose}, "pose"),
        ("contacts.save", contacts.save, {"path": "contacts.csv"}, "path"),
        ("contacts.plot", contacts.plot, {"surface": mesh}, "surface"),
        ("Contacts.load", palpate.Contacts.load, {"path": "contacts.csv"}, "path"),
        ("Status", palpate.Status, {"value": 0}, "value=status"),
        ("AlignController", palpate.AlignController, {"arm": None, "estimator": None}, "estimator"),
        ("DifferentialDrive", palpate.DifferentialDrive, {"track": 0.085}, "track"),
        ("TouchNavigator", palpate.TouchNavigator, {"goal": (1.2, 0.0)}, "goal"),
        ("PaperNavigator", PaperNavigator, {"goal": (1.2, 0.0)}, "goal"),
    ]


def wrong_calls(probe: Path) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Return each with its name: one argument spoilt, one too many, none at all; `probe` is a mesh in mm."""
    values = _wrong_values()
    for name, call, arguments, spoilt in _calls(probe):
        kinds = spoilt.split()
        for argument, _, kind in (each.partition("=") for each in kinds):
            optional = argument in ("noise", "limits", "mount", "weight", "rate", "mass") or name == "contacts.plot"
            for what in _WRONG[kind or _KIND.get(argument, "value")]:
                if not (what == "None" and optional) and not (what == "a mapping" and argument == "channels"):
                    yield f"{name}({argument}: {what})", call, {**arguments, argument: values[what]}
        if name != "Status":
            yield f"{name}(nonsense: 1)", call, {**arguments, "nonsense": 1}
            if len(kinds) == len(arguments) > 1:
                yield f"{name}()", call, {}


def rows(small: bool) -> Iterator[Row]:
    """In full every call; small, every seventh. In a process of its own, which checks no annotation as tests do."""
    command = [sys.executable, "-m", "claims.evidence.front_door", "7" if small else "1"]
    made = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    count, found = json.loads(made.stdout)
    for what, cases in found.items():
        got = f"{len(cases)} of {count}" + "".join(f"; {case}" for case in cases[:SHOWN])
        yield Row(f"wrong calls of the front door: {what}", "0", got, not cases)


def main(step: int) -> None:
    """Make every so-many-th call, and print how many there were and what was wrong with which."""
    raw, silent, internal, without = list[str](), list[str](), list[str](), list[str]()
    with TemporaryDirectory() as folder:
        probe = Path(folder) / "probe.stl"
        trimesh.creation.box((20, 20, 20)).export(probe)
        every = list(wrong_calls(probe))[::step]
        for name, call, arguments in every:
            try:
                call(**arguments)
            except palpate.PalpateError as said:
                internal += [f"{name}: {said}"] if INTERNAL.search(str(said)) else []
                without += [f"{name}: {said}"] if not LINE.search(str(said)) else []
            except Exception as problem:
                raw.append(f"{name}: {type(problem).__name__} {problem}")
            else:
                silent.append(name)
    found = {
        "errors that are not Palpate's": raw,
        "that are answered": silent,
        "sentences with the name of an internal": internal,
        "sentences without a line to write": without,
    }
    sys.stdout.write(json.dumps([len(every), found]))


if __name__ == "__main__":
    main(int(sys.argv[1]))
