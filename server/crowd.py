"""How many connections a process keeps, and who makes room for the newest: whoever has not been let in and waits longest.

So the operator who comes to stop the robot gets in, however many others are there and say nothing, or say the wrong thing.
"""

import math
import resource
from asyncio import Transport
from collections.abc import Iterable
from operator import attrgetter
from typing import Any, Protocol

ADMITTED = "admitted"
"""Key in an ASGI scope's state: access control has let the request in, and it is being answered."""


def max_connections(files: int) -> int:
    """How many are kept by a process that may open so many files: a quarter, as a connection to the scene needs three."""
    return 256 if files == resource.RLIM_INFINITY else min(256, files // 4)


MAX_CONNECTIONS = max_connections(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


class Guest(Protocol):
    """A connection.

    Attributes:
        waiting_since_s: time of the event loop at which it was made, or last answered.
        admitted: a request of it is being answered that has passed access control.
    """

    transport: Transport
    waiting_since_s: float

    @property
    def admitted(self) -> bool: ...


def make_room(connections: Iterable[Any], newest: Guest) -> None:
    """End the connection that waits longest without being admitted, unless there is no other than the newest.

    Args:
        connections: each a Guest; asking for that costs milliseconds a time, and this runs whenever one more comes.
        newest: among them.
    """
    waiting = (guest for guest in connections if not guest.admitted and guest is not newest)
    longest = min(waiting, key=attrgetter("waiting_since_s"), default=None)
    if longest is not None:
        longest.waiting_since_s = math.inf  # it has gone as soon as the event loop gets to it
        longest.transport.abort()
