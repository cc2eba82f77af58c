"""The table of sensors that every command and every law is tried on: a row here is tested without another line.

A row says how the sensor's files are made (forwards, from known touches), what is a right answer, and which fields of
the matrix physics refuses. The fourth sensors, `plate` and `ball`, are not Palpate's: they are added to its table.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from palpate.spatial.pose import Pose
from palpate_lab.simulation.ball_on_ellipse import FINGERTIP
from palpate_lab.simulation.contacts import contact_wrenches
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.load_cell_files import voltage_columns, write_bench_log
from palpate_lab.simulation.plate import Plate, write_plate_session
from palpate_lab.simulation.poke_bench import PokeBench, PokeErrors
from palpate_lab.simulation.poke_session_files import write_poke_session
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_files import write_session
from palpate_lab.simulation.skin_session import SkinSession, simulate_protocol
from palpate_lab.simulation.three_axis_skins import pillar_array
from palpate_lab.simulation.three_axis_touches import RATE, TIPS, UNSEEN_TIPS, Loads, three_axis_touches
from tests.support.simulated import Truth, base_poses, pressed, write_table
from tests.support.skin_session_files import write_skin_session

MOUNT = Pose.from_quaternion([0.0, 0.0, 0.6, 0.8], [0.010, -0.020, 0.060])  # of the surface in the sensor
POSE = f"pose = {{ xyz = {MOUNT.translation.tolist()}, quaternion_xyzw = [0.0, 0.0, 0.6, 0.8] }}\n"


@dataclass(frozen=True, kw_only=True)
class Files:
    """What a user of the sensor has on disk, and what is true.

    Attributes:
        log: to estimate: CSV, with poses of a base that moves; or a video. rig: for it.
        truth: of its touches. rest: [s] at its start in which nothing touches.
        mount: T_sensor_surface.
        models: what calibrations wrote. calibrations: the commands that do, each as words behind `calibrate`.
        mesh: what `rig new` takes beside the log, where the sensor has one.
        beside: a table of the times of a log that is none, such as a video.
    """

    log: Path
    rig: Path
    truth: Truth
    rest: float
    mount: Pose
    models: tuple[Path, ...] = ()
    calibrations: tuple[tuple[str, ...], ...] = ()
    mesh: Path | None = None
    beside: Path | None = None

    @property
    def table(self) -> Path:
        """Time and poses of each sample, as CSV: the log itself, where it is a table."""
        return self.beside or self.log

    @property
    def folder(self) -> Path:
        """Of all of them."""
        return self.log.parent


@dataclass(frozen=True)
class Sensor:
    """A row.

    Attributes:
        name: of the sensor.
        table: of the rig that says that it is this one.
        files: makes them in a folder; `run` is the command line.
        place: [m] by which the median of a touch may be off, and `force` the share by which its mean force may.
        refused: field of the matrix -> what a refusal must say (a pattern): the reason, which is physics.
        ignores: options of `estimate` that mean nothing to it, and must be refused.
        added: module of a sensor that is not Palpate's; its entry point is in `outside`.
    """

    name: str
    table: str
    files: Callable[[Path, Callable[..., str]], Files]
    place: float
    force: float
    refused: Mapping[str, str] = field(default_factory=dict)
    ignores: tuple[str, ...] = ()
    added: str | None = None


def _files(folder: Path, truth: Truth, calibrate: tuple[str, ...] | None = None, **more: Any) -> Files:
    """log.csv and rig.toml of a folder, and the model that a calibration wrote: its last word."""
    made = {} if calibrate is None else {"models": (Path(calibrate[-1]),), "calibrations": (calibrate,)}
    usual = {"log": folder / "log.csv", "rig": folder / "rig.toml", "rest": 0.8, "mount": MOUNT}
    return Files(**usual | {"truth": truth} | made | more)


def _six_axis(folder: Path, run: Callable[..., str]) -> Files:
    """The session's logs, with a position beside the orientation, and its rig as the probe was assembled."""
    session = simulate_session(3, touches=6, facets=1000)
    session = replace(session, nominal=session.true)
    write_session(session, folder)
    rig = folder / "rig.toml"
    rig.write_text(re.sub(r"(?s)\[filter\].*?(?=\[estimate\])", "", rig.read_text()))
    log, free = folder / "touches.csv", str(folder / "free_motion.csv")
    where = {name: pl.Series(base_poses(session.touches.time)[name]) for name in "xyz"}
    pl.read_csv(log).with_columns(**where).write_csv(folder / "log.csv")
    payload = ("payload", free, "--rig", str(rig), "--gravity", "0,0,-1", "-o", str(folder / "payload.toml"))
    marks, output = f"{folder}/marks.csv", f"{folder}/mounted.toml"
    mounted = ("mounting", str(log), "--rig", str(rig), "--marks", marks, "-o", output)
    run("calibrate", *payload)
    both, mesh = (payload, mounted), folder / "probe.stl"
    return _files(folder, _landed(session), payload, rest=0.3, mount=session.true, calibrations=both, mesh=mesh)


def _landed(session: Session) -> Truth:
    """The force is what was recorded less the load, both as simulated, in the surface's frame."""
    recording, truth = session.touches, session.truth
    force = (recording.wrenches() - session.load.wrenches(recording.channels["orientation"]))[:, :3]
    turned = force @ session.true.rotation
    held = [(recording.time >= a) & (recording.time < b) for a, b in zip(truth.start, truth.end, strict=True)]
    return Truth(truth.start, truth.end, truth.point, np.stack([turned[rows].mean(axis=0) for rows in held]))


TIP = f"""[surface]
kind = "elliptic_cylinder"
a = {FINGERTIP.a}
b = {FINGERTIP.b}
half_length = 0.016
upper = true
{POSE}
[estimate]
tare = 0.8

[load_cells]
"""


def _load_cells(folder: Path, run: Callable[..., str]) -> Files:
    """Voltages of a fingertip of the bench, which is pressed at six places."""
    bench, rng = BENCHES["rigid"], np.random.default_rng(5)
    write_bench_log(bench.run(0, thin=20), folder / "bench.csv")
    (folder / "plain.toml").write_text(TIP)
    (folder / "rig.toml").write_text(TIP + 'model = "tip.toml"\n')
    calibrate = ("load-cells", f"{folder}/bench.csv", "--rig", f"{folder}/plain.toml", "-o", f"{folder}/tip.toml")
    run("calibrate", *calibrate)
    x, y = rng.uniform(-9e-3, 9e-3, 6), rng.uniform(-12e-3, 12e-3, 6)
    time, wrenches, truth = pressed(*FINGERTIP.foot(x, y), rng)
    volts = bench.cells().voltages(wrenches) + rng.normal(0.0, 0.02, 12)  # a zero of its own
    volts += bench.channel_noise() * rng.standard_normal(volts.shape)
    columns = dict(zip(voltage_columns(4), volts.T, strict=True))
    write_table(folder / "log.csv", {"time": time} | columns | base_poses(time))
    return _files(folder, truth, calibrate)


def _plate_cells(folder: Path, run: Callable[..., str]) -> Files:
    """A plate that bends on four single-axis cells, calibrated by weights at known places, and pressed at six."""
    rng = np.random.default_rng(6)
    plate = Plate.drawn(rng)
    write_plate_session(plate, rng, folder)
    rig = (folder / "rig.toml").read_text().replace("[load_cells]", f"{POSE}\n[load_cells]")
    (folder / "rig.toml").write_text(rig)
    (folder / "plain.toml").write_text(rig.replace("model =", "# model ="))
    calibrate = ("load-cells", f"{folder}/bench_log.csv", "--rig", f"{folder}/plain.toml", "-o", f"{folder}/plate.toml")
    run("calibrate", *calibrate)
    points = np.column_stack([rng.uniform(-0.12, 0.12, (6, 2)), np.zeros(6)])
    time, wrenches, truth = pressed(points, np.tile([0.0, 0.0, 1.0], (6, 1)), rng, tan_theta=0.0)
    touched = np.abs(wrenches[:, 2]) > 0
    at = np.zeros((len(time), 3))
    at[touched, :2] = wrenches[touched][:, [4, 3]] * [-1.0, 1.0] / wrenches[touched, 2:3]
    volts = rng.normal(0.0, 0.02, 4) + plate.voltages(at, wrenches[:, :3], rng)
    columns = {f"u{cell + 1}": each for cell, each in enumerate(volts.T)}
    write_table(folder / "log.csv", {"time": time} | columns | base_poses(time))
    return _files(folder, truth, calibrate, mesh=folder / "plate.stl")


def _fused(folder: Path, run: Callable[..., str]) -> Files:
    """The skin's session, on a sensor that feels the same touches, each of which drags along the sheet too."""
    files, made = _session(folder, run)
    rng, frames, ramp = np.random.default_rng(8), pl.read_csv(files.log), 0.1
    across = np.cross(made.normal, rng.standard_normal(made.normal.shape))
    across *= 0.3 * np.linalg.norm(made.force, axis=1, keepdims=True) / np.linalg.norm(across, axis=1, keepdims=True)
    time = made.frames.time[:, None]
    share = np.clip(1.0 - np.maximum(made.start - time, time - made.end) / ramp, 0.0, 1.0)
    dragged = share @ contact_wrenches(made.point, made.normal, across, np.zeros(len(across)))
    sensed = (made.wrench + dragged) @ MOUNT.wrench_matrix().T
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    frames.with_columns(**{k: pl.Series(v) for k, v in zip(names, sensed.T, strict=True)}).write_csv(files.log)
    tables = "[force_torque]\nnoise = { force = 0.06, torque = 0.004 }\n\n[estimate]\ntare = 0.8\n\n[skin]\n"
    files.rig.write_text(files.rig.read_text().replace("[skin]\n", tables))
    return replace(files, truth=replace(files.truth, force=files.truth.force + across))


def _skin(folder: Path, run: Callable[..., str]) -> Files:
    """The bench's sheet round a link, touched four times, and a map that Palpate laid on that link."""
    return _session(folder, run)[0]


_INTENSITY: list[str] = []  # the skin's model: two sensors have the same, which takes seconds


def _session(folder: Path, run: Callable[..., str]) -> tuple[Files, SkinSession]:
    """What is written of it, and what was made."""
    import trimesh

    rng = np.random.default_rng(7)
    made = simulate_protocol(rng, touches=4, width=2.0)
    write_skin_session(made, folder, rng, presses=20)
    frames, sheet = pl.read_csv(folder / "skin_log.csv"), made.sheet
    cells = [name for name in frames.columns if name != "time"]
    frames.with_columns(**{k: pl.Series(v) for k, v in base_poses(made.frames.time).items()}).write_csv(
        folder / "log.csv"
    )
    link = trimesh.creation.cylinder(1e3 * sheet.radius, 100.0, sections=64)
    link.export(folder / "link.stl")
    surface = f'\n[surface]\nmesh = "link.stl"\nunit = "mm"\n{POSE}'
    (folder / "rig.toml").write_text((folder / "rig.toml").read_text() + f"cells = {cells}\n{surface}")
    calibrate = ("intensity", f"{folder}/load_cell_log.csv", "--bits", "8", "-o", f"{folder}/intensity.toml")
    if not _INTENSITY:
        run("calibrate", *calibrate)
        _INTENSITY.append((folder / "intensity.toml").read_text())
    (folder / "intensity.toml").write_text(_INTENSITY[0])
    corner = ("--origin", f"{1e3 * sheet.radius},0,-30", "--heading", "0,1,0")
    laid = ("--unit", "mm", "--sheet", "6x22", "--cell", "10", *corner)
    run("map", "skin", f"{folder}/link.stl", *laid, "-o", f"{folder}/laid.toml")
    models = (folder / "intensity.toml", folder / "laid.toml")
    return _files(folder, Truth(made.start, made.end, made.point, made.force), calibrate, models=models), made


POKES = """[surface]
mesh = "forearm.stl"
unit = "m"

[force_torque]

[skin]
count = 24

[pokes]
layout = "ring12"
start = "cad.txt"

[pokes.priors] # what an exact arm and sensor err by
bias_force = 0.0
bias_torque = 0.0
frame = 0.0
frame_angle = 0.0
common = 0.0
common_angle = 0.0
cross_talk = 0.0
"""


def _poked(folder: Path, run: Callable[..., str]) -> Files:
    """Two modules on a forearm: poked, calibrated, then pressed over four of their taxels, which read newtons."""
    rng, skin = np.random.default_rng(17), Forearm.of(2)
    exact = PokeErrors(0.02, 0.002, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    session = PokeBench.drawn(rng, skin=skin, errors=exact).session(rng, 60)
    write_poke_session(session, skin.cone, skin.cad(rng), folder, rng, touches=1)
    (folder / "poke_rig.toml").write_text(POKES)
    calibrate = ("taxels", f"{folder}/pokes.csv", "--rig", f"{folder}/poke_rig.toml", "-o", f"{folder}/skin.toml")
    run("calibrate", *calibrate)
    places, where = skin.places, [1, 8, 14, 21]
    time, wrenches, truth = pressed(places.positions[where], places.normals[where], rng, tan_theta=0.0)
    away = np.linalg.norm(places.positions - places.positions[where][:, None], axis=2)
    share = np.exp(-(away**2) / (2 * 4e-3**2))  # m: neighbours are 6 mm apart
    share /= share.sum(axis=1, keepdims=True)
    pushed = np.linalg.norm(wrenches[:, :3], axis=1)[:, None] * share[_nearest(wrenches[:, :3], -places.normals[where])]
    names = [f"t{k}" for k in range(len(places))]
    loads = pushed + 0.003 * rng.standard_normal(pushed.shape)
    write_table(folder / "log.csv", {"time": time} | dict(zip(names, loads.T, strict=True)) | base_poses(time))
    surface = f'[surface]\nmesh = "forearm.stl"\nunit = "m"\n{POSE}'
    (folder / "rig.toml").write_text(
        f'{surface}\n[skin]\ntaxels = "skin.toml"\nbits = 0\ncells = {names}\ntare = 0.8\n'
    )
    felt = -np.linalg.norm(truth.force, axis=1)[:, None] * (share @ places.normals)  # each along its own normal
    return _files(folder, replace(truth, force=felt), calibrate)


def _three_axes(folder: Path, run: Callable[..., str]) -> Files:
    """Pillars that feel shear, calibrated by known forces, then pressed at five places by other tips."""
    skin, names = pillar_array(4, 4, 5), [f"{k + 1}_{axis}" for k in range(16) for axis in "xyz"]
    write_table(folder / "places.csv", dict(zip(("x", "y", "z"), skin.positions.T, strict=True)))
    made = dict[str, Loads]()
    for name, touches, tips in (("presses", 60, TIPS), ("log", 5, UNSEEN_TIPS)):
        loads = three_axis_touches(skin.positions, np.random.default_rng(touches), touches, tips=tips)
        readings, made[name] = skin.readings(loads, touches)
        time = np.arange(len(readings)) / RATE
        numbers = dict(zip(names, readings.reshape(len(time), -1).T, strict=True))
        write_table(folder / f"{name}.csv", {"time": time} | numbers | base_poses(time))
    known, pressed = made["presses"], made["log"]
    columns = np.column_stack([known.frame / RATE, known.place, known.force]).T
    write_table(folder / "truth.csv", dict(zip(("time", "px", "py", "pz", "fx", "fy", "fz"), columns, strict=True)))
    plain = (
        f'[surface]\nkind = "plane"\nhalf_width = 0.02\n{POSE}\n[skin]\ntaxels = "places.csv"\nbits = 0\n'
        'axes = ["x", "y", "z"]\ntare = 0.8\n'
    )
    (folder / "plain.toml").write_text(plain)
    (folder / "rig.toml").write_text(f'{plain}response = "response.toml"\n')
    truth = ("--truth", f"{folder}/truth.csv", "--rig", f"{folder}/plain.toml")
    calibrate = ("response", f"{folder}/presses.csv", *truth, "-o", f"{folder}/response.toml")
    run("calibrate", *calibrate)
    full = [pressed.full & (pressed.touch == touch) for touch in range(5)]
    start, end = (np.array([pick(pressed.frame[each]) for each in full]) / RATE for pick in (np.min, np.max))
    point, force = (np.array([values[each].mean(axis=0) for each in full]) for values in (pressed.place, pressed.force))
    return _files(folder, Truth(start, end, point, force), calibrate)


def _marker_ring(folder: Path, run: Callable[..., str]) -> Files:
    """A video of the coarse simulated barrel, which tips press in turn, and its calibration from another video."""
    from palpate_lab.simulation.barrel import Barrel, Indenter
    from palpate_lab.simulation.ring_session import Protocol, RingUnit, calibration_run
    from palpate_lab.simulation.ring_session_files import write_calibration_run

    unit = RingUnit.drawn(3, coarse=True)
    session = calibration_run(unit, Protocol(12, (0.003, 0.006, 0.009), hold=1, pause=1))
    write_calibration_run(session, folder / "run")
    calibrate = ("marker-ring", f"{folder}/run", "--rig", f"{folder}/run/rig.toml", "-o", f"{folder}/ring.toml")
    run("calibrate", *calibrate)
    barrel = Barrel.built(unit.barrel)
    start, point, force = 1.31 + 0.8 * np.arange(3), list[np.ndarray](), list[np.ndarray]()
    frames = [(k / 30.0, barrel.rest[:, 1:]) for k in range(36)]
    for angle in (0.4, 2.5, 4.6):
        states = barrel.follow([Indenter("tip", angle, 0.006)], [(share, 0.0) for share in (0.25, 0.5, 0.75, 1.0)])
        outward = np.array([np.cos(states[-1].angle[0]), np.sin(states[-1].angle[0]), 0.0])
        along = np.array([-outward[1], outward[0], 0.0])
        point.append(0.055 * outward)
        force.append(-states[-1].force[0] * outward + states[-1].shear[0] * along)
        shares = [*states[:3], *([states[3]] * 13), *states[2::-1]]
        shown = [*(each.discs for each in shares), *([barrel.rest[:, 1:]] * 5)]
        frames += [((len(frames) + k) / 30.0, discs) for k, discs in enumerate(shown)]
    _film(folder / "touches.avi", unit, frames)
    (folder / "rig.toml").write_text(
        f'{(folder / "run/rig.toml").read_text()}model = "ring.toml"\n'.replace("camera.toml", "run/camera.toml")
    )
    write_table(folder / "beside.csv", {"time": np.array([time for time, _ in frames])})
    models, log = (folder / "ring.toml", folder / "run/camera.toml"), folder / "touches.avi"
    truth, beside = Truth(start, start + 0.39, np.array(point), np.array(force)), folder / "beside.csv"
    return _files(folder, truth, calibrate, models=models, log=log, beside=beside, mount=Pose.identity())


def _film(path: Path, unit: Any, frames: list[tuple[float, np.ndarray]]) -> None:
    import cv2

    from palpate_lab.simulation.ring_camera import RenderedCamera

    camera = RenderedCamera(unit.camera, unit.look, np.random.default_rng(17))
    film = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (640, 480))
    for time, discs in frames:
        film.write(camera.frame([discs], time))
    film.release()


def _plate(folder: Path, run: Callable[..., str]) -> Files:
    """Three cells under a slippery plate: each carries its share of what presses, by the levers."""
    from tests.conformance import plate  # here: the table before this one has no place for it

    rng = np.random.default_rng(11)
    points = np.column_stack([rng.uniform(-0.02, 0.02, (5, 2)), np.zeros(5)])
    time, wrenches, truth = pressed(points, np.tile([0.0, 0.0, 1.0], (5, 1)), rng, tan_theta=0.0)
    levers = np.stack([np.ones(3), plate.CELLS[:, 1], -plate.CELLS[:, 0]])  # F_z, M_x, M_y of three forces along z
    loads = (wrenches @ MOUNT.wrench_matrix().T)[:, 2:5] @ np.linalg.inv(levers).T + 0.3  # N: of a zero
    loads += plate.NOISE * rng.standard_normal(loads.shape)
    write_table(folder / "log.csv", {"time": time} | dict(zip(plate.COLUMNS, loads.T, strict=True)) | base_poses(time))
    surface = f'[surface]\nkind = "plane"\nhalf_width = 0.03\n{POSE}'
    (folder / "rig.toml").write_text(f"{surface}\n[estimate]\ntare = 0.8\n\n[plate]\n")
    return _files(folder, truth)


def _ball(folder: Path, run: Callable[..., str]) -> Files:
    """Taxels anywhere on a sphere: a press is a Gaussian over its neighbours, each taxel feels along its normal."""
    from tests.conformance import ball  # here: as above

    rng = np.random.default_rng(13)
    normals = ball.directions()
    aim = np.array([[1.0, 0, 0], [0, 1.0, 0.3], [-0.5, -0.5, 0.7], [0.2, -0.9, -0.4]])
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    time, wrenches, truth = pressed(ball.RADIUS * aim, aim, rng, tan_theta=0.0)
    share = np.exp(-np.sum((normals[None] - aim[:, None]) ** 2, axis=2) / (2 * 0.2**2))
    share /= share.sum(axis=1, keepdims=True)
    size = np.linalg.norm(truth.force, axis=1)
    pushed = np.linalg.norm(wrenches[:, :3], axis=1)[:, None] * share[_nearest(wrenches[:, :3], -aim)]
    loads = pushed + ball.NOISE * rng.standard_normal(pushed.shape)
    write_table(folder / "log.csv", {"time": time} | dict(zip(ball.COLUMNS, loads.T, strict=True)) | base_poses(time))
    (folder / "rig.toml").write_text(
        f'[surface]\nkind = "sphere"\nradius = {ball.RADIUS}\n{POSE}\n[ball]\ntare = 0.8\nmodel = "gain.toml"\n'
    )
    known = {"force": pushed.sum(axis=1)}
    write_table(folder / "presses.csv", dict(zip(ball.COLUMNS, loads.T, strict=True)) | known)
    calibrate = ("ball", f"{folder}/presses.csv", "-o", f"{folder}/gain.toml")
    run("calibrate", *calibrate)
    felt = -size[:, None] * (share @ normals)  # of the taxels, each along its own normal
    centre = ball.RADIUS * (share @ normals) / np.linalg.norm(share @ normals, axis=1, keepdims=True)
    return _files(folder, replace(truth, point=centre, force=felt), calibrate)


def _nearest(forces: np.ndarray, directions: np.ndarray) -> np.ndarray:
    return np.argmax(forces @ directions.T, axis=1)


CELLS = ("--payload", "--noise", "--unit", "--cutoff", "--crease")
TAXELS = ("--payload", "--noise", "--unit", "--cutoff", "--method", "--friction", "--torsion", "--contact")
NEWTONS = {"inspect model": "newtons", "calibrate": "newtons"}  # what reads in newtons has nothing to calibrate
RING = (*TAXELS, "--crease")
FUSED = ("--cutoff", "--method", "--torsion", "--contact")
UNFILTERED = {
    "--filter butterworth": "not filtered",
    "--filter zero_phase": "not filtered",
    "--frame base": "base frame needs",  # nothing says where a camera was while it filmed
}
SENSORS = (
    Sensor("six-axis", "force_torque", _six_axis, 1.0e-3, 0.03, ignores=("--unit", "--cutoff")),
    Sensor("load cells", "load_cells", _load_cells, 0.2e-3, 0.05, ignores=CELLS),
    Sensor("plate on load cells", "load_cells", _plate_cells, 1.0e-3, 0.02, ignores=CELLS[:-1]),
    Sensor("skin", "skin", _skin, 1.5e-3, 0.1, ignores=TAXELS),
    Sensor("skin and wrench", "fusion", _fused, 1.5e-3, 0.1, ignores=FUSED),
    Sensor("poked taxels", "skin", _poked, 1.0e-3, 0.03, ignores=TAXELS),
    Sensor("three-axis skin", "skin", _three_axes, 1.0e-3, 0.1, ignores=TAXELS),
    Sensor("marker ring", "marker_ring", _marker_ring, 1.0e-3, 0.2, UNFILTERED, RING),
    Sensor("plate", "plate", _plate, 0.2e-3, 0.02, NEWTONS, CELLS, "tests.conformance.plate"),
    Sensor("ball", "ball", _ball, 1.5e-3, 0.05, {}, TAXELS, "tests.conformance.ball"),
)
