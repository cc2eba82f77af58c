"""Tables of names: imported when asked for, in order, with what other packages bring."""

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.cli import main
from palpate.errors import InputError
from palpate.registry import Registry

ROOT = Path(__file__).parents[1]
OUTSIDE = ROOT / "tests" / "conformance" / "outside"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A package that brings things under a group of its own, and commands of which one is broken."""
    info, broken = tmp_path / "brought-1.0.dist-info", "broken = nowhere:THING\n"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: brought\nVersion: 1.0\n")
    numbers = f"[palpate.tests]\nten = brought:TEN\ntwo = brought:TWO\n{broken}text = brought:TWO\n"
    (info / "entry_points.txt").write_text(f"{numbers}[palpate.calibrations]\n{broken}")
    (tmp_path / "brought.py").write_text("ONE, TEN, TWO = 1.0, 10.0, 'not this one'\n")
    monkeypatch.syspath_prepend(tmp_path)
    return "palpate.tests"


def test_what_a_package_brings_comes_first_and_takes_no_name(package: str) -> None:
    rows = {"one": "brought.ONE", "two": "math.tau", "infinity": "math.inf"}
    numbers = Registry(rows, float, package, first=True)
    assert list(numbers) == ["ten", "broken", "text", *rows]
    assert list(Registry(rows, float, package)) == [*rows, "ten", "broken", "text"]
    assert (numbers["ten"], numbers["two"], numbers["infinity"]) == (10.0, math.tau, math.inf)
    assert list(numbers.among({"infinity", "one", "nobody"})) == [1.0, math.inf]
    assert "nobody" not in numbers
    with pytest.raises(KeyError):
        numbers["nobody"]


@pytest.mark.parametrize(
    ("name", "said"), [("broken", "cannot be imported.*Correct"), ("text", "is str, not float.*Correct")]
)
def test_what_a_package_brings_wrongly_names_the_package(package: str, name: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        Registry({}, float, package)[name]
    assert "of the package brought" in caught.value.where


def test_a_name_of_its_own_imports_nothing_else() -> None:
    script = (
        "import sys; from palpate.setup import load_rig; from palpate.files.models import read_model\n"
        "rig = load_rig('rig.toml'); rig.resolve().prepared(); read_model('payload.toml')\n"
        "print(*sorted(name for name in sys.modules if name.startswith('palpate.')))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT / "tests/v03/six-axis", capture_output=True, text=True, check=True
    ).stdout.split()
    assert "palpate.sensors.force_torque.section" in loaded
    others = {f"palpate.sensors.{name}" for name in ("load_cells", "marker_ring", "taxels", "fused")}
    assert not others & set(loaded)


def test_a_sensor_of_another_package_is_there_in_a_process_of_its_own(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('[surface]\nkind = "plane"\n\n[plate]\n')
    surroundings = os.environ | {"PYTHONPATH": f"{OUTSIDE}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "inspect", str(rig)]
    said = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=True).stdout
    assert "three cells under a plate [plate]" in said


def test_a_package_with_broken_commands_leaves_the_others(package: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--help"]) == 0
    assert main(["calibrate", "broken"]) == 2
    assert "of the package brought: nowhere:THING cannot be imported" in capsys.readouterr().err
