"""The numbered examples run as they stand, are short, have a page, and end with the number that they are about."""

import contextlib
import io
import re
import runpy
from pathlib import Path

import pytest

from tests.support.blocks import ROOT, blocks, unseen

NUMBERED = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))
SHOWN = [block for block in blocks(ROOT / "docs/examples.md") if block.kind == "text"]  # what each of them prints
ENDS = {  # of the last line: a pattern with numbers, and between what each lies
    "01_locate_one_wrench": (r"off by ([\d.]+) mm", (0.0, 0.05)),  # 8,000 facets are 0.01 mm inside the body
    "02_log_to_touches": (r"3 touches, off by ([\d.]+) mm", (0.0, 0.2)),  # the noise of a sample is 0.3 mm
    "03_payload_and_bias": (r"([\d.]+) N before, ([\d.]+) N after", (1.0, 10.0), (0.019, 0.022)),  # noise is 0.02 N
    "04_covariance_you_can_trust": (r"in ([\d.]+)%", (94.2, 96.5)),  # 0.22 % is one deviation; facets widen a little
    "05_surface_by_equation": (r"off by ([\d.]+) um", (0.0, 0.001)),
    "06_fingertip_voltages": (r"off by (\d+) um \(median\), forces of up to ([\d.]+) N", (5, 45), (3.0, 6.0)),
    "07_skin_frames_to_contacts": (r"8 touches, off by ([\d.]+) mm", (0.0, 0.5)),  # a twentieth of a cell
    "08_marker_ring_frame": (r"off by (-?[\d.]+) degrees", (-1.0, 1.0)),
    "09_live_loop": (r"(\d+) of 1760 cycles in contact, ([\d.]+) N", (1000, 1300), (5.0, 12.0)),
    "10_touch_navigator": (r"(\d+) mm from the goal, pressed with ([\d.]+) N", (0, 110), (0.1, 4.0)),
}


@pytest.mark.parametrize("example", NUMBERED, ids=lambda path: path.stem)
def test_an_example_ends_with_its_number(example: Path) -> None:
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        runpy.run_path(str(example), run_name="__main__")
    lines = said.getvalue().splitlines()
    last = lines[-1]
    pattern, *bounds = ENDS[example.stem]
    found = re.search(pattern, last)
    assert found is not None, last
    for number, (least, most) in zip(found.groups(), bounds, strict=True):
        assert least <= float(number) <= most, last
    assert unseen(SHOWN[NUMBERED.index(example)].code, lines) == [], "the page shows otherwise"


def test_every_example_is_numbered_in_turn_short_and_on_the_page() -> None:
    assert [path.stem for path in NUMBERED] == list(ENDS)
    assert [int(path.stem[:2]) for path in NUMBERED] == list(range(1, len(NUMBERED) + 1))
    assert [path.name for path in NUMBERED if len(path.read_text(encoding="utf-8").splitlines()) >= 60] == []
    page = (ROOT / "docs/examples.md").read_text(encoding="utf-8")
    assert [path.name for path in NUMBERED if f"../examples/{path.name}" not in page] == []
