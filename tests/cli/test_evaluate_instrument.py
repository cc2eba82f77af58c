"""`palpate evaluate` with what other instruments measured: a wrench below the body, a wand, points."""

from pathlib import Path

import pytest

from palpate.cli import main
from tests.support.skin_session_files import estimated_skin_session


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("skin")
    estimated_skin_session(made)
    return made


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("truth.csv", 0, "location of touches"),
        ("wrench.csv --rig rig.toml -o report.html", 0, "as the paper"),
        ("wand.csv --rig rig.toml --wand wand.stl", 0, "wand tracked by motion capture"),
        ("wrench.csv", 1, "needs the body of a rig. Add --rig FILE"),
        ("wand.csv --rig rig.toml", 1, "Add --wand"),
        ("truth.csv -o r.html", 1, "--output: works only where the truth is a wrench or a wand. For other"),
    ],
)
def test_contacts_are_judged_by_every_instrument(
    folder: Path, words: str, code: int, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert main(["evaluate", "contacts.csv", *words.split()]) == code
    told = "".join(capsys.readouterr())
    assert said in told
    assert code or "rig" not in words or "  note: " in told  # which body
    if "report.html" in words:
        page = (folder / "report.html").read_text()
        assert page.count("<svg") == 1
        assert "a perfect map" in page
