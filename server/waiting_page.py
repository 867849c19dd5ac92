"""What browsers and scripts are told while the first start compiles the control laws: how far it is, and to ask again.

Nothing of the console is loaded by then, so this is the standard library's server, on the console's own socket. It answers
everything alike and knows no secret; whoever asks in between is served by the console, as soon as it is there.
"""

import json
import socket
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

RETRY_S = 1
PATIENCE_S = 2.0
"""For a connection that asks nothing."""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="{retry}"><title>Forcelens starts</title>
<style>body{{font:16px system-ui,sans-serif;max-width:32rem;margin:20vh auto;padding:0 1rem;color:#e6e8eb;background:#14171a}}
progress{{width:100%}}</style></head>
<body><h1>Forcelens starts</h1><p role="status">{text}</p><progress max="{count}" value="{done}">{done} of {count}</progress>
<p>This page opens the console by itself. Later starts take seconds.</p></body></html>
"""


def progress_text(done: int, count: int) -> str:
    """What is going on, in a line."""
    return f"Compiling the control laws, once: {done} of {count}"


class WaitingPage:
    """Serves on a listening socket, which stays open, from the first `tell` until it is closed."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._server: _Server | None = None

    def tell(self, done: int, count: int) -> None:
        """How many laws are compiled, of how many."""
        if self._server is None:
            self._server = _Server(self._listener.dup())
        self._server.progress = done, count

    def __enter__(self) -> "WaitingPage":
        return self

    def __exit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.stop()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(listener.getsockname()[:2], _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.progress = 0, 1
        self._thread = threading.Thread(target=self.serve_forever, args=(0.05,), name="waiting-page", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Accept no more; the other ends of the socket go on."""
        self.shutdown()
        self._thread.join()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: _Server  # type: ignore[assignment]
    timeout = PATIENCE_S

    def _answer(self) -> None:
        done, count = self.server.progress
        text = progress_text(done, count)
        if self.path.startswith("/api/"):
            kind, body = "application/json", json.dumps({"detail": f"Forcelens starts. {text}"})
        else:
            kind, body = "text/html; charset=utf-8", _PAGE.format(text=text, done=done, count=count, retry=RETRY_S)
        self.send_response(HTTPStatus.SERVICE_UNAVAILABLE)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body.encode()))),
            ("Retry-After", str(RETRY_S)),
            ("Cache-Control", "no-store"),
            ("Content-Security-Policy", "default-src 'none'; style-src 'unsafe-inline'"),
            ("X-Content-Type-Options", "nosniff"),
            ("Connection", "close"),
        ):
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body.encode())

    do_GET = do_HEAD = do_POST = do_PUT = do_PATCH = do_DELETE = _answer  # noqa: N815

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: addresses may carry secrets."""
