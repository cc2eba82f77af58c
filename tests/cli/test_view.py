"""`palpate view`: it serves a log or its contacts, says where, and ends quietly by Ctrl-C."""

import importlib
import inspect
import re
import signal
import socket
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate.viewer import server
from palpate.viewer.scene import Scene
from palpate_lab.simulation.session import simulate_session
from palpate_lab.simulation.session_files import write_session
from tests.support.program import program

view_command = importlib.import_module("palpate.cli.view")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with its payload, and contacts in two frames."""
    folder = tmp_path_factory.mktemp("session")
    write_session(simulate_session(3, touches=3, facets=1000), folder)
    log, rig = str(folder / "touches.csv"), str(folder / "rig.toml")
    assert main(["calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")]) == 0
    for frame in ("surface", "sensor"):
        assert main(["estimate", log, "--rig", rig, "--frame", frame, "-o", str(folder / f"{frame}.csv")]) == 0
    return folder


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Scene]:
    """The scenes that would have been served."""
    scenes: list[Scene] = []
    monkeypatch.setattr(view_command, "serve", lambda scene, *_, **__: scenes.append(scene))
    return scenes


def test_a_log_is_estimated_and_its_contacts_are_shown_as_they_are(made: Path, shown: list[Scene]) -> None:
    """The same contacts by three ways; those in the sensor's frame come back by the mount, to rounding."""
    for name in ("touches.csv", "surface.csv", "sensor.csv"):
        assert main(["view", str(made / name), "--rig", str(made / "rig.toml")]) == 0
    log, surface, sensor = (scene.contacts for scene in shown)
    assert np.array_equal(log.point, read_contacts(made / "surface.csv").estimate.point, equal_nan=True)
    assert np.array_equal(log.point, surface.point, equal_nan=True)
    assert sensor.point == pytest.approx(log.point, abs=1e-12, nan_ok=True)
    assert [scene.title for scene in shown] == ["touches.csv", "surface.csv", "sensor.csv"]


def test_contacts_in_the_base_frame_are_refused(
    made: Path, tmp_path: Path, shown: list[Scene], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "contacts.csv").write_bytes((made / "surface.csv").read_bytes())
    (tmp_path / "contacts.csv.toml").write_text('frame = "base"\n')
    assert main(["view", str(tmp_path / "contacts.csv"), "--rig", str(made / "rig.toml")]) == 1
    assert "in the base frame, in which the body moves. Estimate" in capsys.readouterr().err
    assert shown == []


def test_a_missing_viser_is_said_before_any_work(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(server, "find_spec", lambda name: None)
    assert main(["view", str(made / "touches.csv"), "--rig", str(made / "rig.toml")]) == 1
    assert "pip install 'palpate[view]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--film", "out.txt"), "Name it OUT.mp4"),
        (("--film", "nowhere/out.mp4"), "there is no folder"),
        (("--film", "out.mp4", "--compare", "nofile.csv"), "nofile.csv: the file does not exist"),
        (("--compare", "touches.csv"), "touches.csv: holds no contacts to compare"),
    ],
)
def test_films_and_comparisons_that_cannot_be_are_one_sentence(
    made: Path, shown: list[Scene], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(made)
    assert main(["view", "surface.csv", "--rig", "rig.toml", *options]) == 1
    problem = capsys.readouterr().err
    assert said in problem
    assert problem.count("\n") == 1
    assert not shown
    assert not (made / "out.mp4").exists()


@pytest.mark.parametrize("where", [("--host", "192.0.2.1"), ("--port", "70000"), ("--port", "-5")])
def test_an_address_to_which_nothing_can_be_bound_is_one_sentence(
    made: Path, capsys: pytest.CaptureFixture[str], where: tuple[str, str]
) -> None:
    """192.0.2.0/24 is for documentation: no machine has it."""
    assert main(["view", str(made / "surface.csv"), "--rig", str(made / "rig.toml"), *where]) == 1
    said = capsys.readouterr().err
    assert "cannot listen there" in said
    assert said.count("\n") == 1


def test_it_listens_at_this_machine_only_unless_told_otherwise() -> None:
    for function in (view_command.view, server.serve, server.Page.__init__):
        assert inspect.signature(function).parameters["host"].default == "127.0.0.1"


def test_it_serves_until_ctrl_c_on_the_next_free_port(made: Path) -> None:
    """As a program, with its port taken: the page is there, the end is quiet, and the exit code is 0."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with program("view", str(made / "surface.csv"), "--rig", str(made / "rig.toml"), "--port", str(port)) as run:
            assert run.stdout is not None
            line = next(line for line in run.stdout if "http" in line)
            address = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=[\w-]+", line)
            assert address is not None
            assert int(address[1]) != port
            with urllib.request.urlopen(address[0]) as answer:
                assert answer.status == 200
            run.send_signal(signal.SIGINT)
            rest, errors = run.communicate(timeout=120)
    assert (run.returncode, rest, errors) == (0, "", "")
