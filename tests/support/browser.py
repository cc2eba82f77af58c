"""Debian's chromium for tests of pages."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic, sleep

import pytest

CHROMIUM = shutil.which("chromium")
FLAGS = [
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--no-first-run"),
]
PATIENCE = 180.0  # s: without a graphics card, on a busy machine, the first picture may take most of it


@contextmanager
def chromium() -> Iterator[object]:
    """Launched; the test skips where there is none, and fails in CI."""
    if CHROMIUM is None:
        if os.environ.get("CI"):
            pytest.fail("no chromium to open the page in: `make browser` installs Debian's")
        pytest.skip("no chromium to open the page in: `make browser` installs Debian's")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield launched
        launched.close()


def opened(browser: object, address: str, width: int, height: int, **options: object) -> object:
    """A page of that size [px]."""
    page = browser.new_page(viewport={"width": width, "height": height}, **options)
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(address)
    return page


def until(true: Callable[[], object], what: str) -> None:
    """Wait for it."""
    end = monotonic() + PATIENCE
    while not true():
        assert monotonic() < end, what
        sleep(0.1)
