"""Starts and stops the parts in order: port, control process, then the web server beside it."""

import signal
import socket
import sys
from collections.abc import Callable
from types import FrameType

from server.config import ServerConfig
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.operator import Operator


class PortInUseError(RuntimeError):
    """The port cannot be bound; the message says what to do."""


def serve(config: ServerConfig, announce: Callable[[str], None]) -> None:
    """Run until interrupted or terminated.

    Args:
        config: settings.
        announce: told the page's address once it can be opened.

    Raises:
        PortInUseError: something else listens there.
        ControlDeadError: the control process died while starting.
    """
    # uvicorn raises a signal again after its own shutdown; by default SIGTERM would then end us before ours.
    signal.signal(signal.SIGTERM, _exit)
    with _listen(config.host, config.port) as listener:
        launch = ControlLaunch(session=config.session)
        client = ControlClient(launch)
        operator = Operator(client, launch, config.hardware)
        client.start()
        try:
            # Takes a second to import, in which the control process starts.
            from server.web_server import run_web_server

            run_web_server(config, listener, operator, announce)
        finally:
            operator.close()


def _exit(_signal: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise PortInUseError(
            f"cannot listen on {host} port {port}: {error.strerror}. Is Forcelens running already? "
            f"Stop it, or choose another port with --port (0 takes a free one)."
        ) from None
