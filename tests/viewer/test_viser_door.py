"""Pages behind their guard, as their owner has them in a real browser; `claims.evidence.guarded` attacks them."""

import re
from collections.abc import Iterator

import pytest

pytest.importorskip("viser")

import viser

from claims.evidence.page_client import fetched
from palpate.errors import InputError
from palpate.surfaces import Sphere
from palpate.viewer import viser_door
from palpate.viewer.guard import Guard
from palpate.viewer.live import LivePage
from tests.support.browser import PATIENCE, opened, until

SMALL = {"width": 240, "height": 240}  # drawn without a graphics card


@pytest.fixture(scope="module")
def tares() -> list[str]:
    return []


@pytest.fixture(scope="module")
def page(tares: list[str]) -> Iterator[LivePage]:
    with LivePage(Sphere(0.05), (), "first", tares.append, host="0.0.0.0", port=0) as made:
        yield made


def _shown(view: object, title: str) -> None:
    """It is connected: what the server says is there, and the browser reports no refusal."""
    view.get_by_text(f"Palpate \u00b7 {title}").first.wait_for()
    view.get_by_role("button", name="Tare").wait_for()
    assert "token" not in view.url


def test_the_owner_notices_nothing(browser: object, page: LivePage, tares: list[str]) -> None:
    """Opened, in a second tab beside a second page of this machine, reloaded; and a tare says where it came from."""
    context = browser.new_context(viewport=SMALL)
    context.set_default_timeout(1e3 * PATIENCE)
    troubles = list[str]()
    context.on("console", lambda line: troubles.append(line.text) if line.type == "error" else None)
    first, second = context.new_page(), context.new_page()
    with LivePage(Sphere(0.05), (), "second", tares.append, port=0) as other:
        first.goto(re.sub(r"//[^:/]+", "//127.0.0.1", page.address))
        _shown(first, "first")
        second.goto(other.address)
        _shown(second, "second")
        second.goto(first.url)
        first.close()
        _shown(second, "first")
        second.reload()
        _shown(second, "first")
    second.get_by_role("button", name="Tare").click()
    until(lambda: tares == ["127.0.0.1"], "no tare")
    assert troubles == []
    context.close()


def test_a_phone_opens_what_is_printed_and_a_stranger_does_not(browser: object, page: LivePage) -> None:
    """Where all addresses are listened at: the one that is printed, and any other of this machine."""
    assert "//0.0.0.0" not in page.address
    elsewhere = re.sub(r"//[^:/]+", "//127.0.0.2", page.address)
    assert [fetched(each)[0] for each in (page.address, elsewhere)] == [200, 200]
    phone = opened(browser, elsewhere, **SMALL, has_touch=True)
    _shown(phone, "first")
    phone.close()
    stranger = browser.new_page()
    answer = stranger.goto(page.address.partition("?")[0])
    assert answer.status == 403
    assert stranger.inner_text("body").startswith("Open the complete address that the command printed")
    stranger.close()


def test_a_cookie_opens_and_the_page_listens_to_no_other_server(page: LivePage) -> None:
    bare, _, token = page.address.partition("?token=")
    status, text = fetched(bare, Cookie=f"palpate_{page.port}={token}")
    assert status == 200
    assert "<script" in text
    assert token not in text


@pytest.mark.parametrize("missing", ["WebsockServer", "_live_connections", "serve"])
def test_a_viser_that_is_built_in_another_way_serves_nothing(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its server is made elsewhere, does not keep its connections, or does not listen by `websockets`."""
    if missing == "WebsockServer":
        monkeypatch.setattr(viser.ViserServer, "__init__", lambda self, *where, **options: None)
    elif missing == "_live_connections":
        made = viser.infra.WebsockServer.__init__

        def init(self: object, *where: object, **options: object) -> None:
            made(self, *where, **options)
            del self._live_connections

        monkeypatch.setattr(viser.infra.WebsockServer, "__init__", init)
    else:
        monkeypatch.setattr(viser.infra.WebsockServer, "_background_worker", lambda self, ready: ready.release())
    with pytest.raises(InputError, match=r"cannot protect its page.*pip"):
        viser_door.listening(Guard("127.0.0.1", "token"), "127.0.0.1", 0)
