"""Bodies are small: one that is not is refused when it is about to be read, before anything holds or parses it.

A call that reads no body, such as the e-stop, works whatever is sent along.
"""

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY_BYTES = 16 * 1024


class BodyLimit:
    """ASGI middleware. Reading more than MAX_BODY_BYTES of a request raises a 413 in whoever reads."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        announced = Headers(scope=scope).get("content-length", "0")
        left = MAX_BODY_BYTES

        async def receive_little() -> Message:
            nonlocal left
            if int(announced) > MAX_BODY_BYTES:
                raise _too_large()
            message = await receive()
            left -= len(message.get("body", b""))
            if left < 0:
                raise _too_large()
            return message

        await self._app(scope, receive_little, send)


def _too_large() -> HTTPException:
    return HTTPException(413, f"the body is too large; allowed: {MAX_BODY_BYTES // 1024} KiB")
