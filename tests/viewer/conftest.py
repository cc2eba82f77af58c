"""What tests of pages share: a browser for each file, in which they open their pages."""

from collections.abc import Iterator

import pytest

from tests.support.browser import chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as launched:
        yield launched
