"""How many calls and sockets are served, at once and per second. Whoever has passed access control may still be too many.

The e-stop, and the question whether it may be pressed, are always served.
"""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from server.crowd import ADMITTED

MAX_CALLS = 128
MAX_SOCKETS = 100
"""Two per browser: state and scene."""

MAX_RATE_HZ = 300.0
"""Of all callers together, six per control period. At 500 an e-stop took 17 to 25 ms beside them, at 300 it takes 12."""

MAX_BURST = 100.0
LONGEST_WAIT_S = 0.01
"""Few callers who ask without end are slowed to the rate. Many are refused, so that nobody waits long."""

HOLD_BACK_S = 0.1
"""The answer to a call above the rate is held back, or whoever calls without end would keep us busy with refusals."""

TURN_S = 0.01
"""A call that takes longer waits for something, mostly the control process; the next is let in."""

ALWAYS_SERVED = frozenset({"/api/v1/estop", "/api/v1/estop/check"})


class CallRate:
    """Token bucket.

    Args:
        clock: monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left = MAX_BURST
        self._last_s = clock()

    def wait_s(self) -> float | None:
        """Count a call; how long it waits for its turn, None if that were too long: then it does not count."""
        now = self._clock()
        self._left = min(self._left + (now - self._last_s) * MAX_RATE_HZ, MAX_BURST)
        self._last_s = now
        wait_s = max(1.0 - self._left, 0.0) / MAX_RATE_HZ
        if wait_s > LONGEST_WAIT_S:
            return None
        self._left -= 1.0
        return wait_s


class Turns:
    """One call is worked on at a time, in order.

    More at once would not be served sooner, but they keep event loop and interpreter from an e-stop.
    """

    def __init__(self) -> None:
        self._free = asyncio.Lock()

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for a turn and hold it until the end, or for TURN_S."""
        await self._free.acquire()
        held = True

        def give_back() -> None:
            nonlocal held
            if held:
                held = False
                self._free.release()

        timer = asyncio.get_running_loop().call_later(TURN_S, give_back)
        try:
            yield
        finally:
            timer.cancel()
            give_back()


class Admission:
    """ASGI middleware: refuses with 429 what is too much."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open = {"http": 0, "websocket": 0}
        self._rate = CallRate()
        self._turns = Turns()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        kind = scope["type"]
        if kind not in self._open:
            await self._app(scope, receive, send)
            return
        wait_s: float | None = 0.0
        always = scope["path"] in ALWAYS_SERVED
        if not always:
            if self._open[kind] >= (MAX_CALLS if kind == "http" else MAX_SOCKETS):
                await _refuse(scope, receive, send, "at once")
                return
            wait_s = self._rate.wait_s()
            if wait_s is None:
                await asyncio.sleep(HOLD_BACK_S)
                await _refuse(scope, receive, send, f"per second, more than {MAX_RATE_HZ:g}")
                return
        scope.setdefault("state", {})[ADMITTED] = True
        self._open[kind] += 1
        try:
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            if kind == "websocket" or always:
                await self._app(scope, receive, send)
            else:
                async with self._turns.turn():
                    await self._app(scope, receive, send)
        finally:
            self._open[kind] -= 1


async def _refuse(scope: Scope, receive: Receive, send: Send, too_many: str) -> None:
    socket = scope["type"] == "websocket"
    detail = f"too many sockets {too_many}; close some pages" if socket else f"too many calls {too_many}; ask again"
    response = JSONResponse({"detail": detail}, status_code=429, headers={"Retry-After": "1"})
    if socket:
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
