"""The search of the documentation leads from the words that people type to the right page first, in a real browser."""

import os
from typing import Any, cast

import pytest

from tests.support.blocks import ROOT
from tests.support.browser import PATIENCE, chromium

SEARCH = ROOT / "docs/_build/html/search.html"
PAGES = {  # what people type: the page that answers it
    "gravity compensation": "tutorials/force_torque",
    "contact localization": "quickstart",
    "point of contact": "quickstart",
    "contact force": "quickstart",
    "tactile sensor": "tutorials/index",
    "bias": "drift",
    "zero": "drift",
    "tare": "conventions",
    "drift": "drift",
    "payload identification": "tutorials/force_torque",
    "center of mass": "tutorials/force_torque",
    "force torque calibration": "tutorials/force_torque",
    "reference frame": "conventions",
    "center of pressure": "glossary",
    "shear": "marker_ring",
    "slip": "glossary",
    "taxel calibration": "taxel_poking",
    "robot skin": "skin_contacts",
    "clock offset": "how_to/clocks",
    "noise": "conventions",
}


def test_the_search_leads_to_the_right_page_first() -> None:
    if not SEARCH.is_file():
        if os.environ.get("CI"):
            pytest.fail("the pages are not built: `make docs`")
        pytest.skip("the pages are not built: `make docs`")
    found = dict[str, str]()
    with chromium() as browser:
        page: Any = cast("Any", browser).new_page()
        for words in PAGES:
            page.goto(f"{SEARCH.as_uri()}?q={words.replace(' ', '+')}")
            first = page.locator("#search-results ul.search li a").first
            first.wait_for(timeout=1e3 * PATIENCE)
            found[words] = first.get_attribute("href").partition(".html")[0]
    assert found == PAGES
