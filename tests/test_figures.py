"""Law of the pages: each figure in prose was measured, is shown by a block of its page, or is set in the source."""

from pathlib import Path

import pytest

from tests.support.blocks import PAGES, ROOT
from tests.support.figures import Piece, borne_out, pieces, unborne

EVIDENCE = ROOT / "docs/evidence.md"  # written by `make claims`
FREE = {
    ("docs/benchmark.md", "2 mN"): "(0.05, 0.002) of palpate_lab/benchmark/wrench_tasks.py",
    ("docs/drift.md", "99 %"): "standard: the quantile, which the source has as its chi-square value",
    ("docs/drift.md", "20 s"): "LONGEST_TOUCH of calibration/drift_windows.py",
    ("docs/drift.md", "8 %"): "arithmetic: 14 % over the root of three",
    ("docs/how_to/clocks.md", "1.7 degrees"): "arithmetic: 1 rad/s times 30 ms",
    ("docs/how_to/mounting.md", "85 mm"): "arithmetic: 1.5 mm over one degree",
    ("docs/measured.md", "81.7 %"): "its script is not kept, which the page states by a dagger",
    ("docs/skin_contacts.md", "40 s"): "arithmetic: two thirds of a minute",
    ("docs/taxel_poking.md", "2 mm"): "SHIFTED of sensors/taxels/poking/segmentation.py",
    ("docs/tutorials/marker_ring.md", "15 degrees"): "advice",
    ("docs/tutorials/marker_ring.md", "18 degrees"): "`apart` of sensors/marker_ring/locator.py",
}


def _page(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", [page for page in PAGES if page != EVIDENCE], ids=_page)
def test_every_figure_in_prose_is_borne_out(page: Path) -> None:
    found = {(_page(page), figure): piece.line for piece in pieces(page) for figure in unborne(piece)}
    assert {figure: line for figure, line in found.items() if figure not in FREE} == {}
    assert {figure for figure in FREE if figure[0] == _page(page)} <= set(found), "is borne out, or is gone"


@pytest.mark.parametrize(
    ("number", "unit", "line", "agrees"),
    [
        ("3.7", "mm", "mean error 3.72 mm", True),
        ("3.8", "mm", "mean error 3.72 mm", False),
        ("79", "mN", "0.0791 N in the end", True),
        ("79", "N", "79 mN in the end", False),
        ("93", "%", "share that holds: 0.9294", True),
        ("93", "%", "93 N", False),
        ("4,500", "us", "p50 4467.00 us", True),
        ("4,600", "us", "p50 4467.00 us", False),
        ("1.95", "times", "times better: 1.948", True),
    ],
)
def test_a_figure_agrees_with_a_line_that_rounds_to_it(number: str, unit: str, line: str, agrees: bool) -> None:
    assert borne_out(number, unit, line) is agrees


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("the mean error of a finger on the pad is 3.7 mm", []),
        ("the mean error of a finger on the pad is 4.6 mm", ["4.6 mm"]),
        ("the mean error of a finger on the pad is 3.7 s", ["3.7 s"]),
        ("of the finger 3.2 to 3.6 mm after an offset", ["3.6 mm"]),
        ("of the finger 3.14159 after an offset", ["3.14159"]),
        ("nobody knows 3.7 mm", ["3.7 mm"]),
    ],
)
def test_a_theme_bears_out_what_it_measured(text: str, wrong: list[str]) -> None:
    assert unborne(Piece(ROOT / "README.md", 1, text, ("evidence.pad",))) == wrong


def test_a_row_of_a_table_has_the_theme_of_the_text_above_it(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Of `evidence.pad`:\n\n| a |\n|---|\n| 1 |\n| 3<!--evidence.edges--> |\n\nEnd.\n")
    themes = {piece.text.strip(): piece.themes for piece in pieces(page)}
    assert themes["| 1 |"] == ("evidence.pad",)
    assert themes["| 3<!--evidence.edges--> |"] == ("evidence.edges",)
    assert themes["End."] == ()
