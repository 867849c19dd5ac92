"""How many calls and sockets are served at once. Whoever has passed access control may still be too many, or stuck.

The e-stop is always served.
"""

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from server.crowd import ADMITTED

MAX_CALLS = 128
MAX_SOCKETS = 100
"""Two per browser: state and scene."""

ESTOP_PATH = "/api/v1/estop"


class Admission:
    """ASGI middleware: refuses with 429 what is too much at once."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open = {"http": 0, "websocket": 0}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        kind = scope["type"]
        if kind not in self._open:
            await self._app(scope, receive, send)
            return
        if self._open[kind] >= (MAX_CALLS if kind == "http" else MAX_SOCKETS) and scope["path"] != ESTOP_PATH:
            await _refuse(scope, receive, send)
            return
        scope.setdefault("state", {})[ADMITTED] = True
        self._open[kind] += 1
        try:
            await self._app(scope, receive, send)
        finally:
            self._open[kind] -= 1


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    detail = "too many calls at once; ask again" if scope["type"] == "http" else "too many sockets are open; close some pages"
    response = JSONResponse({"detail": detail}, status_code=429, headers={"Retry-After": "1"})
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
