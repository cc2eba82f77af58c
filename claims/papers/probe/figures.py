"""The paper's figures 6 to 9, ours."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import palpate
from claims.papers.probe import assumed
from claims.papers.probe.methods import METHODS
from claims.papers.probe.run import FORCES, MARK_3, Results
from claims.papers.probe.shapes import PROBES
from claims.papers.probe.study import ANGLES, Meshes
from palpate_lab.simulation import contact_wrenches

DOTS = 80
COLOURS = dict(zip(ANGLES, ("tab:blue", "tab:orange", "tab:green"), strict=True))


def draw(results: Results, folder: Path) -> None:
    with mpl.rc_context({"font.size": 8, "savefig.dpi": DOTS, "figure.constrained_layout.use": True}):
        for number, figure in (("6", _six), ("7", _seven), ("8", _eight), ("9", _nine)):
            made = figure(results)
            made.savefig(folder / f"figure_{number}.png", metadata={"Software": None})
            plt.close(made)


def _six(results: Results) -> plt.Figure:
    figure, axes = plt.subplots(figsize=(5, 3))
    for angle, means in results.force_error.items():
        axes.plot((5, 10, 15, 20), 1e3 * means, "o-", label=angle, color=COLOURS[angle])
    title = "6: force against the reference sensor"
    axes.set(xlabel="force [N]", ylabel="mean force error [mN]", ylim=(0, None), title=title)
    axes.legend()
    return figure


def _seven(results: Results) -> plt.Figure:
    figure, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(10, 6.5))
    for shift, (angle, found) in enumerate(results.causes["all errors"].items()):
        mean, spread = found.mark.mean(axis=(0, 2)), found.mark.std(axis=(0, 2))
        places = np.arange(1, len(mean) + 1) + 0.25 * (shift - 1)
        a.bar(places, 1e3 * mean, 0.25, yerr=1e3 * spread, label=angle, color=COLOURS[angle], error_kw={"lw": 0.6})
    a.set(xlabel="marker", ylabel="error to the mark [mm]", title="7a: all errors, 8-10 N")
    a.legend()
    for method in METHODS:
        b.semilogy(np.arange(1, 18), np.median(results.methods[method].times, axis=0), "o-", ms=3, label=method)
    b.axhline(570, color="k", ls=":", lw=0.8)
    b.text(1, 600, "theirs, mean")
    b.set(xlabel="marker", ylabel="time of one call [us], median", title="7b")
    b.legend()
    _by_force(c, results)
    _scatter(d, results)
    return figure


def _by_force(axes: Axes, results: Results) -> None:
    for kind, style in (("single readings", ":"), ("filtered", "-")):
        for number, angle in enumerate(ANGLES):
            found = [results.forces[kind][force][number].mark for force in FORCES]
            mean, worst = ([1e3 * float(f(m)) for m in found] for f in (np.mean, _worst))
            axes.plot(FORCES, mean, style, color=COLOURS[angle], label=f"{angle}, {kind}")
            axes.plot(FORCES, worst, style, color=COLOURS[angle], lw=0.5)
    axes.set(xlabel="force [N]", ylabel="error to mark 3 [mm]", ylim=(0, 10), title="7c: mean, and (thin) worst of 50")
    axes.legend(fontsize=6)


def _worst(errors: np.ndarray) -> float:
    return float(np.median(errors.max(axis=(1, 2))))


def _scatter(axes: Axes, results: Results) -> None:
    """One build's perpendicular readings on mark 3, in the tangent plane."""
    some, dice = results.cases["T-shaped", "perpendicular"], np.random.default_rng(3)
    locator = palpate.Locator(PROBES["T-shaped"].mesh(0.5e-3))
    for force, colour in zip((1.0, 5.0, 10.0, 20.0), ("tab:red", "tab:orange", "tab:green", "tab:blue"), strict=True):
        wrench, _ = some.presses[MARK_3].at(np.array([force]))
        noisy = wrench + dice.standard_normal((200, 6)) * assumed.NOISE
        off = (locator.run(noisy, sequential=False).point - some.marks[MARK_3]) @ some.tangents[MARK_3].T
        axes.plot(*(1e3 * off.T), ".", ms=3, color=colour, label=f"{force:g} N")
    axes.set(xlabel="[mm]", ylabel="[mm]", title="7d: 200 single readings, noise alone", aspect="equal")
    axes.legend()


def _sliding() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A contact of 2 N that wanders over the T's face under noise: times [s], true and located points (n, 3) [m]."""
    probe, time = PROBES["T-shaped"], np.arange(0.0, 20.0, 1 / assumed.RATE)
    x, y = 10e-3 * np.sin(2 * np.pi * 0.2 * time), 3e-3 * np.sin(2 * np.pi * 0.33 * time)
    start = np.column_stack([x, y, np.full(len(time), assumed.LEVER)])
    points = probe.land(start, np.array([0.0, 0.0, 1.0]))
    normals = probe.normals(points)
    wrenches = contact_wrenches(points, normals, -2.0 * normals, np.zeros(len(time)))
    noisy = wrenches + np.random.default_rng(8).standard_normal(wrenches.shape) * assumed.NOISE
    return time, points, Meshes(probe).locator("fine").run(noisy, sequential=False).point


def _eight(_results: Results) -> plt.Figure:
    from scipy.signal import butter, sosfiltfilt

    time, truth, found = _sliding()
    smooth = sosfiltfilt(butter(2, 10.0, fs=assumed.RATE, output="sos"), found, axis=0)
    figure, (a, b) = plt.subplots(1, 2, figsize=(10, 3))
    frequency = np.fft.rfftfreq(len(time), 1 / assumed.RATE)
    amplitude = 2e3 * np.abs(np.fft.rfft(found[:, :2] - found[:, :2].mean(axis=0), axis=0)) / len(time)
    a.semilogy(frequency[1:], amplitude[1:], lw=0.5, label=["x", "y"])
    a.axvline(10, color="k", ls=":")
    a.set(xlabel="frequency [Hz]", ylabel="amplitude [mm]", title="8a: contact that wanders at 0.2 and 0.33 Hz, 2 N")
    a.legend()
    part = time < 5
    b.plot(time[part], 1e3 * found[part, 1], lw=0.4, label="single readings")
    b.plot(time[part], 1e3 * smooth[part, 1], label="low-pass 10 Hz")
    b.plot(time[part], 1e3 * truth[part, 1], "k--", lw=0.8, label="truth")
    b.set(xlabel="time [s]", ylabel="y [mm]", title="8b")
    b.legend()
    return figure


def _nine(results: Results) -> plt.Figure:
    figure = plt.figure(figsize=(10, 3))
    axes = figure.add_subplot(1, 4, 1)
    theirs = {"T-shaped": (0.94, 0.49), "linear": (1.28, 0.44), "convex": (0.91, 0.24)}
    for place, (name, found) in enumerate(results.probes.items()):
        ours = 1e3 * found.mark.mean(), 1e3 * found.mark.std()
        for shift, (mean, spread), colour in ((-0.2, theirs[name], "0.7"), (0.2, ours, "tab:blue")):
            axes.bar(place + shift, mean, 0.4, yerr=spread, color=colour)
    axes.set_xticks(range(len(theirs)), list(theirs))
    axes.set(ylabel="error to the mark [mm]", title="9a: theirs grey, ours blue")
    for place, (name, probe) in enumerate(PROBES.items(), start=2):
        view = figure.add_subplot(1, 4, place, projection="3d")
        mesh = probe.mesh(4e-3)
        view.plot_trisurf(
            *(1e3 * mesh.vertices.T), triangles=mesh.faces, color="0.85", lw=0.1, edgecolor="0.6", alpha=0.6
        )
        marks, normals = probe.marked()
        view.scatter(*(1e3 * (marks + 1e-3 * normals).T), color="tab:red", s=4)
        view.set_box_aspect(np.ptp(mesh.vertices, axis=0))
        view.set(title=name, xticks=[], yticks=[], zticks=[])
        view.view_init(35, -60)
    return figure
