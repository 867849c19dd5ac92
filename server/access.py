"""Who may talk to the server, checked before anything else sees a request or a socket.

- Origin: a browser says which page a request comes from. Sockets and everything that changes state are for our own page.
- Host: without a token only loopback names are served, so that a foreign page whose name resolves to 127.0.0.1
  (DNS rebinding) is refused although its origin and host agree.
- Token: with one set, every request needs it, as `Authorization: Bearer`, `?token=` or the cookie that a page load with
  `?token=` leaves behind (Viser's client cannot be told a token).
"""

import asyncio
import contextlib
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from server.credentials import Credentials
from server.failed_tries import FailedTries
from server.page_entry import is_page_load, page_without_secret, shown_in_address, with_cookie

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

FOREIGN_PAGE = (
    "requests from pages of {origin} are refused, for this server was asked as {host!r}; use its own page. A proxy must pass "
    "the Host and WebSockets on, nginx with: proxy_set_header Host $http_host; "
    'proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";'
)
TOKEN_REQUIRED = (
    "a token is required: open the address that Forcelens printed when it started (it ends with ?token=TOKEN), "
    "or send 'Authorization: Bearer TOKEN'"
)


def host_name(host: str) -> str:
    """Host name of a Host header, without port and brackets; empty if it has none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def same_origin(origin: str, host: str) -> bool:
    """Whether an Origin header names the very host (with port) that was asked."""
    try:
        return urlsplit(origin).netloc.lower() == host.lower() != ""
    except ValueError:
        return False


class AccessControl:
    """ASGI middleware.

    Args:
        app: what is protected.
        credentials: what every request must prove itself by, None for nothing.
    """

    def __init__(self, app: ASGIApp, credentials: Credentials | None) -> None:
        self._app = app
        self._credentials = credentials
        self._failed_tries = FailedTries()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        foreign = self._foreign(scope)
        if foreign is not None:
            await _refuse(scope, receive, send, 403, foreign)
        elif not scope["query_string"].isascii():
            await _refuse(scope, receive, send, 400, "the query holds bytes that an address may not; write them as %XX")
        elif self._credentials is None:
            await self._app(scope, receive, send)
        else:
            await self._with_credentials(self._credentials, scope, receive, send)

    def _foreign(self, scope: Scope) -> str | None:
        """Why the page that asks is none of ours, None if nothing says so."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if self._credentials is None and host_name(host) not in LOOPBACK_NAMES:
            return f"this server answers to localhost only, not to {host!r}; to serve other names, start it with --token-file"
        if scope["type"] == "http" and scope["method"] in SAFE_METHODS:
            return None
        foreign = next((origin for origin in headers.getlist("origin") if not same_origin(origin, host)), None)
        return None if foreign is None else FOREIGN_PAGE.format(origin=foreign, host=host)

    async def _with_credentials(self, credentials: Credentials, scope: Scope, receive: Receive, send: Send) -> None:
        in_address = shown_in_address(scope)
        if any(map(credentials.is_token, in_address)) or (is_page_load(scope) and any(map(credentials.redeem, in_address))):
            app = page_without_secret(scope) if is_page_load(scope) else self._app
            await app(scope, receive, with_cookie(send, credentials))
            return
        headers = Headers(scope=scope)
        as_bearer = _bearer_tokens(headers)
        if credentials.in_cookies(headers.getlist("cookie")) or any(map(credentials.is_token, as_bearer)):
            await self._app(scope, receive, send)
            return
        if in_address or as_bearer:
            await _wait_with(receive, self._failed_tries.delay_s())
        await _refuse(scope, receive, send, 401, TOKEN_REQUIRED)


def _bearer_tokens(headers: Headers) -> list[bytes]:
    pairs = (value.partition(" ") for value in headers.getlist("authorization"))
    return [given.strip(" \t").encode("latin-1") for scheme, _, given in pairs if scheme.lower() == "bearer"]


async def _wait_with(receive: Receive, duration_s: float) -> None:
    """Let a caller wait, as long as it stays."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(duration_s):
            while (await receive())["type"] not in ("http.disconnect", "websocket.disconnect"):
                pass


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, message: str) -> None:
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    response = JSONResponse({"detail": message}, status_code=status, headers=headers)
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
