"""The port that the console listens on: taken first, so that a start that cannot work ends at once."""

import ipaddress
import logging
import socket

BACKLOG = 1024
"""Connections that the system keeps until they are accepted. One that finds no room tries again a second later."""

_log = logging.getLogger(__name__)


class PortInUseError(RuntimeError):
    """The port cannot be bound; the message says what to do."""


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; the caller closes it.

    Raises:
        PortInUseError: something else listens there.
    """
    both = _is_every_ipv6_address(host)
    if both and not socket.has_dualstack_ipv6():
        _log.warning("this system serves IPv6 alone at %s; for IPv4 use --host 0.0.0.0", host)
        both = False
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=BACKLOG, dualstack_ipv6=both)
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
