"""What a user writes from memory runs as written, and so does every snippet of the documentation; paths are text."""

import contextlib
import io
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import palpate
from palpate_lab.simulation.session import simulate_session
from palpate_lab.simulation.session_files import write_session
from palpate_lab.simulation.session_mcap import write_session_mcap
from tests.conformance.fields import Case, run
from tests.conformance.sensors import SENSORS, Sensor
from tests.support.blocks import PAGES, ROOT, Follower, blocks, refusal

BY_NAME = {sensor.name: sensor for sensor in SENSORS}
TO_RUN = {
    page: found
    for page in PAGES
    if (found := [block for block in blocks(page) if block.kind in ("sh", "python") and not block.mark])
}
EACH_PAGE = pytest.mark.parametrize("page", TO_RUN, ids=lambda page: page.relative_to(ROOT).as_posix())

WRENCH = """
mesh = palpate.Mesh.load("probe.stl", unit="mm")
contact = palpate.locate([-0.5, -3.0, -4.0, 0.0277, 0.0114, -0.0120], mesh)
print(contact.status, contact.point)
"""
LOG = """
contacts = palpate.estimate("log.csv", "rig.toml")
table = contacts.to_polars()
print(len(table), table["status"][0], contacts[contacts.answered].point.mean(axis=0))
"""
FINGERTIP = """
tip = palpate.load_rig("rig.toml").estimator()
tip.tare(rest)
for time, volts in zip(times, voltages):
    contact = tip.update(time, volts)
    if contact.answered[0]:
        print(contact.point[0], contact.force[0])
"""
SKIN = """
rig = palpate.load_rig("rig.toml")
with palpate.open_log("log.csv", rig) as log:
    for found in rig.estimator(log).stream(log):
        print(found.identity.max(), found.features["area"][found.answered].mean())
"""
MAP = """
link = palpate.Mesh.load("link.stl", unit="mm")
sheet = palpate.Sheet(rows=6, columns=22, pitch=(0.01, 0.01))
laid = palpate.map_skin(link, sheet, origin=(0.0355, 0, -0.03), heading=(0, 1, 0))
print(laid.centres.shape, laid.at(2.5, 3.0))
"""


def _run(code: str, **names: object) -> str:
    """What a snippet prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "snippet", "exec"), {"palpate": palpate, "np": np, **names})
    return out.getvalue()


@pytest.mark.parametrize(
    ("name", "code", "printed"),
    [
        ("six-axis", WRENCH, r"^contact \[0\.005"),
        ("six-axis", LOG, r"^2640 no_contact \["),
        ("skin", SKIN, r"^[1-9]"),
        ("skin", MAP, r"^\(6, 22, 3\)"),
    ],
)
def test_what_a_user_writes_from_memory(
    case_of: Callable[[Sensor], Case], monkeypatch: pytest.MonkeyPatch, name: str, code: str, printed: str
) -> None:
    monkeypatch.chdir(case_of(BY_NAME[name]).files.folder)
    assert re.match(printed, _run(code))


def test_a_fingertip_from_memory(case_of: Callable[[Sensor], Case], monkeypatch: pytest.MonkeyPatch) -> None:
    files = case_of(BY_NAME["load cells"]).files
    monkeypatch.chdir(files.folder)
    log = pl.read_csv(files.log)
    times = log["time"].to_numpy()
    voltages = log.select(pl.col("^u.*$")).to_numpy()
    rest = palpate.Recording(times[times < files.rest], {"voltage": voltages[times < files.rest]})
    lines = _run(FINGERTIP, rest=rest, times=times[:300], voltages=voltages[:300]).splitlines()
    assert len(lines) > 50
    assert len(set(lines)) == len(lines)


def test_paths_may_be_text_everywhere(case_of: Callable[[Sensor], Case]) -> None:
    """Each function that a user gives a file takes `str` and `Path` alike."""
    files = case_of(BY_NAME["six-axis"]).files
    for kind in (str, Path):
        rig = palpate.load_rig(kind(files.rig))
        with palpate.open_log(kind(files.log), rig) as opened:
            assert len(next(iter(opened)))
        assert palpate.Mesh.load(kind(files.folder / "probe.stl"), unit="mm").faces.size
    from palpate.files.contacts import open_contacts, read_contacts

    found = palpate.estimate(str(files.log), str(files.rig))
    with open_contacts(str(files.folder / "text.parquet")) as output:
        output.write(found)
    assert len(read_contacts(str(files.folder / "text.parquet"))) == len(found)


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that `make demo` leaves, of a smaller session."""
    folder = tmp_path_factory.mktemp("demo")
    session = simulate_session(touches=6, facets=2000)
    write_session(session, folder)
    write_session_mcap(session, folder)
    with contextlib.chdir(folder):
        run("calibrate", "payload", "free_motion.csv", "--rig", "rig.toml", "-o", "payload.toml")
        run("estimate", "touches.csv", "--rig", "rig.toml", "-o", "contacts.csv")
    return folder


@EACH_PAGE
def test_every_block_of_a_page_runs(page: Path, demo: Path, tmp_path: Path) -> None:
    """In order; a page of snippets alone, beside the demo's files. What cannot run here says so above it."""
    found, folder = TO_RUN[page], tmp_path
    if found[0].kind == "python":  # otherwise the page says by itself where its files are
        folder = shutil.copytree(demo, tmp_path / "demo")
    follower = Follower(folder, demo)
    for block in found:
        follower.run(block)


def test_every_call_on_a_page_is_one_that_the_command_line_takes() -> None:
    """Commands and options exist, in templates too; which files are there is another matter."""
    calls = {tuple(call): block for page in PAGES for block in blocks(page) for call in block.calls()}
    assert len(calls) > 60
    refused = {
        f"{block}: palpate {' '.join(call)}": why for call, block in calls.items() if (why := refusal(list(call)))
    }
    assert refused == {}
