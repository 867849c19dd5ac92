"""Headers that tell a browser to keep our pages to themselves."""

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SCENE_PATH = "/viser/"
"""The one page that stands in a frame, of our own."""


class SecurityHeaders:
    """ASGI middleware: no page of others may frame ours, guess at the type of what we send, or learn our addresses.

    Args:
        app: whose answers get them.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                headers = MutableHeaders(scope=message)
                framed = scope["path"] == SCENE_PATH
                headers["Content-Security-Policy"] = "frame-ancestors 'self'" if framed else "frame-ancestors 'none'"
                headers["X-Frame-Options"] = "SAMEORIGIN" if framed else "DENY"
                headers["X-Content-Type-Options"] = "nosniff"
                # To ourselves it stays: without any, a browser withholds the origin of some requests too.
                headers["Referrer-Policy"] = "same-origin"
            await send(message)

        await self._app(scope, receive, send_with_headers)
