"""Objects that have a reset, each in the middle of everything, and what they answer afterwards."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any
from unittest import mock

import numpy as np

import palpate
from claims.timings.control import FACE, NOISE, PAYLOAD, TIP, WANTED, Press, bent, elbow_arm
from palpate.contact import Status
from palpate.control.align import AlignController
from palpate.control.motion_bank import MotionBank
from palpate.control.servo import Servo
from palpate.control.supervisor import Limits, Supervisor
from palpate.control.touch_navigator import TouchNavigator, TouchNavigatorSettings
from palpate.errors import PalpateError
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.fused import cones
from palpate.sensors.fused.estimator import FusedEstimator
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE, Recording
from palpate.signals.vibration import Vibration
from palpate_lab.simulation.shapes import Superquadric
from tests.conformance.live import each_reading
from tests.support.streams import STREAMS, Stream, pieces, shaken


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
    uses: tuple[Callable[[Any], object], ...]
    reset: Callable[[Any], None]
    answers: Callable[[Any], Any]


def _reset(made: Any) -> None:
    made.reset()


def _read(log: Recording, made: Any) -> None:
    """A log, whose last blocks are never asked for."""
    next(made.stream(pieces(log.picked(slice(len(log) // 2)), len(log) // 4, 1)))


def _live(log: Recording, end: int, made: Any) -> None:
    """The end of a log, then its beginning, sample by sample, and one that is refused."""
    readings = list(each_reading(made, log))
    for reading in readings[-9:] + readings[:end]:
        made.update(*reading)
    with contextlib.suppress(PalpateError):
        made.update(readings[0][0], np.zeros(5), *readings[0][2:])


def _in_doubt(log: Recording, made: Any) -> None:
    """Without the solver that keeps forces within their cones."""
    with mock.patch.object(cones, "import_module", side_effect=ImportError):
        made.run(log)


def _answers(stream: Stream, made: Any) -> Any:
    part, live = stream.log.picked(slice(len(stream.log) // 2)), list[Any]()
    if stream.live:
        live = [made.run(part), *(made.update(*reading) for reading in list(each_reading(made, part))[:9])]
    known = [getattr(made, name, None) for name in ("force", "rest", "label", "unbelievable")]
    history = made.zero_history() if hasattr(made, "zero_history") else None
    read = list(made.stream([part]))
    return live, known, history, read, made.notes(), made.warnings()


def _of_stream(stream: Stream) -> Scene:
    uses: list[Callable[[Any], object]] = [partial(_read, stream.log), lambda made: list(made.stream([stream.log]))]
    uses += [partial(_live, stream.log, end) for end in stream.ends if stream.live]
    if isinstance(stream.make(), FusedEstimator) and stream.live:
        uses.append(partial(_in_doubt, stream.log))
    return Scene(stream.name, stream.make, tuple(uses), _reset, partial(_answers, stream))


def _zero(made: Any) -> list[Any]:
    """The zero of the first part of a log."""
    log, tracker = STREAMS[0].log, made
    given = ((part, None, k) for k, part in enumerate(log.picked(cut) for cut in tracker.pieces(log.time)))
    return list(tracker.both_sides(given))


def _begun(made: Any, *, ended: bool) -> None:
    """Windows whose zero is known and was not asked for, or is still to be smoothed."""
    log = STREAMS[0].log
    for cut in made.pieces(log.time):
        part = log.picked(cut)
        made.enter(float(part.time[0]), 300.0)
        made.add(part.time, made.sensor.kept(part))
    if ended:
        made.finish()


def _smoother() -> Any:
    made = next(each for each in STREAMS if each.name == "wrench, drift of a log").make()
    return made._wrenches._follows(smooth=True)


@cache
def _probe() -> tuple[palpate.Mesh, Any]:
    vertices, faces = Superquadric(FACE, (1.0, 1.0)).mesh(700)
    return palpate.Mesh.from_arrays(vertices + np.array([0.0, 0.0, TIP - FACE[2]]), faces), elbow_arm()


def _controller(*, tared: bool) -> AlignController:
    mesh, arm = _probe()
    sensor = Compensation(palpate.ForceTorque(NOISE), PAYLOAD)
    made = AlignController(arm, palpate.WrenchEstimator(mesh, sensor), WANTED, inertia=np.zeros((3, 3)))
    if tared:
        still, turn = np.tile(Press(arm, Servo()).read(0.0)[0], (60, 1)), arm.pose(bent()).quaternion()
        rest = {FORCE: still[:, :3], TORQUE: still[:, 3:], ORIENTATION: np.tile(turn, (60, 1))}
        made.tare(Recording(np.arange(60) / 100.0, rest), 0.0)
    return made


def _presses(made: AlignController, count: int = 260, begins: float = 0.0, ends: str = "") -> list[np.ndarray]:
    """Commands and contacts while it presses; every ninth command is lost.

    ends: with readings that are too strong, with one that is odd, with feedback that is odd, without any command that
    arrives, or with a clock that jumps.
    """
    plant, sent, commands, found = Press(made.arm, made.servo), bent(), 0, list[np.ndarray]()
    for k in range(count):
        (wrench, joints), last, now = plant.read(k / 200.0), count - k, begins + k / 200.0
        if (ends == "strong" and last < 8) or (ends == "odd" and last == 1):
            wrench += [0.0, 0.0, -40.0 if ends == "strong" else -6.0, 0.0, 0.0, 0.0]
        joints = joints + 0.2 * (ends == "feedback" and last == 1)
        command = made.update(now + 100.0 * (ends == "jump" and last == 1), wrench, joints).copy()
        if not np.array_equal(command, sent):
            sent, commands = command, commands + 1
            if commands % 9 and not (ends == "lost" and last < 40):
                plant.robot.send(k / 200.0, sent)
        found.append(np.concatenate([command, made.contact]))
    return found


def _controls(made: AlignController) -> Any:
    before = made.contact.copy(), made.state, made.why
    return before, _presses(made, 200, 50.0), made.state, made.why, made.drifted


def _supervised(seed: int, count: int, made: Supervisor) -> list[Any]:
    """States by readings near the wanted force, some of which are strong, saturated or none."""
    rng, found = np.random.default_rng(seed), list[Any]()
    for k in range(count):
        kind = rng.choice(4, p=[0.9, 0.04, 0.03, 0.03])
        status = (Status.CONTACT, Status.NO_CONTACT, Status.INVALID, Status.SATURATED)[kind]
        made.fresh(k / 50.0, status, rng.choice([5.2, 7.0, 12.0], p=[0.45, 0.5, 0.05]))
        made.pressed(k / 50.0) if rng.random() < 0.4 else made.silent(k / 50.0 + 0.002)
        found.append((made.state, made.why, made.settled, made.retreating))
    made.silent(count / 50.0 + 0.2)
    return found


def _moves(made: MotionBank) -> list[Any]:
    """Predictions of readings that swing."""
    found = list[Any]()
    for k in range(40):
        made.update(0.01, np.sin([0.1 * k, 0.2 * k, 0.3 * k]), np.full(3, 1e-4))
        found.append(tuple(each.copy() for each in made.predict(0.05)))
    return found


def _drives(kind: str, made: TouchNavigator) -> list[tuple[Any, ...]]:
    """A robot that presses at what does not move, is pressed at its flanks, whose left track stands, or that stands."""
    rng, pose, found = np.random.default_rng(7), np.zeros(3), list[tuple[Any, ...]]()
    for k in range(390):
        touches = np.empty((0, 2))
        if kind == "ahead" and k % 150 > 20:
            touches = np.array([[0.1 + 0.05 * rng.normal(), 1.5]])
        elif kind == "flanks" and k % 90 > 40:
            touches = np.array([[1.5, 2.4], [-1.5, 2.3]])
        left, right = made.update(k / 30.0, None if k == 77 else touches, pose)
        moves = kind != "stands" and not (kind == "ahead" and len(touches))
        ran = (0.0 if kind == "stuck" else left) * moves, right * moves
        step, turn = sum(ran) / 60.0, (ran[1] - ran[0]) / made.drive.track / 30.0
        pose += [step * np.cos(pose[2]), step * np.sin(pose[2]), turn]
        found.append((left, right, made.state, made.why, made.arrived))
    return found


def _surrounded(made: TouchNavigator) -> None:
    for turn in np.linspace(0.0, 2.0 * np.pi, 200):
        made.map.touch(0.0, 0.3 * np.cos(turn), 0.3 * np.sin(turn), 50.0)
    for k in range(3):
        made.update(0.4 * k, np.empty((0, 2)), np.zeros(3))


def _arrives(made: TouchNavigator) -> None:
    made.update(0.0, np.empty((0, 2)), np.array([1.2, 0.0, 0.0]))


def _shakes(made: Vibration) -> Any:
    return made.notes(), [list(made.stream(iter([shaken()]), Recording.wrenches)) for _ in range(2)] and made.notes()


def _restart(*given: Any) -> Callable[[Any], None]:
    return lambda made: made.start(*given)


ENDS = ("", "strong", "odd", "feedback", "lost", "jump")
DRIVES = ("ahead", "flanks", "stuck", "stands")
SHY = TouchNavigatorSettings(doubt=2.0, ground=40, still=(0.06, 3.0), patience=1e3)
SCENES = (
    *map(_of_stream, STREAMS),
    Scene("zero of a log", _smoother, tuple(partial(_begun, ended=ended) for ended in (True, False)), _reset, _zero),
    Scene("vibration", lambda: Vibration(np.eye(6) * 1e-4), (_shakes,), _reset, _shakes),
    Scene(
        "controller",
        partial(_controller, tared=True),
        tuple(partial(_presses, ends=ends) for ends in ENDS),
        _restart(50.0, bent()),
        _controls,
    ),
    Scene("new controller", partial(_controller, tared=False), (lambda _: None,), _restart(50.0, bent()), _controls),
    Scene(
        "supervisor",
        lambda: Supervisor(Limits(), WANTED),
        tuple(partial(_supervised, seed, count) for seed, count in ((1, 60), (2, 80), (3, 95), (4, 120), (5, 37))),
        _restart(0.0),
        partial(_supervised, 9, 200),
    ),
    Scene("motions", lambda: MotionBank([0.2, 0.2, 0.01]), (_moves,), _restart([1.0, 2.0, 3.0]), _moves),
    Scene(
        "navigator",
        lambda: TouchNavigator((1.2, 0.0), settings=SHY),
        (*(partial(_drives, kind) for kind in DRIVES), _surrounded, _arrives),
        _reset,
        lambda made: [_drives(kind, made) for kind in DRIVES],
    ),
)
