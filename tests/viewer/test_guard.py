"""Who is let in, and what is taken of what is said: decisions that hold for anything that may be sent."""

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("msgspec")

import msgspec

from palpate.viewer.guard import LARGEST, Guard, Request, Verdict, Widget, WidgetKind, in_url, judged

TOKEN = "h3Kq-0_zYw"
GUARD = Guard("0.0.0.0", TOKEN)
LOCAL, PORT = "192.168.1.5", 8080
HOST = f"{LOCAL}:{PORT}"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0, 0, 3], "fov": 0.8, "near": 0.01, "far": 100,
    "image_height": 800, "image_width": 1280, "look_at": [0, 0, 0], "up_direction": [0.0, 1.0, 0.0],
}  # fmt: skip
WIDGETS = {
    "press": Widget(WidgetKind.PRESS),
    "gone": Widget(WidgetKind.PRESS, usable=False),
    "choose": Widget(WidgetKind.CHOOSE, options=("one", "two")),
    "set": Widget(WidgetKind.SET, low=-1.0, high=2.0),
    "check": Widget(WidgetKind.CHECK),
    "write": Widget(WidgetKind.WRITE),
}
VALUES = st.booleans() | st.integers(-(2**60), 2**60) | st.floats() | st.text(max_size=300) | st.none()


def asked(path: str = "/", local: str = LOCAL, port: int = PORT, **headers: str | list[str]) -> Request:
    """A request; of a header that comes several times a list."""
    lists = {name: [value] if isinstance(value, str) else value for name, value in headers.items()}
    return Request(path, lambda name: lists.get(name, []), local, port)


def said(message: Mapping[str, object]) -> Verdict:
    """What becomes of a message."""
    return judged(msgspec.msgpack.encode(message), WIDGETS.get)


def update(name: str, value: object) -> Verdict:
    """What becomes of a value of a widget."""
    return said({"type": "GuiUpdateMessage", "uuid": name, "updates": {"value": value}})


@pytest.mark.parametrize("host", [HOST, "localhost:8080", "LOCALHOST:8080", "127.0.0.1:8080", "[::1]:8080"])
@pytest.mark.parametrize("with_origin", [False, True])
def test_the_owner_is_let_in_by_address_or_by_cookie(host: str, with_origin: bool) -> None:
    origin = {"Origin": f"http://{host}"} if with_origin else {}
    first = asked(f"/?token={TOKEN}", Host=host, **origin)
    assert GUARD.refusal(first) == ""
    cookie, _, attributes = GUARD.entering(first).partition("; ")
    assert attributes == "Path=/; HttpOnly; SameSite=Strict"
    again = asked("/", Host=host, Cookie=f"other=1; {cookie}", **origin)
    assert GUARD.refusal(again) == ""
    assert GUARD.entering(again) == ""
    assert GUARD.refusal(asked("/", port=8081, Host=host.replace("8080", "8081"), Cookie=cookie)) != ""


@given(st.text(max_size=40) | st.sampled_from(["null", "http://evil.example", f"http://{HOST}.evil.example"]))
def test_no_other_host_and_no_other_origin_is_answered(name: str) -> None:
    """Nor two hosts, nor none."""
    if name.lower() not in (HOST, "localhost:8080", "127.0.0.1:8080", "[::1]:8080"):
        assert GUARD.refusal(asked(f"/?token={TOKEN}", Host=name))
    assert GUARD.refusal(asked(f"/?token={TOKEN}", Host=HOST, Origin=name))
    assert GUARD.refusal(asked(f"/?token={TOKEN}", Host=[HOST, name]))
    assert GUARD.refusal(asked(f"/?token={TOKEN}"))
    assert GUARD.refusal(asked(f"/?token={TOKEN}", Host=HOST, Origin=[f"http://{HOST}", name]))


@given(st.text(max_size=40), st.text(max_size=40))
def test_nothing_but_the_token_opens_and_no_answer_tells_it(query: str, cookie: str) -> None:
    request = asked(f"/?{query}", Host=HOST, Cookie=cookie)
    assert GUARD.refusal(request)
    assert TOKEN not in GUARD.refusal(request)
    for near in (TOKEN[:-1], f"{TOKEN}=", f"{TOKEN}\n", TOKEN.swapcase(), ""):
        assert GUARD.refusal(asked(f"/?token={near}x", Host=HOST, Cookie=f"palpate_8080={near}x; palpate_80={TOKEN}"))


def test_a_name_that_was_listened_at_and_the_port_that_browsers_leave_out_are_known() -> None:
    assert Guard("Robot.local", TOKEN).refusal(asked(f"/?token={TOKEN}", Host="robot.local:8080")) == ""
    assert GUARD.refusal(asked(f"/?token={TOKEN}", port=80, Host=LOCAL, Origin=f"http://{LOCAL}")) == ""
    assert GUARD.refusal(asked(f"/?token={TOKEN}", Host=LOCAL)) != ""
    assert GUARD.refusal(asked(f"/?token={TOKEN}", local="::ffff:10.0.0.2", Host="10.0.0.2:8080")) == ""
    assert [in_url(each) for each in ("fe80::1%eth0", "::1", "10.0.0.2", "robot")] == [
        "[fe80::1]", "[::1]", "10.0.0.2", "robot"
    ]  # fmt: skip


@given(st.binary(max_size=300) | st.text() | st.none())
def test_whatever_comes_has_a_verdict(raw: object) -> None:
    assert judged(raw, WIDGETS.get) is Verdict.CLOSE


@given(st.sampled_from(list(WIDGETS)), VALUES)
def test_a_widget_takes_what_its_kind_takes(name: str, value: object) -> None:
    """And is asked for nothing else: what is no such value ends the connection."""
    fit = {
        "press": value is True,
        "gone": False,
        "choose": value in ("one", "two"),
        "set": type(value) in (int, float) and -1.0 <= value <= 2.0,
        "check": type(value) is bool,
        "write": type(value) is str and len(value) <= 256,
    }[name]
    assert (update(name, value) is Verdict.TAKE) == fit


def test_what_honest_browsers_may_send_too_late_or_too_soon_has_no_effect() -> None:
    assert update("gone", True) is Verdict.IGNORE
    assert update("set", 20.0) is Verdict.IGNORE
    assert update("set", -3) is Verdict.IGNORE
    assert said({**CAMERA, "image_height": 0}) is Verdict.IGNORE
    assert said({**CAMERA, "look_at": [0, 0, 3]}) is Verdict.IGNORE
    assert update("set", float("nan")) is Verdict.CLOSE
    assert update("unknown", True) is Verdict.CLOSE


@given(st.sampled_from(list(CAMERA)), VALUES | st.lists(st.floats(), max_size=4))
def test_a_camera_is_taken_whole_or_not_at_all(name: str, value: object) -> None:
    assert said(CAMERA) is Verdict.TAKE
    assert said({each: CAMERA[each] for each in CAMERA if each != name}) is Verdict.CLOSE
    assert said({**CAMERA, f"{name}_": value}) is Verdict.CLOSE
    if isinstance(value, str | bool | None) or (isinstance(value, float) and not abs(value) < 1e308):
        assert said({**CAMERA, name: value}) is Verdict.CLOSE


@given(st.text(max_size=30).filter(lambda name: name != "value"), VALUES)
def test_no_property_but_the_value_is_set(name: str, value: object) -> None:
    for name_ in (name, "update_cb", "disabled", "sync_cb", "__class__"):
        message = {"type": "GuiUpdateMessage", "uuid": "check", "updates": {name_: value}}
        assert said(message) is Verdict.CLOSE
        assert said({**message, "updates": {"value": True, name_: value}}) is Verdict.CLOSE


def test_a_picture_may_be_large_and_nothing_else() -> None:
    head = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"

    def picture(*sides: int, colours: int = 6) -> Verdict:
        made = head + b"".join(side.to_bytes(4) for side in sides) + bytes([8, colours]) + bytes(LARGEST // 4)
        return said({"type": "GetRenderResponseMessage", "payload": made, "render_uuid": "a"})

    assert picture(1080, 1920) is Verdict.TAKE
    assert picture(60_000, 60_000) is Verdict.CLOSE
    assert picture(0, 1920) is Verdict.CLOSE
    assert picture(1080, 1920, colours=0) is Verdict.CLOSE  # grey: no browser makes one
    assert said({"type": "GetRenderResponseMessage", "payload": b"", "render_uuid": "a"}) is Verdict.TAKE
    assert said({"type": "GetRenderResponseMessage", "payload": b"GIF89a", "render_uuid": "a"}) is Verdict.CLOSE
    assert judged(msgspec.msgpack.encode(CAMERA) + bytes(10_000), WIDGETS.get) is Verdict.CLOSE
