"""A page that was opened with a secret in its address gets a cookie for it, and an address without."""

from html import escape
from urllib.parse import parse_qsl, quote, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, Response
from starlette.types import Message, Scope, Send

from server.credentials import Credentials

SECRET = "token"
"""Name of the query's parameter."""


def shown_in_address(scope: Scope) -> list[bytes]:
    """What a request gives as `?token=`."""
    # Latin-1 is one character per byte, both ways.
    pairs = parse_qsl(scope["query_string"].decode("latin-1"), encoding="latin-1")
    return [value.encode("latin-1") for name, value in pairs if name == SECRET]


def is_page_load(scope: Scope) -> bool:
    """Whether a browser asks for what it will show with its address."""
    return scope["type"] == "http" and scope["method"] == "GET" and "text/html" in Headers(scope=scope).get("accept", "")


def page_without_secret(scope: Scope) -> Response:
    """Leads a browser to the same page without the secret, and leaves no entry in its history.

    A page, and not a redirect: a browser that comes by a link from elsewhere would follow a redirect without our strict cookie.
    """
    pairs = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True, encoding="latin-1")
    rest = urlencode([(name, value) for name, value in pairs if name != SECRET], encoding="latin-1")
    # Relative, for a proxy may serve us below a path of its own.
    address = f"./{quote(scope['path'].rpartition('/')[2])}{'?' if rest else ''}{rest}"
    refresh = f'<meta http-equiv="refresh" content="0;url={escape(address)}">'
    html = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Forcelens</title>{refresh}</html>'
    return HTMLResponse(html, headers={"Cache-Control": "no-store"})


def with_cookie(send: Send, credentials: Credentials) -> Send:
    """Let the answer leave the cookie."""
    cookie = f"{credentials.cookie_name}={credentials.cookie_value}; Path=/; HttpOnly; SameSite=Strict"

    async def send_with_cookie(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).append("set-cookie", cookie)
        await send(message)

    return send_with_cookie
