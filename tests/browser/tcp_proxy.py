"""A TCP relay to a local port whose connections a test can cut or let fall silent, as a failing network does."""

import contextlib
import socket
import threading
from types import TracebackType

SMALL_BUFFER_BYTES = 32 * 1024
"""What a silent connection still swallows: little, as when nobody acknowledges."""


class TcpProxy:
    """Relays connections to 127.0.0.1:`target_port` while `up`."""

    def __init__(self, target_port: int) -> None:
        self._target_port = target_port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = []
        self._flowing = threading.Event()
        self._flowing.set()
        self.up = True
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def address(self) -> str:
        """Where a browser connects."""
        return f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def cut(self) -> None:
        """Break every connection and accept no more."""
        self.up = False
        for each in self._sockets:
            _close(each)
        self._sockets.clear()

    def silence(self) -> None:
        """Pass nothing on any more, with every connection left open."""
        self._flowing.clear()

    def mend(self) -> None:
        """Accept connections again and pass on what they say."""
        self.up = True
        self._flowing.set()

    def __enter__(self) -> "TcpProxy":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.cut()
        _close(self._listener)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                if not self.up:
                    _close(near)
                    continue
                far = socket.socket()
                far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER_BYTES)
                far.connect(("127.0.0.1", self._target_port))
                self._sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._copy, args=(source, sink), daemon=True).start()

    def _copy(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._flowing.wait()
                sink.sendall(data)
        _close(source)
        _close(sink)


def _close(each: socket.socket) -> None:
    with contextlib.suppress(OSError):
        each.shutdown(socket.SHUT_RDWR)
    each.close()
