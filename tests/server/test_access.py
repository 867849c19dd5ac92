"""Origin, host and token rules, on the middleware alone."""

import asyncio
from dataclasses import dataclass
from urllib.parse import urlencode

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message
from starlette.websockets import WebSocket

from server.access import COOKIE, AccessControl
from server.config import ConfigError, ServerConfig

HOST = "127.0.0.1:8080"
PAGE = f"http://{HOST}"
TOKEN = "correct horse; battery"


async def answer(_: Request) -> PlainTextResponse:
    return PlainTextResponse("done")


async def greet(socket: WebSocket) -> None:
    await socket.accept()
    await socket.close()


@dataclass
class Answer:
    """Status (101 for a socket that opened), headers and body."""

    status: int
    headers: dict[str, str]
    body: str


def ask(
    method: str = "GET",
    headers: dict[str, str] | None = None,
    *,
    host: str = HOST,
    query: dict[str, str] | None = None,
    token: str | None = None,
) -> Answer:
    """Send one request through the middleware; method "SOCKET" opens a websocket."""
    app = Starlette(routes=[Route("/", answer, methods=["GET", "POST", "PUT"]), WebSocketRoute("/", greet)])
    raw = [(name.lower().encode(), value.encode()) for name, value in {"Host": host, **(headers or {})}.items()]
    scope = {"path": "/", "headers": raw, "query_string": urlencode(query or {}).encode(), "app": app}
    if method == "SOCKET":
        scope |= {"type": "websocket", "subprotocols": [], "extensions": {"websocket.http.response": {}}}
        incoming = [{"type": "websocket.connect"}]
    else:
        scope |= {"type": "http", "method": method}
        incoming = [{"type": "http.request", "body": b""}]
    sent: list[Message] = []

    async def receive() -> Message:
        return incoming.pop(0)

    async def send(message: Message) -> None:
        sent.append(message)

    asyncio.run(AccessControl(app, token)(scope, receive, send))
    first = sent[0]
    if first["type"] == "websocket.accept":
        return Answer(101, {}, "")
    sent_headers = {name.decode(): value.decode() for name, value in first["headers"]}
    return Answer(first["status"], sent_headers, sent[1]["body"].decode())


@pytest.mark.parametrize(
    ("method", "origin", "status"),
    [
        ("POST", None, 200),
        ("POST", PAGE, 200),
        ("POST", "http://127.0.0.1:8081", 403),
        ("POST", "https://evil.example", 403),
        ("POST", "null", 403),
        ("POST", "http://127.0.0.1.evil.example:8080", 403),
        ("PUT", "http://evil.example:8080", 403),
        ("GET", "https://evil.example", 200),
    ],
)
def test_changes_are_for_our_own_page(method: str, origin: str | None, status: int) -> None:
    headers = {} if origin is None else {"Origin": origin}
    assert ask(method, headers).status == status


@pytest.mark.parametrize("host", ["localhost:1234", "127.0.0.1", "[::1]:8080"])
def test_loopback_names_are_served(host: str) -> None:
    assert ask(host=host).status == 200


@pytest.mark.parametrize("host", ["evil.example:8080", "", "127.0.0.1.evil.example"])
def test_a_rebound_name_is_refused_even_with_a_matching_origin(host: str) -> None:
    refused = ask("POST", {"Origin": f"http://{host}"}, host=host)
    assert refused.status == 403
    assert "--token" in refused.body


@pytest.mark.parametrize("origin", ["https://evil.example", "null"])
def test_sockets_check_the_origin(origin: str) -> None:
    assert ask("SOCKET", {"Origin": origin}).status == 403


@pytest.mark.parametrize("headers", [{}, {"Origin": PAGE}])
def test_sockets_of_scripts_and_of_our_page_open(headers: dict[str, str]) -> None:
    assert ask("SOCKET", headers).status == 101


@pytest.mark.parametrize(
    ("headers", "params", "status"),
    [
        ({}, {}, 401),
        ({"Authorization": "Bearer wrong"}, {}, 401),
        ({"Authorization": f"Basic {TOKEN}"}, {}, 401),
        ({}, {"token": "wrong"}, 401),
        ({"Cookie": f"{COOKIE}=wrong"}, {}, 401),
        ({"Authorization": f"Bearer {TOKEN}"}, {}, 200),
        ({}, {"token": TOKEN}, 200),
    ],
)
def test_a_token_is_required_of_every_request(headers: dict[str, str], params: dict[str, str], status: int) -> None:
    assert ask("GET", headers, query=params, token=TOKEN, host="robot.local:8080").status == status
    assert ask("SOCKET", headers, query=params, token=TOKEN).status == (101 if status == 200 else status)


def test_a_page_load_with_the_token_leaves_a_cookie_that_opens_sockets() -> None:
    cookie = ask(query={"token": TOKEN}, token=TOKEN).headers["set-cookie"]
    pair, *attributes = cookie.split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(attributes)
    assert ask("SOCKET", {"Cookie": pair}, token=TOKEN).status == 101
    assert ask("SOCKET", token=TOKEN).status == 401


def test_a_token_does_not_open_the_door_to_foreign_pages() -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Origin": "https://evil.example"}
    assert ask("POST", headers, token=TOKEN).status == 403


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "robot.local"])
def test_other_addresses_than_loopback_need_a_token(host: str) -> None:
    with pytest.raises(ConfigError, match="FORCELENS_TOKEN"):
        ServerConfig(host=host)
    assert ServerConfig(host=host, token=TOKEN).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.5", "::1", "localhost"])
def test_loopback_needs_none(host: str) -> None:
    assert ServerConfig(host=host).token is None


def test_a_token_that_can_be_guessed_is_refused() -> None:
    with pytest.raises(ConfigError, match="too short"):
        ServerConfig(token="1234")
