"""The page of all claims, made from `figures.json`, and a page a paper, made from its template."""

import json
import os
import platform
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import palpate
from claims.row import ROOT, Row

FIGURES, PAGE = ROOT / "claims" / "figures.json", ROOT / "docs" / "evidence.md"
VERDICTS = {"met": "met", "**missed**": "missed", "reported": "reported", "skipped": "skipped"}
THEMES: dict[str, dict[str, str]] = tomllib.loads((ROOT / "claims" / "themes.toml").read_text(encoding="utf-8"))
Kept = dict[str, dict[str, Any]]
PACKAGES = ("numpy", "numba", "scipy", "trimesh", "embreex")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], align: str = "---") -> str:
    """Return a table in Markdown; `align` of all columns but the first."""
    lines = [header, ["---", *[align] * (len(header) - 1)], *rows]
    cells = [[cell.replace("|", r"\|").replace("\n", " ") for cell in line] for line in lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in cells)


def asked(rows: Sequence[Row], *others: str) -> str:
    """Return the table of what a paper's expected.toml asks for, with a column for what each of `others` has."""
    lines = [[row.what, *row.theirs, row.got, row.target, row.verdict if row.target else ""] for row in rows]
    return table(("figure", *others, "got", "asked", ""), lines)


def fill(folder: Path, page: str = "README.md", **parts: object) -> None:
    """Write a folder's page: its page.template with each {part}, and the {machine}, in place."""
    lines = "\n".join(f"- {line}" for line in machine())
    text = (folder / "page.template").read_text(encoding="utf-8").format(**parts, machine=lines)
    (folder / page).write_text(text, encoding="utf-8")


def renew(theme: str, rows: Sequence[Row], measured: str) -> None:
    """Keep what was measured of a theme in figures.json, and write the page of all themes."""
    kept: Kept = json.loads(FIGURES.read_text(encoding="utf-8"))
    kept[theme] = {"measured": measured, "rows": [list(vars(row).values()) for row in rows]}
    FIGURES.write_text(_kept(kept), encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")


def _kept(kept: Kept) -> str:
    """Return figures.json: a row of a theme a line."""

    def json_of(value: object) -> str:
        return json.dumps(value, ensure_ascii=False)

    themes = [
        f'{json_of(theme)}: {{"measured": {json_of(one["measured"])}, "rows": [\n'
        + ",\n".join(map(json_of, one["rows"]))
        + "\n]}"
        for theme, one in kept.items()
    ]
    return "{\n" + ",\n".join(themes) + "\n}\n"


def page(kept: Kept, themes: Mapping[str, Mapping[str, str]] = THEMES) -> str:
    """Return the page: what was missed, then a theme a line, by sensor, each with its folded table."""
    found = {name: [Row(*row) for row in one["rows"]] for name, one in kept.items()}
    titles = {name: title for group in themes.values() for name, title in group.items()}
    shown = {name: found[name] for name in titles if name in found}
    missed = [
        f"- {titles[name]}: {row.what}. Target {row.target}; got {row.got}"
        for name, rows in shown.items()
        for row in rows
        if row.passed is False
    ]
    groups = list[str]()
    for group, members in themes.items():
        folded = [_folded(name, titles[name], shown[name], kept[name]["measured"]) for name in members if name in shown]
        groups += [f"## {group}", *folded] if folded else []
    template = (ROOT / "claims" / "page.template").read_text(encoding="utf-8")
    counts = _counts([row for rows in shown.values() for row in rows])
    return template.format(counts=counts, missed="\n".join(missed), groups="\n\n".join(groups))


def _folded(name: str, title: str, rows: Sequence[Row], measured: str) -> str:
    others = max((len(row.theirs) for row in rows), default=0)
    header = ("row", *(["theirs"] * others), "target", "got", "")
    lines = [
        [row.what, *row.theirs, *[""] * (others - len(row.theirs)), row.target, row.got, row.verdict] for row in rows
    ]
    head = f"<details>\n<summary>{title}: {_counts(rows)}</summary>"
    return f"{head}\n\n`make claims ONLY={name}`; {measured}\n\n{table(header, lines)}\n\n</details>"


def _counts(rows: Sequence[Row]) -> str:
    counts = Counter(row.verdict for row in rows)
    return ", ".join(f"{counts[verdict]} {word}" for verdict, word in VERDICTS.items() if counts[verdict])


def machine() -> list[str]:
    """Date, processor, versions and how busy it was, a line each."""
    now = datetime.now(UTC)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    return [
        f"{now:%Y-%m-%d %H:%M} UTC",
        f"palpate {palpate.__version__}, Python {platform.python_version()}, {versions}",
        f"{_processor()}, {cores} cores, load {load:.1f}; {platform.system()} {platform.machine()}",
    ]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown processor")
