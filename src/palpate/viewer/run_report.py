"""Compose the report of a run of any sensor: the contacts found, as figures, tables and words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from platform import python_version

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95, Status
from palpate.contact.events import Events, largest_deviation
from palpate.contact.plausibility import UNLOADED
from palpate.spatial.arguments import frozen_value
from palpate.spatial.shown import rounded
from palpate.viewer import plots
from palpate.viewer.captions import MEANING, feature, is_shown
from palpate.viewer.drawing import Drawing, Mark, Specks
from palpate.viewer.heat import colours
from palpate.viewer.notebook import marks_of
from palpate.viewer.report import Picture, Report, ReportTable, Section, Tile, percent, picture
from palpate.viewer.run_summary import RunSummary
from palpate.viewer.samples import median, sample_starts, strongest, thinned
from palpate.viewer.scene import before
from palpate.viewer.timeline import since

SHOWN = 200  # touches in the table
NUMBERED = 60  # on the body
UNCERTAIN = ""  # in place of a format: with the digits of the touch's deviation
SPECKS = 600  # samples on the body that is turned
Body = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]  # vertices [m], facets


@frozen_value
class Run:
    """All information about a finished run for its report.

    Attributes:
        log, output: names, as a reader knows them.
        method: how it was done, as it goes on after "samples were read from LOG, ".
        summary: summary of the contacts, in the surface's frame.
        body: vertices [m] and faces, to draw contacts on; None: not known.
        settings: names and values of the settings in force.
        uncertainties: sources of uncertainty that the 95 % ellipses contain.
        provenance: inputs with their hashes, options.
        stages: seconds of each stage by name: reading, locating, writing.
        notes, warnings: messages printed for the user.
        advice: what to improve, a sentence each.
        tiles, sections: those that the sensor and a ground truth add.
    """

    log: str
    output: str
    method: str
    summary: RunSummary
    body: Body | None = None
    settings: tuple[tuple[str, str], ...] = ()
    uncertainties: tuple[str, ...] = ("the sensor's noise",)
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    stages: Mapping[str, float] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    tiles: tuple[Tile, ...] = ()
    sections: tuple[Section, ...] = ()

    @cached_property
    def kept(self) -> DownsampledRun:
        """The `DownsampledRun` of the summary."""
        return DownsampledRun(self.summary.contacts, self.summary.even)


def compose(run: Run) -> Report:
    """Return the `Report` of a run, with its figures drawn.

    Raises:
        InputError: matplotlib is not installed.
    """
    touches = run.summary.finder.touches()
    sections = (
        _over_time(run.kept),
        _places(run),
        _statuses(run),
        _touches(touches),
        *run.sections,
        Section("What to improve", points=run.advice),
        Section("Settings in force", settings=run.settings),
        inputs(run.provenance),
        _time_budget(run.stages, run.summary.samples),
        Section("Notes of the run", points=run.notes),
    )
    return Report(
        title=f"Contacts in {run.log}",
        summary=f"{run.summary.samples:,} samples were read from {run.log}, {run.method}; contacts went to "
        f"{run.output}.",
        tiles=(*_tiles(run, len(touches)), *run.tiles),
        warnings=run.warnings,
        sections=tuple(section for section in sections if section),
        footer=f"palpate {run.provenance.get('palpate', '')}. Lengths, forces and times in the units next to "
        "them; points and forces in the surface's frame.",
    )


@frozen_value
class DownsampledRun:
    """Downsampled contacts, n rows of m samples, and quantities derived from them; `even`: see `RunSummary.even`."""

    contacts: Contacts
    even: Bool[np.ndarray, " n"]

    @cached_property
    def starts(self) -> Int[np.ndarray, " m"]:
        """Number of the first row of each sample, (m,)."""
        return sample_starts(self.contacts)

    @cached_property
    def strength(self) -> Float[np.ndarray, " n"]:
        """Magnitudes of the forces, (n,) [N]."""
        return np.linalg.norm(self.contacts.force, axis=1)

    @cached_property
    def point(self) -> Float[np.ndarray, "n 3"]:
        """Contact points, (n, 3) [m]; NaN where not answered."""
        return np.where(self.contacts.answered[:, None], self.contacts.point, np.nan)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "n 3 3"]:
        """Covariances of the points, (n, 3, 3) [m^2]; NaN where not answered."""
        return np.where(self.contacts.answered[:, None, None], self.contacts.covariance, np.nan)

    @cached_property
    def radius(self) -> Float[np.ndarray, " n"]:
        """Long half-axes of the 95 % ellipses, (n,) [m]; NaN where not answered."""
        return np.sqrt(CHI2_95) * largest_deviation(self.covariance)

    @property
    def median_radius(self) -> float:
        """Median [m] of the radii of the even rows; NaN where there is none."""
        return median(self.radius[self.even])


def coverage_tone(inside: float) -> str:
    """Return "good", "poor" or "" for the share of truths in their 95 % ellipses; far too many are "poor" too."""
    off = abs(inside - 0.95)
    return "good" if off <= 0.03 else "poor" if off > 0.1 or inside > 0.995 else ""


def _tiles(run: Run, touches: int) -> list[Tile]:
    kept, summary, counts = run.kept, run.summary, run.summary.statuses
    answered, total = int(counts[: Status.AMBIGUOUS + 1].sum()), max(summary.rows, 1)
    loaded = total - int(counts[list(UNLOADED)].sum())
    share = answered / loaded if loaded else float("nan")
    tone = "good" if share >= 0.95 else "poor" if share < 0.7 else ""
    time = kept.contacts.time
    known = time[np.isfinite(time)]
    span = float(np.ptp(known)) if len(known) else 0.0
    rows = "samples" if total <= summary.samples else "rows"
    tiles = [
        Tile("samples", f"{summary.samples:,}", f"{span:.4g} s at {summary.rate:.4g} Hz"),
        Tile("answered", percent(share) if loaded else "-", f"of {loaded:,} loaded {rows}", tone),
    ]
    if np.isfinite(kept.strength).any():
        peak = int(np.nanargmax(kept.strength))
        tiles.append(Tile("peak force", f"{kept.strength[peak]:.3g} N", f"at {time[peak] - since(time)[0]:.2f} s"))
    if rows == "rows":
        tiles.append(Tile("contacts at once", f"{summary.most}", "at most"))
    tiles.append(Tile("touches", f"{touches:,}", "found in the contacts"))
    if np.isfinite(radius := kept.median_radius):
        tiles.append(Tile("95 % radius", f"{1e3 * radius:.2g} mm", "median of the answered"))
    return tiles


def force_picture(kept: DownsampledRun, caption: str) -> Picture:
    """Return the `Picture` of force and status over time, of each sample's strongest contact.

    Raises:
        InputError: matplotlib is not installed.
    """
    found = kept.contacts[strongest(kept.contacts, kept.starts)]
    return picture(plots.forces(found.time, found.force, found.status), caption)


def body_picture(body: Body, kept: DownsampledRun, touches: Events, caption: str) -> Picture:
    """Return the `Picture` of the body from three sides, with contacts and the numbers of the first 60 touches.

    Raises:
        InputError: matplotlib is not installed.
    """
    drawn = plots.silhouettes(*body, kept.point, kept.contacts.normal, kept.strength, _numbered(touches))
    return picture(drawn, caption)


def _numbered(touches: Events) -> list[Mark]:
    return marks_of(touches, NUMBERED, since(touches.start)[0])


def _over_time(kept: DownsampledRun) -> Section:
    found, several = kept.contacts, len(kept.starts) < len(kept.contacts)
    colours = "green: located, blue: ambiguous, light grey: no contact, dark grey: too light, others: see Statuses"
    whose = "Force of the strongest contact" if several else "Force on the body, without payload and bias"
    shown = [force_picture(kept, f"{whose}. Below, {colours}.")]
    if np.isfinite(kept.point).any():
        deviation = np.sqrt(np.diagonal(kept.covariance, axis1=1, axis2=2).clip(min=0))
        places = plots.locations(found.time, kept.point, deviation, several=several)
        points = "The points of all contacts" if several else "The contact point"
        shown.append(picture(places, f"{points} in the surface's frame, with 95 % bands."))
    return Section("Force and point over time", pictures=tuple(shown))


def _places(run: Run) -> Section:
    kept = run.kept
    if not np.isfinite(kept.point).any():
        return Section("Where it was touched", text=("No sample was located.",))
    touches, shown = run.summary.finder.touches(), list[Picture]()
    if run.body is not None:
        words = (
            "The body from three sides. Dots are on the near side, rings on the far one; numbers are those of Touches, "
            "and say more when a pointer rests on them."
        )
        shown.append(body_picture(run.body, kept, touches, words))
    if np.isfinite(kept.radius).any():
        sizes = plots.histogram(1e3 * kept.radius[kept.even], "long half axis of the 95 % ellipse", "mm")
        held = ", ".join(run.uncertainties)
        words = f"How certain the points are. The ellipses hold {held}; errors of the mesh are not in them."
        shown.append(picture(sizes, words))
    return Section("Where it was touched", pictures=tuple(shown), drawing=_in_space(run, touches))


def _in_space(run: Run, touches: Events) -> str:
    """Return the body with its touches as a `Drawing`; "" if it is not known."""
    if run.body is None:
        return ""
    kept, marks = run.kept, _numbered(touches)
    some = thinned(np.flatnonzero(np.isfinite(kept.point[:, 0])), SPECKS)
    share = kept.strength[some] / max(float(np.nanmax(kept.strength[some], initial=0.0)), 1e-12)
    specks = Specks(kept.point[some], kept.contacts.normal[some], colours(0.15 + 0.85 * np.nan_to_num(share)))
    look = marks[int(np.argmax(touches.peak_force[: len(marks)]))].normal if marks else None
    drawn = Drawing(*run.body, marks, specks, title=f"where {run.log} was touched, to be turned by dragging")
    return (drawn if look is None else replace(drawn, look=before(look))).html()


def _statuses(run: Run) -> Section:
    counts = run.summary.statuses
    rows = "samples" if run.summary.rows <= run.summary.samples else "rows (a sample has one for each contact)"
    facts = tuple((kind.words, f"{counts[kind]:,} {rows}. {MEANING[kind]}") for kind in Status if counts[kind])
    shares = picture(plots.statuses(counts), "Statuses of the samples; contact and ambiguous count as answered.")
    return Section("Statuses", pictures=(shares,), settings=facts)


def _touches(found: Events) -> Section:
    if not len(found):
        return Section("Touches")
    text = "sd is one standard deviation of a sample in the direction in which it is largest."
    return Section("Touches", text=(text,), tables=(touch_table(found, SHOWN, spelled=True),))


def touch_table(found: Events, most: int, *, spelled: bool = False) -> ReportTable:
    """Return a `ReportTable` of the first `most` touches: time, force, place, and the sensor's features.

    If `spelled`, features have names in words, not those in files, and standard deviations are omitted.
    """
    (x, y, z), (start, after) = 1e3 * found.point.T, since(found.start)
    columns = {
        "touch": ("{:.0f}", np.arange(1, len(found) + 1)),
        "contact": ("{:.0f}", found.identity),
        "start [s]": ("{:.3f}", found.start - start),
        "end [s]": ("{:.3f}", found.end - start),
        "lasts [s]": ("{:.3f}", found.end - found.start),
        "peak [N]": ("{:.2f}", found.peak_force),
        "x [mm]": (UNCERTAIN, x),
        "y [mm]": (UNCERTAIN, y),
        "z [mm]": (UNCERTAIN, z),
        "sd [mm]": (UNCERTAIN, 1e3 * found.deviation),
        "slid [mm]": (UNCERTAIN, 1e3 * found.slid),
        "ambiguous [%]": ("{:.1f}", 100 * found.ambiguous),
    }
    if not found.identity.any() or found.origins is not None:  # one contact at a time, or a sensor's name says more
        del columns["contact"]
    names = {} if found.origins is None else {"sensor": found.sensor.tolist(), "link": found.link.tolist()}
    if found.origins is not None:  # whose links move, and whose sensors add features of their own
        del columns["slid [mm]"]
    for name, values in found.features.items() if found.origins is None else ():
        words, scale, unit = feature(name, found.features)
        if is_shown(name, found.features) or not spelled:
            words = words if spelled else name
            columns[f"{words} [{unit}]" if unit else words] = ("{:.3g}", scale * values)

    def cell(text: str, values: np.ndarray, k: int) -> str:
        if not np.isfinite(values[k]):
            return "-"
        deviation = 1e3 * float(found.deviation[k])  # [mm], which says how many digits mean something
        return rounded(float(values[k]), deviation) if text == UNCERTAIN else text.format(values[k])

    rows = [
        (*(of[k] for of in names.values()), *(cell(*column, k) for column in columns.values()))
        for k in range(min(len(found), most))
    ]
    more = [f"The first {most} of {len(found):,}."] if len(found) > most else []
    more += [f"Start and end are seconds {after}."] if after else []
    return ReportTable((*names, *columns), tuple(rows), " ".join(more))


def inputs(provenance: Mapping[str, str]) -> Section:
    """Return the `Section` of the inputs with their hashes, the options, and the versions."""
    used = ", ".join(f"{name} {release}" for name, release in (("numpy", np.__version__), ("Python", python_version())))
    files = {name: said for name, said in provenance.items() if name != "palpate"}
    facts = [(name.replace("_", " "), said.replace(" sha256:", ", SHA-256 ")) for name, said in files.items()]
    versions = ("versions", f"palpate {provenance.get('palpate', 'unknown')}, {used}")
    return Section("Inputs", settings=(versions, *facts))


def _time_budget(stages: Mapping[str, float], samples: int) -> Section:
    total, count = sum(stages.values()), max(samples, 1)
    if not total:
        return Section("Time budget")
    rows = [
        (name, f"{spent:.3f}", f"{1e6 * spent / count:.2f}", percent(spent / total))
        for name, spent in (*stages.items(), ("all", total))
    ]
    header = ("stage", "time [s]", "per sample [µs]", "share")
    return Section("Time budget", tables=(ReportTable(header, tuple(rows)),))
