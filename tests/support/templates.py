"""The places of a page's template, which a run must fill."""

from pathlib import Path
from string import Formatter


def places(folder: Path) -> set[str]:
    """Return the names that stand in braces in a folder's page.template, but for those that every page has."""
    text = (folder / "page.template").read_text(encoding="utf-8")
    return {name.partition("[")[0] for _, name, _, _ in Formatter().parse(text) if name} - {"asked", "machine"}
