"""Who may talk to the server, checked before anything else sees a request or a socket.

- Origin: a browser says which page a request comes from. Sockets and everything that changes state are for our own page.
- Host: without a token only loopback names are served, so that a foreign page whose name resolves to 127.0.0.1
  (DNS rebinding) is refused although its origin and host agree.
- Token: with one set, every request needs it, as `Authorization: Bearer`, `?token=` or the cookie that a page load with
  `?token=` leaves behind (Viser's client cannot be told a token).
"""

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, quote, unquote, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

COOKIE = "forcelens_token"
LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})


def host_name(host: str) -> str:
    """Host name of a Host header, without port and brackets; empty if it has none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def same_origin(origin: str, host: str) -> bool:
    """Whether an Origin header names the very host (with port) that was asked."""
    return urlsplit(origin).netloc.lower() == host.lower() != ""


class AccessControl:
    """ASGI middleware.

    Args:
        app: what is protected.
        token: required of every request, None for none.
    """

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
            return
        if self._token is not None and scope["type"] == "http" and self._token_in_query(scope):
            await self._app(scope, receive, self._with_cookie(send))
            return
        await self._app(scope, receive, send)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if self._token is None and host_name(host) not in LOOPBACK_NAMES:
            return 403, f"this server answers to localhost only, not to {host!r}; to serve other names, start it with --token"
        origin = headers.get("origin")
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changes and origin is not None and not same_origin(origin, host):
            return 403, f"requests from pages of {origin} are refused; use the page of this server"
        if self._token is not None and not self._has_token(scope, headers):
            return 401, "a token is required: send 'Authorization: Bearer TOKEN', or open the page with ?token=TOKEN"
        return None

    def _has_token(self, scope: Scope, headers: Headers) -> bool:
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self._matches(given.strip()):
            return True
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            cookie = None
        return self._token_in_query(scope) or (cookie is not None and self._matches(unquote(cookie.value)))

    def _token_in_query(self, scope: Scope) -> bool:
        return any(map(self._matches, parse_qs(scope["query_string"].decode("latin-1")).get("token", [])))

    def _matches(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    def _with_cookie(self, send: Send) -> Send:
        # Quoted, because a token may hold characters that a cookie may not.
        cookie = f"{COOKIE}={quote(self._token or '', safe='')}; Path=/; HttpOnly; SameSite=Strict"

        async def send_with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).append("set-cookie", cookie)
            await send(message)

        return send_with_cookie


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, message: str) -> None:
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    response = JSONResponse({"detail": message}, status_code=status, headers=headers)
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
