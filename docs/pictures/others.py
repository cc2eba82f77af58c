"""Pictures of load cells, of a zero that wanders, of the marker ring, and of robots that touch in a physics engine."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import polars as pl
from drawing import DEEP, HERE, MM, MORE, SKIN, WARM, browser, figure, photographed, pixels, run, save
from PIL import Image

import palpate
from palpate.optical.markers import find_blobs, find_colour
from palpate.sensors.marker_ring.layer import annotated
from palpate.setup.load import robot_of
from palpate.setup.robot_view import robot_scene
from palpate.signals.drift import Drift
from palpate.viewer.film import ScenePicture
from palpate_lab.simulation.drift import simulate_drift

CELLS = [[-0.0065, -0.0105, -0.0035], [0.0065, -0.0105, -0.0035], [-0.0065, 0.0105, -0.0035], [0.0065, 0.0105, -0.0035]]
MARKERS = 24  # of the ring that is simulated
FILMED, PACE = (3.0, 15.5), 12.5  # s of the humanoid's session, pictures a second
LEAST, QUICK = 2.0, 8  # N, below which time runs so many times faster
SHOWN = (270, 76, 730, 440)  # px of a film's picture: the robot and its arrows
TIP = f"""[surface]
kind = "elliptic_cylinder"
a = 0.014
b = 0.005
half_length = 0.016
upper = true

[load_cells]
positions = {CELLS}
sensitivity = 10.0
noise = 1e-4
range = 0.5
"""
WANDER = """[surface]
kind = "ellipsoid"
axes = [0.03, 0.02, 0.015]

[force_torque]
noise = { force = 0.02, torque = 0.001 }

[drift]
walk = { force = 0.003, torque = 0.0001 }
warm_up = { force = 0.03, torque = 0.0009 }
settle = 200.0

[estimate]
tare = 1.0
"""


def design(folder: Path) -> None:
    """What a layout of force cells can resolve, before it is built: `palpate design load-cells`."""
    rig = folder / "design.toml"
    rig.write_text(TIP)
    run("design", "load-cells", rig, "-o", folder / "design.html")
    with browser(1100, 520) as page:
        page.goto((folder / "design.html").as_uri())
        page.wait_for_timeout(500)
        page.evaluate("document.querySelector('svg, img').scrollIntoView()")
        save(photographed(page), "design", MORE)


def fingertip(folder: Path) -> None:
    """A ball slides over a fingertip on four force cells: where it was found, beside where it was."""
    made = folder / "fingertip"
    if not made.exists():
        run("simulate", "load-cells", "-o", made)
        run(
            "calibrate", "load-cells", made / "bench_log.csv", "--rig", made / "rig.toml", "-o", made / "fingertip.toml"
        )
    contacts = palpate.estimate(made / "log.csv", made / "rig.toml")
    truth = pl.read_csv(made / "truth.csv").select("py", "px").to_numpy()
    drawn = figure(7.2, 4.2)
    axes = drawn.subplots()
    shown = contacts.answered & (np.linalg.norm(contacts.force, axis=1) > 1.0)
    axes.plot(*(MM * truth).T, ".", color=WARM, markersize=7, label="true")
    axes.plot(*(MM * contacts.point[shown, :2][:, ::-1]).T, ".", color=DEEP, markersize=2, label="found")
    axes.set(aspect="equal", xlabel="y, along the finger [mm]", ylabel="x [mm]")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes.set_title("eight slides of a ball over a fingertip on four force cells", fontsize=10)
    save(drawn, "fingertip")


def drift(folder: Path) -> None:
    """A zero that wanders, as it was and as it was followed: not while something touches."""
    rng, rate = np.random.default_rng(4), 100.0
    time = np.arange(0.0, 240.0, 1.0 / rate)
    law = Drift(np.repeat([3e-3, 1e-4], 3), np.repeat([5e-4, 1.5e-5], 3), 200.0, 0.0, np.zeros(6), np.zeros(6))
    zero = simulate_drift(time, law, rng)
    read = zero + np.repeat([0.02, 1e-3], 3) * rng.standard_normal(zero.shape)
    touched = (time % 80 > 40) & (time % 80 < 65)
    read[touched] += [0.0, 0.0, -3.0, 0.0, 0.0, 0.0]
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    pl.DataFrame({"time": time} | dict(zip(names, read.T, strict=True))).write_csv(folder / "wander.csv")
    (folder / "wander.toml").write_text(WANDER)
    rig = palpate.load_rig(folder / "wander.toml")
    with palpate.open_log(folder / "wander.csv", rig) as log:
        estimator = rig.estimator(log)
        for _ in estimator.stream(log):
            pass
    told = estimator.zero_history()
    drawn = figure(9.6, 3.6)
    axes = drawn.subplots()
    for begin in np.arange(40.0, 240.0, 80.0):
        axes.axvspan(begin, begin + 25.0, color=SKIN, alpha=0.6, linewidth=0, label="touched" if begin < 60 else None)
    followed, band = told.zero[:, 2] - told.zero[0, 2], 1.96 * told.deviation[:, 2]
    axes.fill_between(told.time, 1e3 * (followed - band), 1e3 * (followed + band), color=DEEP, alpha=0.25, linewidth=0)
    axes.plot(time, 1e3 * zero[:, 2], color=WARM, linewidth=1.0, label="true zero of fz")
    axes.plot(told.time, 1e3 * followed, color=DEEP, linewidth=1.2, label="followed, with its 95 % band")
    axes.set(xlabel="time [s]", ylabel="force [mN]", xlim=(0, time[-1]))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    save(drawn, "drift")


def marker_ring(folder: Path) -> None:
    """The barrel's camera at rest, and pressed hardest: the ways of the markers, as `palpate view` draws them."""
    made = folder / "ring"
    if not made.exists():
        run("simulate", "marker-ring", "-o", made, "--small")
    force = pl.read_csv(made / "truth.csv", null_values="nan")["force_n"].fill_null(0.0)
    frames = [_frame(made / "frames.avi", number) for number in (0, int(force.arg_max() or 0))]
    colour = find_colour(frames[0], MARKERS)
    rest, now = (find_blobs(each, colour).pixels for each in frames)
    nearest = now[np.linalg.norm(rest[:, None] - now[None], axis=-1).argmin(axis=1)]
    quiet = [cv2.fastNlMeansDenoisingColored(frame, None, 10, 10) for frame in frames]  # noise makes a large file
    both = np.hstack([quiet[0][:, 80:560, ::-1], annotated(quiet[1], rest, nearest)[:, 80:560]])
    for x, words in ((20, "at rest"), (500, f"pressed with {float(force.max() or 0.0):.1f} N")):
        cv2.putText(both, words, (x, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 1, cv2.LINE_AA)
    save(Image.fromarray(both), "marker_ring", 32)


def _frame(film: Path, number: int) -> np.ndarray:
    video = cv2.VideoCapture(str(film))
    video.set(cv2.CAP_PROP_POS_FRAMES, number)
    return video.read()[1]


def phantom(folder: Path) -> None:
    """A probe that an arm keeps on a phantom that breathes, at 7 N and at right angles to it, and the force on it."""
    words = ("--motion", "breathing", "--seconds", 5, "-o", folder / "phantom.mcap")
    scene = _film("phantom", folder / "phantom.mp4", *words)
    truth = pl.read_csv(folder / "phantom_truth.csv")
    drawn = figure(9.6, 2.0)
    axes = drawn.subplots()
    axes.axhline(7.0, color=WARM, linewidth=1.0, label="wanted")
    axes.plot(truth["time"], truth["press"], color=DEEP, label="true force")
    axes.set(xlabel="time [s]", ylabel="force [N]", xlim=(0, 5), ylim=(0, None))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="lower right")
    save(Image.fromarray(np.vstack([np.asarray(scene), np.asarray(pixels(drawn))])), "phantom", MORE)


def arena(folder: Path) -> None:
    """Four robots on their way, from the film of a run."""
    words = ("--seed", 3, "--seconds", 150, "-o", folder / "arena.mcap")
    save(_film("arena", folder / "arena.mp4", *words), "arena", MORE)


def robot(folder: Path) -> None:
    """Some seconds of a humanoid that is touched, as `palpate view --film` draws them; faster where nothing touches."""
    made = folder / "humanoid"
    if not made.exists():
        run("simulate", "humanoid", "-o", made, "--seed", 7)
    setup = robot_of(made / "robot.toml")
    assert setup is not None
    scene = robot_scene(setup, made / "run.mcap")[0]
    drawn, times = ScenePicture(scene), np.arange(*FILMED, 1 / PACE)
    shown = [scene.at(scene.timeline.at(at)).contacts for at in times.tolist()]
    forces = [[float(np.linalg.norm(each.force)) for each in contacts if each.located] for contacts in shown]
    kept = [at for k, at in enumerate(times.tolist()) if max(forces[k], default=0.0) > LEAST or k % QUICK == 0]
    first, *rest = (Image.fromarray(drawn.draw(at)[:, :, ::-1]).crop(SHOWN) for at in kept)
    first.save(HERE / "robot.webp", save_all=True, append_images=rest, duration=round(1e3 / PACE), loop=0, quality=75)


def _film(name: str, film: Path, *words: object) -> Image.Image:
    """The last picture of what `palpate simulate` films."""
    if not film.exists():
        run("simulate", name, *words, "--film", film)
    last = int(cv2.VideoCapture(str(film)).get(cv2.CAP_PROP_FRAME_COUNT)) - 1
    return Image.fromarray(_frame(film, last)[:, :, ::-1])
