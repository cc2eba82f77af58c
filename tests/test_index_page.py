"""The README as an index page shows it, where no file of the project lies beside it."""

import re

from hatch_build import RELATIVE, for_an_index
from tests.support.blocks import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
HOME = "https://example.org/palpate"


def test_links_lead_to_files_that_are_there() -> None:
    made = for_an_index(README, HOME)
    targets = re.findall(r"\]\((\S+?)\)", made)
    assert len(targets) == len(re.findall(r"\]\((\S+?)\)", README)) > 20
    for target in targets:
        kind, _, path = target.removeprefix(f"{HOME}/").partition("/main/")
        assert kind in ("blob", "raw"), target
        assert (ROOT / path.partition("#")[0]).exists(), target
    assert made.count(f"({HOME}/raw/main/") == README.count("![")


def test_without_an_address_no_link_leads_nowhere() -> None:
    made = for_an_index(README, "")
    assert not RELATIVE.search(made)
    assert "What works today" in made  # the text of a link stays
    elsewhere = "[a](https://example.org/b.md) and [c](#d)"
    assert for_an_index(elsewhere, "") == for_an_index(elsewhere, HOME) == elsewhere
