"""uvicorn's websocket protocol with small send buffers, so that a slow reader skips snapshots instead of queueing them.

A reader of the stream may also be slow to answer pings; only the sockets that operate the robot must answer at once.
A handshake that cannot be read is refused here: uvicorn would keep its connection for ever, or fail on it.
"""

import socket
from asyncio import BaseTransport, Transport
from http import HTTPStatus
from typing import cast

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

SEND_BUFFER_BYTES = 16 * 1024
READER_PATH = "/api/v1/stream"
READER_PING_TIMEOUT_S = 60.0
SECOND_LOOK_S = 0.1


class ShallowWebSocketProtocol(WebSocketsSansIOProtocol):
    """Sending waits once `SEND_BUFFER_BYTES` are neither sent nor received."""

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        self.waiting_since_s = self.loop.time()
        cast(Transport, transport).set_write_buffer_limits(high=SEND_BUFFER_BYTES)
        connection = transport.get_extra_info("socket")
        if connection is not None and hasattr(socket, "TCP_NOTSENT_LOWAT"):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, SEND_BUFFER_BYTES)

    @property
    def admitted(self) -> bool:
        """See server.crowd.Guest."""
        return self.handshake_complete

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.conn.handshake_exc is not None and not self.handshake_initiated:
            self._refuse()

    def handle_connect(self, event: Request) -> None:
        if not all(map(str.isascii, (event.path, *event.headers.get_all("Sec-WebSocket-Protocol")))):
            self._refuse()
            return
        if event.path.partition("?")[0] == READER_PATH:
            self.ping_timeout = READER_PING_TIMEOUT_S
        super().handle_connect(event)

    def _refuse(self) -> None:
        self.handshake_initiated = self.handshake_complete = self.close_sent = True
        refusal = self.conn.reject(HTTPStatus.BAD_REQUEST, "this handshake is too long or holds bytes that it may not\n")
        self.transport.write(refusal.serialize())
        self.transport.close()

    def keepalive_timeout(self) -> None:
        # This loop may itself have been held up, with the answer still unread.
        self.pong_timer = self.loop.call_later(SECOND_LOOK_S, self._give_up)

    def _give_up(self) -> None:
        super().keepalive_timeout()
        # Closing alone would wait until the vanished peer has taken what is still buffered.
        self.transport.abort()
