"""What tests of pages share: one browser, which each opens its pages in."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.browser import chromium


@pytest.fixture(scope="package")
def browser() -> Iterator[object]:
    with chromium() as launched:
        yield launched
