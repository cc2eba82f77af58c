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
    from palpate.control.control_law import Sensed
    from palpate.control.probe_face import ProbeFace
    from palpate.control.stability import Admittance, DelayedRobot
    from palpate.spatial.live_track import LiveTrack
    from palpate.spatial.pose import Pose
    from palpate.surfaces import Sphere
    from palpate_lab.papers.probe_law import Plain

    time, track = np.arange(20) * 0.01, LiveTrack()
    track.add(time, np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)), np.zeros((20, 3)))
    track.at(time)
    track.lag(time)
    Pose.from_matrix(np.eye(4))
    plain = Plain(ProbeFace.of(Sphere(0.02).mesh(300)), 5.0, Admittance(10.0, 290.0), 0.5, stiffest=2500.0)
    plain.start(Sensed())
    plain.press(Sensed(), 0.01, np.zeros(6))
    plain.hold(0.0, np.eye(3), np.zeros(3), 0.01, np.zeros(6))
    robot = DelayedRobot(0.01, delay=2)
    robot.move(np.zeros((robot.size, 2)), np.zeros(2), np.zeros(2))


def _filters(rng: np.random.Generator) -> None:
    from palpate.signals.filters import Kalman
    from palpate.signals.spectrum import spectrum

    Kalman().gain(np.array([1.0, 5.0]), 100.0)
    Kalman().delay(np.array([1.0, 5.0]), 100.0)
    spectrum(np.arange(400) * 0.01, rng.normal(size=(400, 3)))


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
    locator.first_free(np.tile(wrench, (4, 1)), None, np.full(4, -1, np.int8))


def _calibrations(rng: np.random.Generator) -> None:
    from palpate.calibration.drift import identify_drift
    from palpate.optical.fisheye import Fisheye
    from palpate.sensors.force_torque.calibrate_imu import identify_payload_with_imu
    from palpate.sensors.marker_ring.calibrate_camera import fit_lens
    from palpate.sensors.taxels.calibrate import identify_resistive
    from palpate.sensors.taxels.mat import identify_by_pressures, pressure_errors
    from palpate.sensors.taxels.model import TaxelBody
    from palpate.sensors.taxels.modules import ModuleLayout
    from palpate.sensors.taxels.poking.moved_modules import moved_far
    from palpate.sensors.taxels.poking.numbering import found_numbering
    from palpate.sensors.taxels.poking.pokes import Pokes
    from palpate.sensors.taxels.poking.rigid_groups import fitted
    from palpate.sensors.taxels.poking.spacing import scale_in_places
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
    mat.frames(frames)
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
    one = ModuleLayout(flat[:, :2], np.zeros(4, np.int64))
    scale_in_places(fitted(one, flat, None), flat)
    moved_far(one, flat, flat)
    found_numbering(one, flat, np.tile([0.0, 0.0, 1.0], (4, 1)))
    mesh = Mesh.from_arrays(flat, np.array([[0, 1, 2], [0, 2, 3]]))
    laid: dict[str, Any] = {"origin": (0.01, 0.01, 0.0), "heading": (1, 0, 0)}
    truth = map_skin(mesh, Sheet(3, 4, (0.01, 0.01), stretch=(1.05, 1.1)), **laid)
    known = {cell: truth.centres[cell] for cell in ((0, 3), (2, 2), (2, 3))}
    fit_stretch(mesh, Sheet(3, 4, (0.01, 0.01)), known, **laid)


def _live() -> None:
    from palpate.live.cobs import encoded
    from palpate.live.netft_status import status_word
    from palpate.live.poses import LivePoses
    from palpate.live.ros_messages import image_message
    from palpate.setup.guess_time import TimeGuess

    encoded(np.arange(12.0).reshape(2, 6), 1, "f8")
    status_word("Net F/T").bad(np.array([0, 1 << 31]))
    LivePoses(None).at(np.array([0, 10**9]))
    image_message(0, "camera", np.zeros((4, 5, 3), np.uint8))
    TimeGuess("time", "").judged(np.arange(50) * 0.01, "s", "")


def _drawn() -> None:
    from palpate_lab.viewer.arena import Trails

    Trails(2).add(np.zeros((2, 3)))


def _estimators(made: dict[str, dict[str, Any]]) -> None:
    """Some samples in a row, and the parts of a sensor, of the examples that were run."""
    from palpate.contact.frames import in_base

    if "09" in made:
        estimator, log = made["09"]["estimator"], made["09"]["log"].picked(slice(5))
        turned = {"orientation": log.channels["orientation"]}
        given = log.time, log.wrenches()
        estimator.run_into(*given, estimator.empty(5 * estimator.most), np.zeros(5, np.int64), turned)
        estimator.sensor.kept_of(estimator.sensor.inputs(*given, turned), 5)
        in_base(estimator.run(log).estimate, turned["orientation"], np.zeros((5, 3)), estimator.mount)
    if "06" in made:
        sensor, log = made["06"]["fingertip"].sensor, made["06"]["log"]
        readings = log.channels["voltage"]
        sensor.single(float(log.time[7]), readings[7])
        sensor.hold(float(log.time[8]), readings[8], None, None)
        kept = sensor.kept_of(sensor.inputs(log.time[:5], readings[:5], {}), 5)
        sensor.free(kept)
        sensor.as_wrench(kept, np.eye(kept.shape[1]))


def fused_calls(seen: Seen) -> None:
    """One frame of a skin with a wrench, by the locator that the commands left."""
    from palpate.sensors.fused.locator import FusedLocator

    touch = (np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1), np.ones(1), np.eye(3)[None])
    seen.of(FusedLocator).fuse(*touch, np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]), np.eye(6)[None])
