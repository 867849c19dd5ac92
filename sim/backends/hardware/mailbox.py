"""The I/O process's own way in, which needs no file, and at once the lock by which one program commands a robot.

It is a Unix socket in Linux' abstract name space, named after the robot's network. A name has one holder on this machine,
whoever he is and wherever he keeps temporary files; the system takes it from a process that dies. Every local user can send to
it, but the kernel says who has: orders are taken from the holder's own user and from root, answers likewise.
"""

import contextlib
import os
import re
import socket
import struct
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.states import DriveState
from sim.backends.protocol import BackendError

ANSWER_PATIENCE_S = 0.01
"""The I/O process answers at its next tick; the asker may be an event loop."""

_CREDENTIALS = struct.Struct("3i")
_ANSWER = struct.Struct("B?")
_LONGEST = 16
_PER_TICK = 16


class Order(StrEnum):
    """What the I/O process is told."""

    ESTOP = "estop"
    END = "end"
    REPORT = "report"


_ORDERS = {order.encode(): order for order in Order}


class Answer(NamedTuple):
    """State of the drives, and whether a control process was heard lately."""

    state: DriveState
    controlled: bool


class Mailbox:
    """Held from construction to `close` or the end of the process.

    Raises:
        BackendError: another process holds it; the message names that process where it can be seen.
    """

    def __init__(self, name: str) -> None:
        self._socket = _socket()
        self._socket.setblocking(False)
        try:
            self._socket.bind(f"\0{name}")
        except OSError:
            self._socket.close()
            raise BackendError(f"{_holder(name)} already commands this robot; end it, or attach to it instead") from None

    def take(self) -> list[tuple[Order, Any]]:
        """Orders that have come, and where each is answered to. Whatever else has come is dropped."""
        orders = []
        for _ in range(_PER_TICK):
            try:
                content, sender = _receive(self._socket)
            except OSError:  # nothing more, as a rule; no failure of the mail may hold up whoever damps the robot
                break
            if content in _ORDERS:
                orders.append((_ORDERS[content], sender))
        return orders

    def answer(self, sender: Any, answer: Answer) -> None:
        """Tell whoever has sent an order what came of it, if he still listens."""
        if sender is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(_ANSWER.pack(*answer), sender)

    def close(self) -> None:
        """Give the name back."""
        self._socket.close()


def mailbox_name(config: HardwareConfig) -> str:
    """One for each network, for all users of this machine."""
    return f"forcelens-lowcmd-{config.base.interface}-{config.base.domain}"


def ask(name: str, order: Order, patience_s: float = ANSWER_PATIENCE_S) -> Answer | None:
    """Send an order; None when no answer comes, because no I/O process runs or because it hangs."""
    with _socket() as asker:
        asker.settimeout(patience_s)
        asker.bind("")  # the system gives it a name for the answer to come to
        try:
            asker.sendto(order.encode(), f"\0{name}")
            state, controlled = _ANSWER.unpack(_receive(asker)[0])
        except (OSError, struct.error):
            return None
    return Answer(DriveState(state), controlled)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
    return made


def _receive(receiver: socket.socket) -> tuple[bytes, Any]:
    """Content and sender of a message; no content if it is a stranger's."""
    content, ancillary, _, sender = receiver.recvmsg(_LONGEST, socket.CMSG_SPACE(_CREDENTIALS.size))
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
            _, user, _ = _CREDENTIALS.unpack(data)
            if user in (os.geteuid(), 0):
                return content, sender
    return b"", None


def _holder(name: str) -> str:
    """In words, the process that holds the name, where this user may see that."""
    rows = (line.split() for line in Path("/proc/net/unix").read_text().splitlines())
    inodes = {fields[6] for fields in rows if fields[-1] == f"@{name}"}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            for descriptor in (process / "fd").iterdir():
                found = re.fullmatch(r"socket:\[(\d+)\]", os.readlink(descriptor))
                if found and found[1] in inodes:
                    return f"process {process.name}"
    return "a process of another user"
