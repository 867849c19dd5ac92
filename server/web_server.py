"""The web process' two servers: the 3-D scene, which has no port, and uvicorn with everything that browsers reach."""

import gc
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from urllib.parse import quote

import uvicorn
from fastapi import FastAPI

from server.app import create_app
from server.config import ServerConfig
from server.credentials import Credentials, token_bytes
from server.http_protocol import GuardedHttpProtocol
from server.listening import BACKLOG
from server.operator import Operator
from server.page_entry import SECRET
from server.push_test import PushTest
from server.websocket_protocol import ShallowWebSocketProtocol
from web.console import Console

PING_PERIOD_S = 0.5
PING_TIMEOUT_S = 0.9
"""A browser that vanished without a word, perhaps while it pulled at the hand, is let go of within 1.5 s: the sum of both and
of server.websocket_protocol.SECOND_LOOK_S."""

MAX_MESSAGE_BYTES = 64 * 2**20
ACCEPTED_AT_ONCE = 128
"""Connections: so many files may be opened before this process looks at any of them."""


def run_web_server(config: ServerConfig, listener: socket.socket, operator: Operator, announce: Callable[[str], None]) -> None:
    """Serve on `listener` until interrupted; see server.runner.serve."""
    operator.client.wait_ready()
    console = Console(operator, operator.client.live_snapshot, PushTest(operator))
    console.start()
    try:
        credentials = None if config.token is None else Credentials(config.token)
        app = create_app(operator, scene=console.door, credentials=credentials)
        port: int = listener.getsockname()[1]

        def on_started() -> None:
            listener.listen(BACKLOG)  # uvicorn has but one number for both
            announce(page_address(config.host, port, config.token))
            if config.open_browser:
                _open_browser(page_address(config.host, port, None if credentials is None else credentials.issue_ticket()))

        server = _Server(uvicorn_config(app), on_started)
        server.run(sockets=[listener])
    finally:
        console.stop()


def uvicorn_config(app: FastAPI) -> uvicorn.Config:
    """How uvicorn serves the application."""
    return uvicorn.Config(
        app,
        http=GuardedHttpProtocol,
        backlog=ACCEPTED_AT_ONCE,
        log_level="warning",
        log_config=None,
        access_log=False,
        ws=ShallowWebSocketProtocol,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        ws_ping_interval=PING_PERIOD_S,
        ws_ping_timeout=PING_TIMEOUT_S,
        timeout_graceful_shutdown=1,
    )


def page_address(host: str, port: int, secret: str | None) -> str:
    """Address of the page for a browser on this machine.

    Args:
        host: that is bound.
        port: that is bound.
        secret: token or ticket that the address shall carry.
    """
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    host = f"[{host}]" if ":" in host else host
    query = "" if secret is None else f"?{SECRET}={quote(token_bytes(secret), safe='')}"
    return f"http://{host}:{port}/{query}"


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, on_started: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_started = on_started

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        # What is there by now stays: looking through it for garbage again and again held every call up by 0.1 s.
        gc.collect()
        gc.freeze()
        self._on_started()


def _open_browser(address: str) -> None:
    display = sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if display:
        threading.Thread(target=webbrowser.open, args=(address,), name="open-browser", daemon=True).start()
