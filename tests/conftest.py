"""What every test gets: shapes checked at run time, seeded properties, and the shared real data."""

import fcntl
import gc
import os
import re
import signal
import socket
import sys
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from unittest import mock

import numpy.typing
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from tests.support.checked import cache_apart, check_first_calls, require_places, start_counting

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests/conformance/outside"))  # a package with sensors that are not Palpate's


def _checked_modules() -> list[str]:
    """Every module whose annotations are enforced while testing.

    The hook decorates each function, which numba cannot compile: files of kernels stay out. Packages stay out too,
    because a package's name stands for everything below it; their `__init__` only re-export.
    """
    source = ROOT / "src"
    files = [file for file in source.rglob("*.py") if not file.name.startswith("__")]
    checked = [
        file
        for file in files
        if not re.search(
            r"^\s*(?:from|import) numba|^@(?:entry|released|inner|inlined|uncounted)", file.read_text(), re.MULTILINE
        )
    ]
    return [".".join(file.relative_to(source).with_suffix("").parts) for file in checked]


gc.disable()  # until the tests are collected: what is imported stays

# A shell ignores Ctrl-C in what runs behind it, and so would every program that a test starts and interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)
numpy.typing.ArrayLike = object  # numpy's is a protocol at run time, and no tuple meets it (no __reversed__)
cache_apart()
check_first_calls()
install_import_hook(_checked_modules(), "beartype.beartype")  # here only: production pays nothing for it
require_places()

# The default is the same examples on every machine, with no clock; `--hypothesis-profile=explore` looks for new ones.
settings.register_profile("seeded", derandomize=True, deadline=None, max_examples=50)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("seeded")


@pytest.fixture
def udp() -> Iterator[socket.socket]:
    """A listener on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(60.0)
        yield listener


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real recordings that are never copied into the project; tests skip where it is absent."""
    folder = Path(os.environ.get("PALPATE_SHARED", ROOT.parent / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip("no shared data: set PALPATE_SHARED, or put it in ../shared beside the project")
    return folder


@pytest.fixture(scope="session", autouse=True)
def titled() -> Iterator[None]:
    """Whatever a command says has a title, and no fact or note lacks its beginning or end."""
    from palpate.console import console

    def checked() -> None:
        said = console._VOICES[-1].output
        assert said["title"] or not any(said.values()), f"no title above {said}"
        for each in (said, *said.get("parts", ())):
            told = [*map(str, each["facts"].values()), *each.get("notes", ()), *each.get("warnings", ())]
            assert all(text == text.strip(" ,;") for text in told), told
        printed()

    printed = console._print_json
    with mock.patch.object(console, "_print_json", checked):
        yield


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """The first worker compiles all modules, and the others wait for it: in a fresh clone each would compile them."""
    file = ROOT / ".cache" / "collecting.lock"
    file.parent.mkdir(exist_ok=True)
    with file.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            fcntl.flock(lock, fcntl.LOCK_SH)
        return (yield)


def pytest_collection_finish() -> None:
    """What was imported and collected is never garbage, and need not be looked through again."""
    gc.enable()
    gc.freeze()


def pytest_runtest_setup() -> None:
    """Each test checks shapes anew."""
    start_counting()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how much was not tried, and why: a green run without shared data, for one, has shown less."""
    reasons = (report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.stats.get("skipped", []))
    for reason, count in Counter(reasons).most_common():
        terminalreporter.write_line(f"{count} skipped: {reason}")
