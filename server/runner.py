"""Starts and stops the parts in order: port, control process, then the web server beside it."""

import ipaddress
import logging
import socket
from collections.abc import Callable

from server.config import ServerConfig
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.operator import Operator

_log = logging.getLogger(__name__)


class PortInUseError(RuntimeError):
    """The port cannot be bound; the message says what to do."""


def serve(config: ServerConfig, announce: Callable[[str], None]) -> None:
    """Run until interrupted.

    Args:
        config: settings.
        announce: told the page's address once it can be opened.

    Raises:
        PortInUseError: something else listens there.
        ControlDeadError: the control process died while starting.
    """
    with _listen(config.host, config.port) as listener:
        launch = ControlLaunch(session=config.session)
        client = ControlClient(launch)
        operator = Operator(client, launch, config.hardware, config.recordings)
        client.start()
        try:
            # Takes a second to import, in which the control process starts.
            from server.web_server import run_web_server

            run_web_server(config, listener, operator, announce)
        finally:
            operator.close()


def _listen(host: str, port: int) -> socket.socket:
    both = _is_every_ipv6_address(host)
    if both and not socket.has_dualstack_ipv6():
        _log.warning("this system serves IPv6 alone at %s; for IPv4 use --host 0.0.0.0", host)
        both = False
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=128, dualstack_ipv6=both)
    except OSError as error:
        raise PortInUseError(
            f"cannot listen on {host} port {port}: {error.strerror}. Is Forcelens running already? "
            f"Stop it, or choose another port with --port (0 takes a free one)."
        ) from None


def _is_every_ipv6_address(host: str) -> bool:
    """Whether this is `::`, however it is written. Every address of IPv4 is meant too."""
    try:
        return ipaddress.IPv6Address(host).is_unspecified
    except ValueError:
        return False
