"""Put viser's server behind a `Guard`, with all that depends on viser's internals; unguarded, nothing is served."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from http import HTTPStatus
from logging import Filter, Logger, LogRecord
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any
from warnings import filterwarnings

import viser
import viser.infra
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosedOK
from websockets.http11 import Request, Response

from palpate.errors import InputError
from palpate.viewer import guard
from palpate.viewer.guard import Guard, Verdict, Widget, WidgetKind, judged

CLIENTS = 16  # browsers at once
PENDING = 64  # connections that have not shown a token yet; one more ends the oldest of them
QUEUED = 4  # frames of a browser that wait
_KINDS: dict[Any, WidgetKind] = {
    viser.GuiButtonHandle: WidgetKind.PRESS,
    viser.GuiButtonGroupHandle: WidgetKind.CHOOSE,
    viser.GuiDropdownHandle: WidgetKind.CHOOSE,
    viser.GuiSliderHandle: WidgetKind.SET,
    viser.GuiCheckboxHandle: WidgetKind.CHECK,
    viser.GuiTextHandle: WidgetKind.WRITE,
}
_ENTER = (
    '<!doctype html><link rel="icon" href="data:,">'  # without one a slow browser asks for /favicon.ico: 404
    '<meta http-equiv="refresh" content="0; url=/"><title>Palpate</title>'
)


def listening(guard: Guard, host: str, port: int) -> viser.ViserServer:
    """Return a started `viser.ViserServer`, which submits every request and every message to the guard.

    Raises:
        InputError: this version of viser cannot be guarded.
    """
    filterwarnings("ignore", r"Queued a \w+ on a closed connection")  # a browser that goes while its page is made
    infra: Any = viser.infra
    server: Any = viser.ViserServer.__new__(viser.ViserServer)
    door = _Door(guard, server)
    try:
        behind = {"_background_worker": _rebound(infra.WebsockServer._background_worker, websockets=door.websockets)}
        made = type("Server", (infra.WebsockServer,), behind)
        begin = _rebound(viser.ViserServer.__init__, infra=_with(infra, WebsockServer=made))
    except (AttributeError, TypeError) as problem:
        raise _unknown() from problem
    begin(server, host, port, label="Palpate", verbose=False)
    inside = (server._websock_server, "_live_connections"), (server.gui, "_gui_input_handle_from_uuid")
    if not door.serving or not all(hasattr(owner, name) for owner, name in inside):
        server.stop()
        raise _unknown()
    return server


def browser_address(server: viser.ViserServer, client: int | None) -> str:
    """Return the IP address of a connected browser, or "a browser that is gone"."""
    inside: Any = server
    connection = inside._websock_server._live_connections.get(client)
    return "a browser that is gone" if connection is None else str(connection.remote_address[0])


class _Door:
    """A guarded replacement of `websockets` for one server.

    Attributes:
        websockets: the module that viser sees.
        serving: True once viser has used it.
    """

    def __init__(self, guard: Guard, server: Any) -> None:
        self._guard, self._server, self.serving = guard, server, False
        self._pending: dict[ServerConnection, None] = {}
        inner = _with(websockets.asyncio.server, serve=self._serve)
        self.websockets = _with(websockets, asyncio=SimpleNamespace(server=inner))

    def _serve(self, *where: Any, process_request: Callable[..., Response | None], **options: Any) -> Any:
        self.serving = True
        logger = Logger("palpate.page")  # of its own, without what others do with theirs
        logger.addFilter(_NoHandshakes())
        options |= {"max_size": guard.LARGEST, "max_queue": QUEUED, "logger": logger}
        options |= {"create_connection": partial(_Connection, self), "server_header": None}
        return websockets.asyncio.server.serve(
            *where, process_request=partial(self._answer, process_request), **options
        )

    def arrived(self, connection: ServerConnection) -> None:
        """Note a connection without a token yet; too many of them end the oldest."""
        self._pending[connection] = None
        while len(self._pending) > PENDING:
            oldest = next(iter(self._pending))
            self.known(oldest)
            oldest.transport.abort()

    def known(self, connection: ServerConnection) -> None:
        """Forget a pending connection: it has shown a token or is gone."""
        self._pending.pop(connection, None)

    def _answer(
        self, viser_answer: Callable[..., Response | None], connection: ServerConnection, request: Request
    ) -> Response | None:
        """Answer a request; None lets a socket be opened."""
        local, port = connection.local_address[:2]
        asked = guard.Request(request.path, request.headers.get_all, local, port)
        if refusal := self._guard.refusal(asked):
            return _response(HTTPStatus.FORBIDDEN, refusal)
        self.known(connection)
        if any(each.lower() == "websocket" for each in request.headers.get_all("Upgrade")):
            return self._answer_socket(connection, request)
        if cookie := self._guard.entering(asked):
            return _response(HTTPStatus.OK, _ENTER, cookie)
        answer = viser_answer(connection, request)
        if answer is not None:
            answer.headers.update(_protection(request.headers["Host"]))
        return answer

    def _answer_socket(self, connection: ServerConnection, request: Request) -> Response | None:
        offered = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
        if [each.strip() for each in offered.split(",")] != [f"viser-v{viser.__version__}"]:
            return _response(HTTPStatus.BAD_REQUEST, "Load the page again: it is of another version.\n")
        if len(connection.server.connections) >= CLIENTS:
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, f"{CLIENTS} browsers show this page already.\n")
        return None

    def judged(self, connection: ServerConnection, raw: object) -> Verdict:
        """Return the verdict on a message of a browser."""
        return judged(raw, partial(self._widget, connection))

    def _widget(self, connection: ServerConnection, name: str) -> Widget | None:
        """Return a widget that this browser sees, by its name; None without one."""
        server = self._server
        open_ones = server._websock_server._live_connections.items()
        client = server.get_clients().get(next((key for key, each in open_ones if each is connection), -1))
        for gui in (server.gui, *(() if client is None else (client.gui,))):
            handle = gui._gui_input_handle_from_uuid.get(name)
            if handle is not None and (kind := _KINDS.get(type(handle))) is not None:
                usable, options = handle.visible and not handle.disabled, getattr(handle, "options", ())
                bounds = (float(handle.min), float(handle.max)) if kind is WidgetKind.SET else ()
                return Widget(kind, usable, tuple(options), *bounds)
        return None


class _Connection(ServerConnection):
    """A connection that passes only allowed messages to viser."""

    def __init__(self, door: _Door, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._door = door

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._door.arrived(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._door.known(self)
        super().connection_lost(exc)

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next allowed message; a hostile one ends the connection."""
        while True:
            raw = await super().recv(decode)
            verdict = self._door.judged(self, raw)
            if verdict is Verdict.TAKE:
                return raw
            if verdict is Verdict.CLOSE:
                raise ConnectionClosedOK(None, None)  # as if the browser had gone


class _NoHandshakes(Filter):
    """A log filter that drops failed handshakes."""

    def filter(self, record: LogRecord) -> bool:
        return not record.getMessage().startswith(("opening handshake failed", "connection rejected"))


def _response(status: HTTPStatus, text: str, cookie: str = "") -> Response:
    body = text.encode()
    headers = Headers({
        "Content-Type": f"text/{'html' if cookie else 'plain'}; charset=utf-8", "Content-Length": str(len(body)),
        "Cache-Control": "no-store", "Connection": "close", "Referrer-Policy": "no-referrer",
    })  # fmt: skip
    if cookie:
        headers["Set-Cookie"] = cookie
    return Response(status.value, status.phrase, headers, body)


def _protection(host: str) -> dict[str, str]:
    """Return headers that keep the page out of foreign frames, and connect it to its server alone."""
    return {
        "Content-Security-Policy": f"frame-ancestors 'none'; connect-src 'self' ws://{host} data: blob:",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
    }


def _with(module: Any, **changed: Any) -> Any:
    """Return a copy of a module's namespace with other values for some names."""
    return SimpleNamespace(**{**vars(module), **changed})


def _rebound(function: Any, **names: Any) -> Any:
    """Return a copy of a function that finds other values under some of its global names.

    Raises:
        InputError: the function uses no such names.
    """
    if not names.keys() <= set(_used(function.__code__)):
        raise _unknown()
    made = FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__, function.__defaults__)
    made.__kwdefaults__ = function.__kwdefaults__
    return made


def _used(code: CodeType) -> Iterator[str]:
    """Yield the names used in a function and those nested in it."""
    yield from code.co_names
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _used(each)


def _unknown() -> InputError:
    return InputError(
        f"viser {viser.__version__} cannot be used: Palpate cannot protect its page.",
        hint="pip install 'viser==1.1.1'",
    )
