"""Valid calls of what neither the examples nor the commands call, with arguments that annotations do not make."""

from typing import Any

import numpy as np

from claims.evidence.call_values import Seen


def more_calls(made: dict[str, dict[str, Any]], *, small: bool) -> None:
    """Make them, with what examples made: their variables by the number of each."""
    _poses_and_motion()
    _filters(np.random.default_rng(0))
    _surfaces()
    if not small:
        _compiled()
    _calibrations(np.random.default_rng(1))
    _live()
    _drawn()
    _estimators(made)


def _poses_and_motion() -> None:
    from palpate.calibration.clock import suspected_offset
    from palpate.contact.locate import Locator
    from palpate.control.control_law import Sensed
    from palpate.control.probe_face import ProbeFace
    from palpate.control.stability import Admittance, DelayedRobot
    from palpate.signals.acceleration import kind_of_acceleration
    from palpate.signals.payload import Payload
    from palpate.signals.vibration import Vibration
    from palpate.spatial.live_track import LiveTrack
    from palpate.spatial.pose import Pose
    from palpate.surfaces import Sphere
    from palpate_lab.papers.probe_law import Plain

    time, still = np.arange(20) * 0.01, np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))
    track = LiveTrack()
    track.add(time, still, np.zeros((20, 3)))
    track.at(time)
    Pose.from_matrix(np.eye(4))
    track.lag(time)
    kind_of_acceleration(np.tile([0.0, 0.0, 9.8], (5, 1)), "m/s^2")
    suspected_offset(time, np.zeros((20, 6)), still, Payload())
    Vibration(np.eye(6))
    Locator(Sphere(0.02), noise=np.eye(6)).least_forces(np.tile(np.eye(6), (5, 1, 1)))
    face = ProbeFace.of(Sphere(0.02).mesh(300))
    plain = Plain(face, 5.0, Admittance(10.0, 290.0), 0.5, stiffest=2500.0)
    plain.start(Sensed())
    plain.press(Sensed(), 0.01, np.zeros(6))
    plain.hold(0.0, np.eye(3), np.zeros(3), 0.01, np.zeros(6))
    robot = DelayedRobot(0.01, delay=2)
    robot.move(np.zeros((robot.size, 2)), np.zeros(2), np.zeros(2))


def _filters(rng: np.random.Generator) -> None:
    from palpate.signals.filters import Butterworth, Kalman
    from palpate.signals.smoothing import BothWays
    from palpate.signals.spectrum import spectrum

    time = np.arange(400) * 0.01
    kalman = Kalman()
    kalman.gain(np.array([1.0, 5.0]), 100.0)
    kalman.delay(np.array([1.0, 5.0]), 100.0)
    item = None, time, np.full(400, -1, np.int8), rng.normal(size=(400, 6))
    list(BothWays(Butterworth(10.0).recursion(100.0), 100.0).through([item]))
    spectrum(time, rng.normal(size=(400, 3)))


def _compiled() -> None:
    from palpate.surfaces.implicit import superquadric

    superquadric((0.03, 0.02, 0.01), (0.7, 0.7)).evaluate(np.full((4, 3), 0.01))  # numba compiles it for seconds


def _surfaces() -> None:
    from palpate.contact.locate import Locator
    from palpate.surfaces import Sphere
    from palpate_lab.papers.iterative import fit_paraboloid, locate_iteratively

    mesh = Sphere(0.02).mesh(5000)
    fitted = fit_paraboloid(mesh, (0.0, 0.0, 0.02), 4e-3)
    wrench = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    locate_iteratively(wrench, fitted, start=fitted.origin)
    locator = Locator(mesh, noise=np.repeat([0.02, 0.001], 3))
    free = np.full(4, -1, np.int8)
    locator.first_free(np.tile(wrench, (4, 1)), None, free)


def _calibrations(rng: np.random.Generator) -> None:
    from palpate.calibration.drift import identify_drift
    from palpate.optical.fisheye import Fisheye
    from palpate.sensors.force_torque.calibrate_imu import identify_payload_with_imu
    from palpate.sensors.marker_ring.calibrate_camera import fit_lens
    from palpate.sensors.taxels.calibrate import identify_resistive
    from palpate.sensors.taxels.mat import identify_by_pressures, pressure_errors
    from palpate.sensors.taxels.model import TaxelBody
    from palpate.sensors.taxels.poking.pokes import Pokes
    from palpate.sensors.taxels.skin_map.layout import Sheet
    from palpate.sensors.taxels.skin_map.model import flat_map
    from palpate.sensors.taxels.skin_map.sheet import fit_stretch, map_skin
    from palpate.sensors.taxels.two_loggers import joined, loggers_offset
    from palpate.spatial.pose import Pose
    from palpate.surfaces import Mesh

    time = np.arange(0.0, 90.0, 0.1)
    walk = np.cumsum(rng.normal(0.0, 1e-3, (len(time), 2)), axis=0)
    fit = identify_drift(time, walk + rng.normal(0.0, 0.01, walk.shape))
    fit.spread(np.array([True, False, True]))
    pressed = np.clip(np.sin(0.3 * time**1.4), 0.0, None)
    loggers_offset(time, 40.0 + 9e3 * pressed, time - 1.2, pressed)
    joined(time, time, pressed)
    pressures, mat = np.arange(6.0) * 1e4, TaxelBody.sheet(flat_map(2, 3, 0.01), bits=None)
    frames = 0.01 * pressures[:, None] * np.linspace(0.8, 1.2, 6) + rng.normal(0.0, 1.0, (6, 6))
    identify_by_pressures(pressures, frames, mat)
    pressure_errors(pressures, frames, mat)
    up = rng.normal(size=(16, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    load = np.hstack([-8.0 * up, np.cross([0.01, 0.0, 0.04], -8.0 * up)]) + rng.normal(0.0, 1e-3, (16, 6))
    identify_payload_with_imu(load, 9.80665 * up + rng.normal(0.0, 0.01, (16, 3)))
    pushed, turns = rng.normal(size=(10, 6)), np.tile(np.eye(3), (10, 1, 1))
    made = Pokes.from_table(
        pushed, turns, np.zeros((10, 3)), np.zeros(10, np.int64), rng.normal(size=(10, 4)), noise=np.eye(6)
    )
    made.picked(np.arange(10) < 5)
    force, layer = rng.uniform(0.1, 8.0, 200), np.arange(200) % 2
    reading = 1024.0 * (1.0 - 10.0 / (34.0 / force + np.array([0.5, 1.6])[layer]))
    identify_resistive(force, reading, scale=1024.0, reference=np.full(200, 10.0), layer=layer, floor=20.0)
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    board = 0.01 * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    turns, places = rng.uniform(-0.5, 0.5, (6, 3)), rng.uniform((-0.12, -0.09, 0.08), (0.04, 0.02, 0.14), (6, 3))
    lens = Fisheye(205.0, 204.0, 321.5, 237.5, 0.02, -0.008, 0.002, -0.0003)
    poses = [Pose.from_rotation_vector(*each) for each in zip(turns, places, strict=True)]
    fit_lens([lens.project(pose.apply(board)) for pose in poses], (9, 6), 0.01, (640, 480))
    flat = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]])
    mesh = Mesh.from_arrays(flat, np.array([[0, 1, 2], [0, 2, 3]]))
    laid: dict[str, Any] = {"origin": (0.01, 0.01, 0.0), "heading": (1, 0, 0)}
    truth = map_skin(mesh, Sheet(3, 4, (0.01, 0.01), stretch=(1.05, 1.1)), **laid)
    known = {cell: truth.centres[cell] for cell in ((0, 3), (2, 2), (2, 3))}
    fit_stretch(mesh, Sheet(3, 4, (0.01, 0.01)), known, **laid)


def _live() -> None:
    from palpate.live.cobs import encoded
    from palpate.live.lines import printed
    from palpate.live.netft_status import status_word
    from palpate.live.poses import LivePoses
    from palpate.live.ros_messages import image_message
    from palpate.setup.guess_time import TimeGuess

    numbers = np.arange(12.0).reshape(2, 6)
    encoded(numbers, 1, "f8")
    printed(numbers, 1)
    status_word("Net F/T").bad(np.array([0, 1 << 31]))
    LivePoses(None).at(np.array([0, 10**9]))
    image_message(0, "camera", np.zeros((4, 5, 3), np.uint8))
    TimeGuess("time", "").judged(np.arange(50) * 0.01, "s", "")


def _drawn() -> None:
    from palpate_lab.viewer.arena import Trails

    Trails(2).add(np.zeros((2, 3)))


def _estimators(made: dict[str, dict[str, Any]]) -> None:
    """One live sample, and some in a row, of the estimators of the examples that were run."""
    from palpate.contact.frames import in_base
    from palpate.optical.markers import find_colour

    for number, name in (("09", "estimator"), ("06", "fingertip"), ("07", "skin"), ("08", "estimator")):
        if number not in made:
            continue
        there, turns = made[number], list[Any]()
        estimator, log = (
            there[name],
            there.get("log") or (there["images"] if number == "08" else there["session"].frames),
        )
        readings = next(
            (log.channels[each] for each in estimator.channels if each in log.channels and number != "09"), None
        )
        if readings is None:
            readings, turns = log.wrenches(), [there["rotations"][0]]
        extra = {name: log.channels[name][:5] for name in ("orientation",) if name in log.channels}
        time, room, few = log.time.tolist(), estimator.empty(5 * estimator.most), 2 if number == "08" else 5
        estimator.run_into(log.time[:few], readings[:few], room, np.zeros(few, np.int64), extra)
        estimator.update(time[5], readings[5], *turns)
        estimator.update_into(time[6], readings[6], estimator.empty(), *turns)
        estimator.pairs([log.picked(log.time < time[5])])
        if number == "06":
            _voltages(estimator.sensor, log, readings)
        if number == "08":
            find_colour(log.channels["image"][0], 24)
        if number == "09":
            sensor = estimator.sensor
            sensor.kept_of(sensor.inputs(log.time[:5], readings[:5], extra), 5)
            one = estimator.run(log.picked(log.time < time[5]))
            in_base(one.estimate, extra["orientation"], np.zeros((5, 3)), estimator.mount)


def _voltages(sensor: Any, log: Any, readings: np.ndarray) -> None:
    sensor.single(float(log.time[7]), readings[7])
    sensor.hold(float(log.time[8]), readings[8], None, None)
    kept = sensor.kept_of(sensor.inputs(log.time[:5], readings[:5], {}), 5)
    sensor.free(kept)
    sensor.as_wrench(kept, np.eye(kept.shape[1]))


def fused_calls(seen: Seen) -> None:
    """Samples of the estimator of a skin and a force/torque sensor, and of its locator, as the commands left them."""
    from palpate.sensors.fused.cones import within_cones
    from palpate.sensors.fused.estimator import FusedEstimator
    from palpate.sensors.fused.lasting_unseen import fuse_with_unseen
    from palpate.sensors.fused.locator import FusedLocator

    within_cones(np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([1]), [np.eye(3)], 0.5)
    estimator, locator, turn = seen.of(FusedEstimator), seen.of(FusedLocator), np.eye(3)
    width = len(estimator.taxels.body) + 7
    estimator.update(1e4, np.zeros(width), turn)
    estimator.update_into(1e4 + 0.1, np.zeros(width), estimator.empty(), turn)
    extra = {"orientation": np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))}
    time = 1e4 + np.array([0.2, 0.3])
    estimator.run_into(time, np.zeros((2, width)), estimator.empty(2 * estimator.most), np.zeros(2, np.int64), extra)
    touch = (np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1), np.ones(1), np.eye(3)[None])
    wrench = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    locator.fuse(*touch, wrench[None], np.eye(6)[None])
    row = locator.rows(*touch)
    fuse_with_unseen(locator, row, np.array([1]), np.tile(row, (1, 2, 1)), wrench[None], np.eye(6)[None])
