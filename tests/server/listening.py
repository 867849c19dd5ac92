"""What processes listen on, from Linux' /proc."""

import re
from pathlib import Path
from typing import NamedTuple

_LISTENING = "0A"
_ACCEPTS = 0x10000  # __SO_ACCEPTCON


class Port(NamedTuple):
    """A TCP port and the address it is bound to, one of this machine's."""

    host: str
    number: int


def tcp_ports(pids: set[int]) -> set[Port]:
    """TCP ports on which any of the processes accepts connections."""
    sockets = _sockets(pids)
    ports = set()
    for table, loopback in (("tcp", "127.0.0.1"), ("tcp6", "::1")):
        for fields in _rows(table):
            if fields[3] == _LISTENING and fields[9] in sockets:
                ports.add(Port(loopback, int(fields[1].rsplit(":", 1)[1], 16)))
    return ports


def unix_paths(pids: set[int]) -> set[str]:
    """Names of the Unix sockets on which any of the processes accepts connections; "@..." is open to every local user."""
    sockets = _sockets(pids)
    return {fields[7] for fields in _rows("unix") if int(fields[3], 16) & _ACCEPTS and fields[6] in sockets and len(fields) > 7}


def _rows(table: str) -> list[list[str]]:
    return [line.split() for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]


def _sockets(pids: set[int]) -> set[str]:
    """Inodes of the processes' sockets."""
    links = []
    for pid in pids:
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            try:
                links.append(str(descriptor.readlink()))
            except FileNotFoundError:
                continue  # closed since it was listed
    return {found[1] for link in links if (found := re.fullmatch(r"socket:\[(\d+)\]", link))}
