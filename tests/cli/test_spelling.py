"""What is misspelt is said in one sentence that names what was meant, and the exit code is that of a wrong call."""

import pytest

from palpate.cli import main
from palpate.cli.app import _EACH, command_of, join_others
from palpate.cli.spelling import unknown_command, unknown_option

join_others()

GROUPS = {"estimate": (), "events": (), "calibrate": ("clock", "load-cells"), "rig": ("new",)}


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        ("estimat log.csv", "`palpate estimate`"),
        ("Events", "`palpate events`"),
        ("clock", "`palpate calibrate clock`"),
        ("calibrate-clock", "`palpate calibrate clock`"),
        ("calibrate load_cells", "`palpate calibrate load-cells`"),
        ("calibrate xyzzy", "`palpate calibrate --help`"),
        ("xyzzy", "`palpate --help`"),
        ("version", "`palpate --version`"),
        ("Tare", "`palpate estimate --tare SECONDS`"),
        ("plot", "`palpate view`"),
    ],
)
def test_a_misspelt_command_names_what_was_meant(call: str, meant: str) -> None:
    said = unknown_command(call.split(), command_of(call.split(), GROUPS), GROUPS)
    assert said is not None
    assert meant in said


@pytest.mark.parametrize("call", ["", "--help", "estimate estimat", "calibrate", "calibrate --help", "rig new nwe"])
def test_what_names_a_command_or_none_is_not_corrected(call: str) -> None:
    assert unknown_command(call.split(), command_of(call.split(), GROUPS), GROUPS) is None


def test_options_are_those_of_the_command() -> None:
    words = ["calibrate", "clock", "log.csv", "--rgi=r.toml", "-o", "x", "--offset", "-1"]
    command = command_of(words, GROUPS)
    assert command == ("calibrate", "clock")
    assert "did you mean --rig?" in str(unknown_option(words, command, ("--rig", "--offset")))
    assert unknown_option(words, command, ("--rgi", "--offset")) is None
    assert unknown_option(["--load_cells"], command, ("--load-cells",)) is None


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        ("estimat", "`palpate estimate`"),
        ("estimate log.csv -o x.csv --riig rig.toml", "--rig?"),
        ("estimate --jsn", "--json?"),
        ("--verson", "--version?"),
        ("estimate --log log.csv", "`palpate estimate LOG`"),
        ("live --ip 192.168.1.1", "[source]"),
        ("inspect --xyzzy", "`palpate inspect --help`"),
    ],
)
def test_a_misspelt_call_is_one_sentence(call: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(call.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert meant in err


def test_what_is_not_misspelt_is_said_by_the_parser(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["estimate", "--frame"]) == 2
    assert "Missing value" in capsys.readouterr().err


def test_completion_is_printed_and_no_wrong_call(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--tyro-print-completion", "bash"]) == 0
    said = capsys.readouterr().out
    assert all(f"'{name.split()[-1]}': {{'description'" in said for name in _EACH)


@pytest.mark.parametrize("call", ["", "calibrate"])
def test_a_call_without_a_command_is_told_where_they_are_listed(call: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(call.split()) == 2
    assert f"`{' '.join(['palpate', *call.split(), '--help'])}` lists them" in capsys.readouterr().err


@pytest.mark.parametrize("name", _EACH)
def test_the_table_says_of_a_command_what_its_docstring_begins_with(name: str) -> None:
    """The lists are printed without importing the commands."""
    first = (_EACH[name].load().__doc__ or "").partition("\n\n")[0]
    assert _EACH[name].about == " ".join(first.split())


def test_the_lists_of_commands_name_each_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    for name, command in _EACH.items():
        group = name.split()[:-1]
        assert main([*group, "--help"]) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert f" {name.split()[-1]} {command.about}" in said
        assert said.endswith(f"`{' '.join(['palpate', *group])} COMMAND --help` has the options of each.")
