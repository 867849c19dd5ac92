"""Who asks: what a request or a socket shows of its sender, carried by a context variable to wherever its wish is acted on.

Viser's callbacks run in the context in which the browser's socket was opened, so the scene's widgets have a caller as well.
"""

import secrets
from contextvars import ContextVar
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

LEASE_HEADER = "Forcelens-Lease"
"""A script shows the token of its lease here."""


@dataclass(frozen=True, slots=True)
class Caller:
    """One who asks.

    Attributes:
        address: of the other end.
        page: secret of the browser's cookie, None for whatever is no page of ours.
        token: of a lease that is shown, None for none.
    """

    address: str
    page: str | None = None
    token: str | None = None

    @property
    def words(self) -> str:
        """For the log; tells two browsers apart and no secret."""
        kind = "script" if self.page is None else f"page {self.page[:4]}"
        return f"{kind} at {self.address}"


CALLER: ContextVar[Caller] = ContextVar("caller", default=Caller("this process"))  # noqa: B039


def page_cookie_name(host: str) -> str:
    """Name of the cookie that tells browsers apart: one per port, because a browser sends a host's cookies to all of them."""
    try:
        port = urlsplit(f"//{host}").port
    except ValueError:
        port = None
    return f"forcelens_page_{port or 80}"


def new_page_cookie(host: str) -> str:
    """A Set-Cookie header that tells this browser from all others."""
    return f"{page_cookie_name(host)}={secrets.token_urlsafe(18)}; Path=/; HttpOnly; SameSite=Strict"


def caller_of(scope: Scope) -> Caller:
    """Who sends a request or opens a socket."""
    headers = Headers(scope=scope)
    address = (scope.get("client") or ("?",))[0]
    return Caller(address, _page(headers), headers.get(LEASE_HEADER))


def _page(headers: Headers) -> str | None:
    cookies: SimpleCookie = SimpleCookie()
    for header in headers.getlist("cookie"):
        try:
            cookies.load(header)
        except CookieError:
            continue  # another program's on this host
    found = cookies.get(page_cookie_name(headers.get("host", "")))
    return None if found is None else found.value


class CallerContext:
    """ASGI middleware: sets CALLER for what it protects."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            CALLER.set(caller_of(scope))
        await self._app(scope, receive, send)
