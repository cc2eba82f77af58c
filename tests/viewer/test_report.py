"""A report is one page that needs nothing else, escapes what it is told, and holds figures that a phone can show."""

import re
from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from palpate.contact.estimate import Status
from palpate.viewer import plots
from palpate.viewer._style import inline
from palpate.viewer.drawing import Drawing, Mark
from palpate.viewer.plots import zeros
from palpate.viewer.report import Report, ReportTable, Section, Tile, picture, render
from palpate_lab.simulation.shapes import Superquadric

RNG = np.random.default_rng(0)
N = 30_000
TIME = np.arange(N) / 100.0
HOLES = np.where(np.arange(N)[:, None] % 500 < 200, np.nan, RNG.normal(0.0, 0.01, (N, 3)))
STATUS = RNG.integers(0, len(Status), N)
VERTICES, FACES = Superquadric((0.03, 0.0125, 0.02), (0.8, 0.6)).mesh(8000)
FIGURES: dict[str, Callable[[], Any]] = {
    "forces": lambda: plots.forces(TIME, RNG.normal(size=(N, 3)), STATUS),
    "locations": lambda: plots.locations(TIME, HOLES, np.abs(HOLES)),
    "silhouettes": lambda: plots.silhouettes(VERTICES, FACES, HOLES, HOLES, RNG.uniform(0, 9, N)),
    "histogram": lambda: plots.histogram(RNG.lognormal(size=N), "radius", "mm"),
    "statuses": lambda: plots.statuses(np.bincount(STATUS, minlength=len(Status))),
    "errors": lambda: plots.errors(TIME, np.abs(HOLES[:, 0]), np.abs(HOLES[:, 1])),
    "touch_errors": lambda: plots.touch_errors(["a", "b"], np.array([1e-3, np.nan]), np.array([2e-3, np.nan])),
    "spectra": lambda: plots.spectra(
        [
            plots.SpectrumPanel(
                np.arange(1.0, 500.0), RNG.uniform(1, 2, (499, 3)), "force", "N", np.array([1, 0, 1.0]), 9.0
            )
        ]
    ),
    "zeros": lambda: zeros(TIME, RNG.normal(size=(N, 6)), np.ones((N, 6)), STATUS > 2),
    "zeros of voltages": lambda: zeros(TIME, RNG.normal(size=(N, 12)), np.ones((N, 12)), STATUS > 2),
}
EMPTY: dict[str, Callable[[], Any]] = {
    "forces": lambda: plots.forces(np.full(3, np.nan), np.full((3, 3), np.nan), np.full(3, 7)),
    "locations": lambda: plots.locations(np.zeros(3), np.full((3, 3), np.nan), np.full((3, 3), np.nan)),
    "silhouettes": lambda: plots.silhouettes(VERTICES, FACES, HOLES[:0], HOLES[:0], TIME[:0]),
    "flat": lambda: plots.silhouettes(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]]), np.zeros((1, 3)), np.eye(3)[:1], TIME[:1]
    ),
    "histogram": lambda: plots.histogram(np.full(3, np.nan), "radius", "mm"),
    "statuses": lambda: plots.statuses(np.zeros(len(Status), dtype=np.int64)),
    "errors": lambda: plots.errors(TIME[:1], np.full(1, 1e-3), np.full(1, np.nan)),
    "zeros": lambda: zeros(TIME[:0], HOLES[:0].repeat(2, axis=1), HOLES[:0].repeat(2, axis=1), np.zeros(0, np.bool_)),
    "one zero": lambda: zeros(TIME[:1], np.full((1, 9), np.nan), np.full((1, 9), np.nan), np.ones(1, np.bool_)),
}


class _Page(HTMLParser):
    """What a browser would meet."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def page() -> str:
    section = Section(
        "Forces <all>",
        text=("One & two",),
        points=("do this",),
        settings=(("method", "soft_finger"),),
        pictures=(picture(FIGURES["forces"](), "below"),),
        tables=(ReportTable(("a", "b"), (("1", "<script>alert(1)</script>"),)),),
        drawing=Drawing(VERTICES, FACES, [Mark(VERTICES[0], np.eye(3)[2], "</script><b>")]).html(),
    )
    tiles = (Tile("depth", "8.8 +- 0.1", "mm", "good"),)
    return render(Report("log <b>.csv", "What was done.", tiles, ("careful",), (section,), "palpate"))


def test_the_page_needs_nothing_else(page: str) -> None:
    """No style sheet, image, font or script from elsewhere: addresses are of itself. Only drawings have one."""
    tags = _Page(page).tags
    assert not {"link", "iframe", "object"} & {tag for tag, _ in tags}
    assert [attrs.get("type") for tag, attrs in tags if tag == "script"] == ["application/json", None]
    addresses = [value for _, attrs in tags for name, value in attrs.items() if name in ("src", "href", "xlink:href")]
    assert all(value is not None and value.startswith(("#", "data:image/png")) for value in addresses)
    used = re.findall(r"url\(([^)]*)\)", page)
    assert all(address.startswith("#") for address in used)
    assert {f'id="{address[1:]}"' for address in used} <= set(re.findall(r'id="[^"]*"', page))


def test_the_page_escapes_what_it_is_told(page: str) -> None:
    words = _Page(page).words
    assert "<script>alert(1)</script>" in words
    assert "</script><b>" not in page
    assert "log <b>.csv" in words
    assert "Forces <all>" in words
    assert "8.8 ± 0.1" in " ".join(words)


def test_the_page_fits_a_phone(page: str) -> None:
    """The viewport is the phone's, pictures follow the width, and a table scrolls in a box of its own."""
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    tags = _Page(page).tags
    pictures = [attrs for tag, attrs in tags if tag == "svg"]
    assert pictures
    assert all("width" not in attrs and "viewbox" in attrs for attrs in pictures)
    tables = [k for k, (tag, _) in enumerate(tags) if tag == "table"]
    assert all(tags[k - 1][1].get("class") == "scroll" for k in tables)


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_small_and_say_their_units(name: str) -> None:
    """30,000 samples in less than 250 kB each, so that a report stays below 2 MB; ids are not there to clash."""
    svg = inline(FIGURES[name]())
    assert svg.startswith("<svg viewBox=")
    assert len(svg) < 250_000
    assert re.search(r"\[(?:N|mm|s|%|Hz|N/√Hz)\]", svg)
    assert not re.search(r'id="(?:figure|axes|text|line2d)_', svg)
    points = [path.count("L") for path in re.findall(r' d="([^"]*)"', svg)]
    assert max(points, default=0) <= 2_500


@pytest.mark.parametrize("name", EMPTY)
def test_figures_of_nothing_are_drawn_without_a_warning(name: str) -> None:
    assert "<svg" in inline(EMPTY[name]())


def test_numbers_of_touches_stand_on_the_near_side_and_say_more_to_a_pointer() -> None:
    """One on top, seen from +z alone of the three sides (+z, -y, +x); what is said is escaped."""
    touch = Mark(np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, 1.0]), 'touch 1: <7 N> "hard"', "1")
    svg = picture(plots.silhouettes(VERTICES, FACES, HOLES[:0], HOLES[:0], TIME[:0], [touch]), "").svg
    assert svg.count("<title>") == 1
    assert '<title>touch 1: &lt;7 N&gt; "hard"</title>' in svg
    assert "hover: " not in svg


def test_a_downsampled_line_keeps_every_extreme() -> None:
    """One sample of 30,000 stands out, up or down: it is in the line that is drawn."""
    for at in (0, 12_345, N - 1):
        for peak in (-50.0, 50.0):
            values = RNG.uniform(-1, 1, N)
            values[at] = peak
            _, drawn = plots._curve(TIME, values)
            assert peak in drawn
            assert len(drawn) <= 2 * (plots.COLUMNS + 1)


def test_a_section_leaves_out_what_is_empty() -> None:
    page = render(Report("t", "s", sections=(Section("Only text", text=("words",)),)))
    assert not {"table", "dl", "ul", "figure"} & {tag for tag, _ in _Page(page).tags}
