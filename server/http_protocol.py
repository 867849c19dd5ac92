"""uvicorn's HTTP protocol with limits that hold before anybody has proved anything: head, time, number of connections.

uvicorn alone lets a head grow without end, waits for ever for a request that has begun or has not, and takes connections
until the process has no file left, not even for an e-stop.
"""

from asyncio import TimerHandle, Transport

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from server.crowd import ADMITTED, MAX_CONNECTIONS, make_room

MAX_HEAD_BYTES = 16 * 1024
"""Of request line and headers."""

REQUEST_TIMEOUT_S = 10.0
"""A request has come, with its body, within this after the connection was made or after its own first byte."""

WRITE_PATIENCE_S = 10.0
"""A peer that takes nothing of its answer for this long is let go of."""


class HeadTooLargeError(ValueError):
    """Request line and headers exceed MAX_HEAD_BYTES."""


class GuardedHttpProtocol(HttpToolsProtocol):
    """One connection, until it is upgraded to a websocket."""

    _request_timer: TimerHandle | None = None
    _write_timer: TimerHandle | None = None
    _head_bytes = 0
    _in_head = True
    _in_request = False
    waiting_since_s = 0.0

    def connection_made(self, transport: Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        super().connection_made(transport)
        self.waiting_since_s = self.loop.time()
        self._expect_request()
        if len(self.connections) > MAX_CONNECTIONS:
            make_room(self.connections, self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._request_timer = _cancelled(self._request_timer)
        self._write_timer = _cancelled(self._write_timer)
        # uvicorn forgets it where a peer breaks off: thousands of dead connections, that the garbage collector looks through.
        self.timeout_keep_alive_task = _cancelled(self.timeout_keep_alive_task)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self._in_head:
            self._head_bytes += len(data)
        super().data_received(data)
        if self._in_head and self._head_bytes > MAX_HEAD_BYTES:
            self._refuse_head()
        elif self._in_request and self._request_timer is None:
            self._expect_request()

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self._in_request = True

    def on_headers_complete(self) -> None:
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        if size > MAX_HEAD_BYTES:
            raise HeadTooLargeError  # the parser ends and asks for a 400
        self._in_head = False
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        super().on_message_complete()
        self._request_timer = _cancelled(self._request_timer)
        self._in_request = False
        self._in_head, self._head_bytes = True, 0

    def on_response_complete(self) -> None:
        self.waiting_since_s = self.loop.time()
        super().on_response_complete()

    def send_400_response(self, msg: str) -> None:
        if self._in_head and self._head_bytes > MAX_HEAD_BYTES:
            self._refuse_head()
        else:
            super().send_400_response(msg)

    def handle_websocket_upgrade(self) -> None:
        self._request_timer = _cancelled(self._request_timer)
        super().handle_websocket_upgrade()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._watch_writing()

    def resume_writing(self) -> None:
        self._write_timer = _cancelled(self._write_timer)
        super().resume_writing()

    @property
    def admitted(self) -> bool:
        """See server.crowd.Guest."""
        return self.cycle is not None and not self.cycle.response_complete and ADMITTED in self.cycle.scope.get("state", {})

    def _expect_request(self) -> None:
        self._request_timer = self.loop.call_later(REQUEST_TIMEOUT_S, self.transport.abort)

    def _refuse_head(self) -> None:
        self.transport.write(STATUS_LINE[431] + b"connection: close\r\ncontent-length: 0\r\n\r\n")
        self.transport.close()

    def _watch_writing(self) -> None:
        waiting = self.transport.get_write_buffer_size()

        def look_again() -> None:
            if self.transport.get_write_buffer_size() < waiting:
                self._watch_writing()
            else:
                self.transport.abort()

        self._write_timer = self.loop.call_later(WRITE_PATIENCE_S, look_again)


def _cancelled(timer: TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
