"""One request or socket through the access rules alone, with any bytes in it."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import urlencode

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message
from starlette.websockets import WebSocket

from server.access import AccessControl
from server.credentials import Credentials

HOST = "127.0.0.1:8080"
RawHeaders = Sequence[tuple[bytes, bytes]]


@dataclass
class Answer:
    """Status (101 for a socket that opened, 403 for one that was closed instead), headers and body."""

    status: int
    headers: dict[str, str]
    body: str


async def _answer(_: Request) -> PlainTextResponse:
    return PlainTextResponse("done")


async def _greet(socket: WebSocket) -> None:
    await socket.accept()
    await socket.close()


def guarded(token: str | None) -> AccessControl:
    """The rules around an application that answers "done" to everything."""
    methods = ["GET", "POST", "PUT"]
    routes = [Route("/{path:path}", _answer, methods=methods), WebSocketRoute("/{path:path}", _greet)]
    return AccessControl(Starlette(routes=routes), None if token is None else Credentials(token))


def send(app: AccessControl, method: str, path: str, query: bytes, headers: RawHeaders) -> Answer:
    """Send one request; method "SOCKET" opens a websocket. The caller does not wait for an answer that is held back."""
    scope = {"path": path, "headers": list(headers), "query_string": query}
    if method == "SOCKET":
        scope |= {"type": "websocket", "subprotocols": [], "extensions": {"websocket.http.response": {}}}
        incoming = [{"type": "websocket.connect"}, {"type": "websocket.disconnect"}]
    else:
        scope |= {"type": "http", "method": method}
        incoming = [{"type": "http.request", "body": b""}, {"type": "http.disconnect"}]
    sent: list[Message] = []

    async def receive() -> Message:
        return incoming.pop(0)

    async def keep(message: Message) -> None:
        sent.append(message)

    asyncio.run(app(scope, receive, keep))
    first = sent[0]
    if first["type"] == "websocket.accept":
        return Answer(101, {}, "")
    if first["type"] == "websocket.close":
        return Answer(403, {}, "")
    sent_headers = {name.decode(): value.decode() for name, value in first["headers"]}
    return Answer(first["status"], sent_headers, sent[1]["body"].decode())


def ask(
    method: str = "GET",
    headers: Mapping[str, str] | None = None,
    *,
    host: str = HOST,
    query: Mapping[str, str] | None = None,
    token: str | None = None,
    path: str = "/",
) -> Answer:
    """Send one well-formed request to a server with this token."""
    raw = [(name.lower().encode(), value.encode()) for name, value in {"Host": host, **(headers or {})}.items()]
    return send(guarded(token), method, path, urlencode(query or {}).encode(), raw)
