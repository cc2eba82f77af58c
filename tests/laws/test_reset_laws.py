"""Law 2: after `reset` an object is as a new one, in all that it answers and in all that it remembers.

Whatever has a `reset` is found in the source, and each of its statements is left out in turn: a scene must notice.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import inspect
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

import palpate
from claims.timings.control import FACE, NOISE, PAYLOAD, TIP, Press, bent, elbow_arm
from palpate.control.align import AlignController
from palpate.control.servo import Servo
from palpate.control.touch_navigator import TouchNavigator
from palpate.errors import PalpateError
from palpate.sensors.force_torque.compensation import Compensation
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE, Recording
from palpate_lab.simulation.shapes import Superquadric
from tests.conformance.live import each_reading
from tests.support.state import differences, parts
from tests.support.streams import STREAMS, Stream, pieces

SOURCE = Path(palpate.__file__).parent
CACHES = (  # of what follows from settings alone; what numbers of earlier blocks mean; and inputs that are all written
    *("Compensation._means", "Compensation._placement", "Compensation._constant", "Compensation._vibration"),
    *("LoadCellArray._placement", "LoadCellArray._turned", "LoadCellArray.revision", "Compensation.revision"),
    *("LiveLoop.", "Vibration.covariances", "Vibration._first", "FusedLocator.", "Cylinder."),
    *("Compensation.live_inputs", "LoadCellArray.live_inputs"),
)
ROOM = (  # to work in: what it holds is not read before it is written, or it would be noticed when it is spoilt
    *("TaxelFrames._unfiltered", "TaxelEstimator._one", "FusedEstimator._rows", "RingEstimator._scratch"),
    *("MarkerTracker._out", "MarkerTracker._sample", "MotionBank._rate", "MotionBank._value"),
    *(f"AlignController.{name}" for name in ("_feedback", "_felt", "_foremost", "_motion", "_moved", "_spent")),
    *("AlignController._stance", "AlignController._upright"),
    *(f"Follow.{name}" for name in ("_axes", "_origin", "_readings", "_right", "_sums", "_variances")),
    *(f"Sensed.{name}" for name in ("force", "place", "rotation", "time", "tip", "variance")),
    *(f"ServoModel.{name}" for name in ("_gain", "_sent", "_slopes", "_targets", "_trial")),
)
STARTS = ("AlignController", "Supervisor", "ServoModel", "MotionBank")  # what `start` begins anew


@dataclass(frozen=True)
class Scene:
    """An object that has a reset.

    Attributes:
        name: of it.
        make: a new one, tared.
        uses: each leaves it in the middle of something.
        reset: of it.
        answers: to a stream.
    """

    name: str
    make: Callable[[], Any]
    uses: tuple[Callable[[Any], None], ...]
    reset: Callable[[Any], None]
    answers: Callable[[Any], Any]


def _of_stream(stream: Stream) -> Scene:
    log = stream.log
    part = log.picked(slice(int(0.45 * len(log))))  # in the middle of a touch

    def read(made: Any) -> None:
        """A log, whose last block is never asked for."""
        next(made.stream(pieces(part, len(part) // 3, 1)))

    def live(made: Any) -> None:
        """Samples alone and in blocks, the end of the log before its beginning, and one that is refused."""
        made.run(log)
        readings = list(each_reading(made, log))
        for reading in readings[-9:] + readings[: len(part)]:
            made.update(*reading)
        with contextlib.suppress(PalpateError):
            made.update(readings[0][0], np.zeros(5), *readings[0][2:])

    def answers(made: Any) -> Any:
        found = [made.run(part)] if stream.live else []
        found += [made.update(*reading) for reading in list(each_reading(made, part))[:9]] if stream.live else []
        history = made.zero_history() if hasattr(made, "zero_history") else None
        said = made.notes(), made.warnings(), made.unbelievable, getattr(made, "force", None), history
        return found, said, list(made.stream([log])), made.notes(), made.warnings()

    def whole(made: Any) -> None:
        list(made.stream([log]))

    return Scene(stream.name, stream.make, (read, whole, live)[: 2 + stream.live], lambda made: made.reset(), answers)


@cache
def _probe() -> tuple[palpate.Mesh, Any]:
    vertices, faces = Superquadric(FACE, (1.0, 1.0)).mesh(700)
    return palpate.Mesh.from_arrays(vertices + np.array([0.0, 0.0, TIP - FACE[2]]), faces), elbow_arm()


def _controller() -> AlignController:
    mesh, arm = _probe()
    sensor = Compensation(palpate.ForceTorque(NOISE), PAYLOAD)
    made = AlignController(arm, palpate.WrenchEstimator(mesh, sensor), 7.0, inertia=np.zeros((3, 3)))
    still, turn = np.tile(Press(arm, Servo()).read(0.0)[0], (60, 1)), arm.pose(bent()).quaternion()
    rest = {FORCE: still[:, :3], TORQUE: still[:, 3:], ORIENTATION: np.tile(turn, (60, 1))}
    made.tare(Recording(np.arange(60) / 100.0, rest), 0.0)
    return made


def _presses(made: AlignController, seconds: float = 1.6, begins: float = 0.0) -> list[np.ndarray]:
    """Commands while it presses, every ninth of which the robot never gets; at the end the force is too large."""
    plant, sent, count, found = Press(made.arm, made.servo), bent(), 0, list[np.ndarray]()
    for k in range(round(200.0 * seconds)):
        wrench, joints = plant.read(k / 200.0)
        if k > 200.0 * seconds - 8:
            wrench = wrench * 40.0
        command = made.update(begins + k / 200.0, wrench, joints).copy()
        if not np.array_equal(command, sent):
            sent, count = command, count + 1
            if count % 9:
                plant.robot.send(k / 200.0, sent)
        found.append(np.append(command, made.contact))
    return found


def _controls(made: AlignController) -> Any:
    return _presses(made, 0.9, 50.0), made.state, made.why, made.drifted


def _strays(stuck: bool) -> Callable[[TouchNavigator], list[tuple[Any, ...]]]:
    """A robot that presses at something ahead, then at its flanks, and moves little; of a stuck one a track stands."""

    def answers(made: TouchNavigator) -> list[tuple[Any, ...]]:
        rng, pose, found = np.random.default_rng(7), np.zeros(3), list[tuple[Any, ...]]()
        for k in range(400):
            touched = k % 90 > 40 and not stuck
            touches = rng.normal([0.1, 2.0], [0.9, 0.4], (2, 2)) if touched else np.empty((0, 2))
            left, right = made.update(k / 30.0, None if k == 77 else touches, pose)
            left = 0.0 if stuck else left
            step, turn = 0.3 * (left + right) / 60.0, (right - left) / 0.1 / 30.0
            pose = pose + [step * np.cos(pose[2]), step * np.sin(pose[2]), turn]
            found.append((left, right, made.state, made.why, made.arrived))
        return found

    return answers


def _arrives(made: TouchNavigator) -> None:
    made.update(0.0, np.empty((0, 2)), np.array([1.2, 0.0, 0.0]))


SCENES = (
    *map(_of_stream, STREAMS),
    Scene("controller", _controller, (_presses,), lambda made: made.start(50.0, bent()), _controls),
    Scene(
        "navigator",
        lambda: TouchNavigator((1.2, 0.0)),
        (_strays(False), _strays(True), _arrives),
        lambda made: made.reset(),
        lambda made: (_strays(False)(made), _strays(True)(made)),
    ),
)


def _left(used: Any, fresh: Any) -> list[str]:
    """Where a used object differs from a new one, but for caches and room to work in."""
    return sorted({each for each in differences(used, fresh) if not each.startswith((*CACHES, *ROOM))})


def _spoil(made: Any) -> None:
    """Fill its room to work in with what is no answer."""
    for part in parts(made):
        for name in ROOM:
            kind, _, field = name.partition(".")
            values = getattr(part, field, None) if kind == type(part).__name__ else None
            for each in values if isinstance(values, tuple) else (values,):
                if isinstance(each, np.ndarray) and each.flags.writeable:
                    each[...] = np.nan if each.dtype == np.float64 else 77


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_reset_is_a_new_object(scene: Scene) -> None:
    for use in scene.uses:
        used, fresh = scene.make(), scene.make()
        use(used)
        scene.reset(used)
        scene.reset(fresh)
        assert not _left(used, fresh)
        _spoil(used)
        assert not _left(scene.answers(used), scene.answers(fresh))
        assert not _left(used, fresh)


def _resets() -> Iterator[tuple[type, str]]:
    """Class and method of every reset in the source, but for those of interfaces."""
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and "Protocol" not in map(ast.unparse, node.bases):
                module = ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)
                for each in node.body:
                    name = each.name if isinstance(each, ast.FunctionDef) else ""
                    if name == "reset" or (name == "start" and node.name in STARTS):
                        yield getattr(importlib.import_module(module), node.name), name


def _steps(tree: ast.AST) -> list[ast.AST]:
    """What a method sets or calls, one after the other, without its docstring."""
    kinds = ast.Attribute | ast.Subscript
    stored = (isinstance(each, kinds) and isinstance(each.ctx, ast.Store) for each in ast.walk(tree))
    found = (each for each, keep in zip(ast.walk(tree), stored, strict=True) if keep or isinstance(each, ast.Expr))
    return [each for each in found if not isinstance(getattr(each, "value", None), ast.Constant)]


class _Without(ast.NodeTransformer):
    """Leave out one of the steps."""

    def __init__(self, node: ast.AST) -> None:
        self.node = node

    def visit(self, node: ast.AST) -> ast.AST:
        if node is self.node:
            return ast.Pass() if isinstance(node, ast.Expr) else ast.Name("_", ast.Store())
        return self.generic_visit(node)


def _mutants(kind: type, method: str) -> Iterator[tuple[str, Callable[..., None]]]:
    """Yield the method without each of its steps."""
    source = textwrap.dedent(inspect.getsource(getattr(kind, method)))
    for k in range(len(_steps(ast.parse(source)))):
        tree = ast.parse(source)
        step = _steps(tree)[k]
        said = f"{kind.__name__}.{method}: {ast.unparse(step)}"
        outer = ast.parse(f"def outer(__class__):\n    return {method}").body[0]  # `super()` looks for that name
        assert isinstance(outer, ast.FunctionDef)
        outer.body.insert(0, _Without(step).visit(tree).body[0])
        names = dict(vars(inspect.getmodule(kind)))
        exec(compile(ast.fix_missing_locations(ast.Module([outer], [])), said, "exec"), names)
        yield said, names["outer"](kind)


@cache
def _fresh(scene: Scene) -> tuple[Any, frozenset[type]]:
    """A new object after a reset, and the classes of what it has."""
    made = scene.make()
    scene.reset(made)
    return made, frozenset(base for part in parts(made) for base in type(part).__mro__)


def _noticed(scene: Scene, kind: type, method: str, mutant: Any) -> bool:
    for use in scene.uses:
        used = scene.make()
        use(used)
        with mock.patch.object(kind, method, mutant):
            scene.reset(used)
        if _left(used, _fresh(scene)[0]):
            return True
    return False


@pytest.mark.parametrize(("kind", "method"), list(_resets()), ids=lambda value: getattr(value, "__name__", value))
def test_each_step_of_a_reset_is_missed_where_it_is_left_out(kind: type, method: str) -> None:
    scenes = [scene for scene in SCENES if kind in _fresh(scene)[1]]
    assert scenes, f"{kind.__name__} has a reset and no scene"
    for said, mutant in _mutants(kind, method):
        if not any(_noticed(scene, kind, method, mutant) for scene in scenes): print("MISSED", said)
