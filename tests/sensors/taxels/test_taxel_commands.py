"""A user's way from pokes to a skin that works: calibrate, inspect, evaluate, estimate, from files of the bench."""

import re
from collections.abc import Iterator
from pathlib import Path
from socket import create_server
from typing import BinaryIO

import numpy as np
import pytest

from palpate.cli import main
from palpate.files.logs import join
from palpate.files.mcap.reader import McapFile
from palpate.files.messages import MessageBlock
from palpate.files.models import read_model
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.places_page import TaxelPage, serve_taxels
from palpate.sensors.taxels.poking.evaluate import compare_places
from palpate.sensors.taxels.poking.files import open_pokes
from palpate.sensors.taxels.section import SkinSection
from palpate.setup import load_rig
from palpate.signals.recording import Recording
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import Elbow, PokeBench
from palpate_lab.simulation.poke_log import Timing
from palpate_lab.simulation.poke_session_files import write_poke_session

TABLE = ((94.0, 0.0, 1.0), (15.0, -90.0, 1.0), (45.0, 0.0, 1.0))
RIG = """[surface]
mesh = "forearm.stl"
unit = "m"

[force_torque]

[skin]
{skin}
topic = "/skin/taxels"

[pokes]
sensor = "ft_sensor"
link = "forearm"
urdf = "arm.urdf"
layout = "ring12"
start = "cad.txt"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """240 pokes in three configurations, calibrated."""
    rng, folder = np.random.default_rng(5), tmp_path_factory.mktemp("taxels") / "s"
    arm = Forearm.of()
    session = PokeBench.drawn(rng, skin=arm, arm=Elbow(table=TABLE)).session(rng, 240)
    timing = Timing(period=0.9, ramp=0.1, hold=0.3, rest=1.0, move=0.6)
    write_poke_session(session, arm.cone, arm.cad(rng), folder, rng, timing=timing, touches=6)
    (folder / "rig.toml").write_text(RIG.format(skin="count = 84"))
    (folder / "skin_rig.toml").write_text(RIG.format(skin='taxels = "skin.toml"'))
    assert main([*_calibrate(folder, "pokes.mcap"), "-o", f"{folder}/skin.toml"]) == 0
    return folder


def test_wrenches_and_frames_of_one_reading_are_those_of_two(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, whole = load_rig(folder / "rig.toml"), list[Path]()
    read = McapFile._read  # pyright: ignore[reportPrivateUsage] - counted

    def counted(self: McapFile, file: BinaryIO) -> Iterator[MessageBlock]:
        yield from read(self, file)
        whole.append(self.path)  # not of a glance at the first stamps

    monkeypatch.setattr(McapFile, "_read", counted)
    log, frames, parts = open_pokes(folder / "pokes.mcap", rig.resolve())
    both = list(parts)
    assert len(whole) == 1
    wrenches, stored = join(list(log.blocks())), list(frames.stored())
    of_both = join([part for part in both if isinstance(part, Recording)])
    for name, values in wrenches.channels.items():
        np.testing.assert_array_equal(of_both.channels[name], values)
    for k in range(2):
        of_one = np.concatenate([part[k] for part in both if not isinstance(part, Recording)])
        np.testing.assert_array_equal(of_one, np.concatenate([part[k] for part in stored]))


def _calibrate(folder: Path, log: str, rig: str = "rig.toml") -> list[str]:
    return ["calibrate", "taxels", f"{folder}/{log}", "--rig", f"{folder}/{rig}"]


def _mean(folder: Path, name: str) -> float:
    truth, found = read_taxel_places(folder / "truth.csv"), read_taxel_places(folder / name)
    return float(np.linalg.norm(found.positions - truth.positions, axis=1).mean())


def test_a_log_of_joints_makes_a_skin_better_than_cad(folder: Path) -> None:
    """CAD is 3 mm and 5 degrees off a module; frames and sensor move the whole, so to each other they are better."""
    skin, cad = read_model(folder / "skin.toml", TaxelPlaces), read_taxel_places(folder / "cad.txt")
    assert skin.modules == 7
    assert np.isfinite(skin.covariance).all()
    assert set(skin.provenance) >= {"pokes", "rig", "start", "method"}
    assert _mean(folder, "skin.toml") < _mean(folder, "cad.txt")
    relative = [np.mean(compare_places(each, read_taxel_places(folder / "truth.csv")).relative) for each in (skin, cad)]
    assert relative[0] < 0.5 * relative[1]


@pytest.mark.parametrize(("log", "suffix", "method"), [("pokes.csv", ".txt", "modules"), ("pokes.csv", ".csv", "free")])
def test_a_table_of_pokes_is_taken_and_other_forms_are_written(
    folder: Path, log: str, suffix: str, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    output = f"{folder}/other{suffix}"
    assert main([*_calibrate(folder, log), "--method", method, "-o", output]) == 0
    assert re.search(r"pokes +240 found, \d+ used", capsys.readouterr().out)
    assert _mean(folder, f"other{suffix}") < (3e-3 if method == "modules" else 25e-3)


def test_evaluate_says_errors_and_writes_a_page(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", f"{folder}/skin.toml", f"{folder}/truth.csv", "-o", f"{folder}/r.html"]) == 0
    said = capsys.readouterr().out
    mean = float(re.search(r"absolute +([\d.]+)", said)[1])
    assert mean == pytest.approx(1e3 * _mean(folder, "skin.toml"), abs=2e-3)
    assert "95 % ellipsoids" in said
    page = (folder / "r.html").read_text()
    assert page.count("<svg") >= 2
    assert "http" not in page.replace("http://www.w3.org", "")


def test_inspect_says_what_each_file_is(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = {"skin.toml": "once one rigid motion is taken off", "cad.txt": "84", "truth.csv": "84", "rig.toml": "pokes"}
    for name, said in told.items():
        assert main(["inspect", f"{folder}/{name}"]) == 0
        assert said in capsys.readouterr().out


def test_contacts_know_how_well_the_places_of_their_taxels_are_known(folder: Path) -> None:
    skin = read_model(folder / "skin.toml", TaxelPlaces)
    body = load_rig(folder / "skin_rig.toml").resolve("skin").of(SkinSection).body
    np.testing.assert_array_equal(body.covariance, skin.covariance)


def test_the_skin_at_work_finds_touches(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """To a taxel's spacing, 6 mm, at the median."""
    estimate = ["estimate", f"{folder}/touches.mcap", "--rig", f"{folder}/skin_rig.toml", "-o", f"{folder}/c.csv"]
    assert main([*estimate, "--sensor", "skin"]) == 0
    capsys.readouterr()
    assert main(["evaluate", f"{folder}/c.csv", f"{folder}/touches_truth.csv"]) == 0
    found = re.search(r"location \[mm\] +([\d.]+) +([\d.]+)", capsys.readouterr().out)
    assert float(found[2]) < 6.0


def test_a_plan_of_pokes_makes_the_worst_taxel_better(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each poke leaves the largest deviation as it was or less; places by CAD say nothing of pokes."""
    plan = ["plan", "pokes", f"{folder}/rig.toml", "--skin", f"{folder}/skin.toml", "-o", f"{folder}/next.csv"]
    assert main([*plan, "--wanted", "1e-4", "--pokes", "12"]) == 0
    assert "12 more pokes are not enough" in capsys.readouterr().out
    rows = np.genfromtxt(folder / "next.csv", delimiter=",", names=True)
    assert len(rows) == 12
    assert (np.diff(rows["worst"]) <= 1e-9).all()
    assert set(rows["configuration"]) <= {0, 1, 2}
    assert main([*plan, "--wanted", "0.1"]) == 0
    assert "the pokes so far are enough" in capsys.readouterr().out
    assert main(["plan", "pokes", *plan[2:4], f"{folder}/cad.txt", *plan[5:]]) == 1
    assert "does not state the arm configurations in which it was made. Plan" in capsys.readouterr().err


def test_a_page_shows_the_places(folder: Path) -> None:
    with TaxelPage(read_taxel_places(folder / "cad.txt"), None, "cad", (("taxels", "84"),), port=0) as page:
        assert page.address.startswith("http://127.0.0.1:")
    with create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    addresses = list[str]()

    def up(address: str) -> None:
        addresses.append(address)
        raise KeyboardInterrupt  # as Ctrl-C does

    serve_taxels(read_taxel_places(folder / "cad.txt"), None, "cad", (), port=port, up=up)
    assert [each.startswith(f"http://127.0.0.1:{port}/") for each in addresses] == [True]


def _degrees(folder: Path) -> str:
    lines = (folder / "pokes_log.csv").read_text().splitlines()
    names = lines[0].split(",")
    pitch = names.index("elbow_pitch")
    rows = [line.split(",") for line in lines[1:400]]
    for row in rows:
        row[pitch] = f"{np.degrees(float(row[pitch])):.4f}"
    return "\n".join([lines[0], *(",".join(row) for row in rows)])


def _jointless(folder: Path) -> str:
    return (folder / "pokes_log.csv").read_text().replace("elbow_roll", "wrist")


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (_degrees, "joint 'elbow_pitch' reads up to 94, more than a turn: it seems to be in degrees. Write"),
        (_jointless, "there is no column 'elbow_roll'. Available"),
    ],
)
def test_joints_in_degrees_or_missing_are_a_sentence(
    folder: Path, made: object, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "odd.csv").write_text(made(folder))
    cells = ", ".join(f'"t{k}"' for k in range(84))
    rig = RIG.format(skin=f"count = 84\ncells = [{cells}]").replace('topic = "/skin/taxels"\n', "")
    (folder / "odd.toml").write_text(rig)
    assert main([*_calibrate(folder, "odd.csv", "odd.toml"), "-o", f"{folder}/odd_skin.toml"]) == 1
    assert said in capsys.readouterr().err
    assert not (folder / "odd_skin.toml").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (["--layout", "ring13"], "'ring13' is not known. Use ring12"),
        (["--start", "{folder}/forearm.stl"], "forearm.stl"),
        (["--start", "{folder}/small.csv"], "CAD file of this skin"),
        (["-o", "{folder}/skin.xml"], "cannot write places of taxels as '.xml'. Use"),
        (["--threshold", "-3"], "--threshold: must be positive"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(
    folder: Path, change: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "small.csv").write_text("x,y,z\n0.03,0,0.1\n0.03,0.006,0.1\n")
    options = [text.format(folder=folder) for text in change]
    given = [] if "-o" in options else ["-o", f"{folder}/no.toml"]
    assert main([*_calibrate(folder, "pokes.csv"), *options, *given]) == 1
    assert said in capsys.readouterr().err
    assert not (folder / "no.toml").exists()


def test_one_arm_configuration_is_named_with_what_it_hides(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (folder / "pokes.csv").read_text().splitlines()
    at = lines[0].split(",").index("configuration")
    kept = [line for line in lines[1:] if float(line.split(",")[at]) == 0]
    (folder / "one.csv").write_text("\n".join([lines[0], *kept]))
    for method in ("modules", "weighted"):
        assert main([*_calibrate(folder, "one.csv"), "--method", method, "-o", f"{folder}/one.toml"]) == 0
        assert "only one arm configuration" in capsys.readouterr().out
