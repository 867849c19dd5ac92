"""Viser without a port: the only way in is a call from this process.

Viser's own server asks nobody who they are, and offers no other door than a port. It opens that with
`websockets.asyncio.server.serve`, in whose place a `ViserDoor` stands while Viser starts: it takes the function that Viser
answers a connection with, and listens nowhere. Who may connect is up to the caller of `ViserDoor.connect`.
"""

import asyncio
import contextlib
import logging
import threading
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator, Sequence
from types import SimpleNamespace
from typing import Any, TypeVar

import viser
import websockets.asyncio.server
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK

Message = str | bytes
Result = TypeVar("Result")

TO_VISER_CAPACITY = 16
TO_VISITOR_CAPACITY = 1
"""Viser waits while a message is still here, and culls what is superseded meanwhile."""

_log = logging.getLogger(__name__)


class DoorClosedError(RuntimeError):
    """Viser does not run."""


class _Lane:
    """Messages one way, on Viser's event loop. A closed lane still gives what is in it."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._messages: deque[Message] = deque()
        self._closed = False
        self._changed = asyncio.Condition()

    async def put(self, message: Message) -> None:
        async with self._changed:
            await self._changed.wait_for(lambda: self._closed or len(self._messages) < self._capacity)
            if self._closed:
                raise ConnectionClosedOK(None, None)
            self._messages.append(message)
            self._changed.notify_all()

    async def get(self) -> Message:
        async with self._changed:
            await self._changed.wait_for(lambda: self._closed or self._messages)
            if not self._messages:
                raise ConnectionClosedOK(None, None)
            self._changed.notify_all()
            return self._messages.popleft()

    async def close(self) -> None:
        async with self._changed:
            self._closed = True
            self._changed.notify_all()


class Connection:
    """Viser's end: as much of `websockets.asyncio.server.ServerConnection` as Viser uses.

    Attributes:
        subprotocol: the one that Viser chose, None for none.
    """

    def __init__(self, subprotocol: str | None) -> None:
        self.subprotocol = subprotocol
        self.to_viser = _Lane(TO_VISER_CAPACITY)
        self.to_visitor = _Lane(TO_VISITOR_CAPACITY)

    async def recv(self) -> Message:
        """Next message of the visitor.

        Raises:
            ConnectionClosed: either end has closed.
        """
        return await self.to_viser.get()

    async def send(self, message: Message) -> None:
        """Hand a message to the visitor; waits while it has not taken the one before.

        Raises:
            ConnectionClosed: either end has closed.
        """
        await self.to_visitor.put(message)

    async def close(self, _code: int = 1000, _reason: str = "") -> None:
        """End the connection."""
        await self.to_viser.close()
        await self.to_visitor.close()


class Visitor:
    """The other end, for any event loop."""

    def __init__(self, door: "ViserDoor", connection: Connection) -> None:
        self._door = door
        self._connection = connection

    @property
    def subprotocol(self) -> str | None:
        """The one that Viser chose, None for none."""
        return self._connection.subprotocol

    async def send(self, message: Message) -> None:
        """Hand a message to Viser.

        Raises:
            DoorClosedError: the connection has ended.
        """
        await self._until_closed(self._connection.to_viser.put(message))

    async def receive(self) -> Message:
        """Next message of Viser.

        Raises:
            DoorClosedError: the connection has ended.
        """
        return await self._until_closed(self._connection.to_visitor.get())

    async def _until_closed(self, action: Coroutine[Any, Any, Result]) -> Result:
        try:
            return await self._door.call(action)
        except ConnectionClosed:
            raise DoorClosedError("Viser has closed the connection") from None


class ViserDoor:
    """Connections to one Viser server."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._loop_lock = threading.Lock()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._connections: set[Connection] = set()

    @property
    def is_open(self) -> bool:
        """Whether Viser waits for connections here."""
        return self._loop is not None

    @contextlib.asynccontextmanager
    async def serve(
        self,
        handler: Callable[[Connection], Awaitable[None]],
        *_address: Any,
        select_subprotocol: Callable[[Any, Sequence[str]], str | None],
        **_options: Any,
    ) -> AsyncIterator[SimpleNamespace]:
        """What Viser takes for `websockets.asyncio.server.serve`: `handler` is kept, its address and page are not served."""
        self._handler = handler
        self._select_subprotocol = select_subprotocol
        self._loop = asyncio.get_running_loop()
        try:
            yield SimpleNamespace(server=SimpleNamespace(sockets=()))
        finally:
            with self._loop_lock:
                self._loop = None
            for _ in range(2):  # the calls that came before become tasks, and the tasks start
                await asyncio.sleep(0)
            for connection in list(self._connections):
                await connection.close()
            while self._tasks:
                await asyncio.wait(self._tasks)

    @contextlib.asynccontextmanager
    async def connect(self, subprotocols: Sequence[str]) -> AsyncIterator[Visitor]:
        """A connection for as long as the context lasts.

        Raises:
            DoorClosedError: Viser does not run.
        """
        if not self.is_open:
            raise DoorClosedError("Viser does not run")
        connection = Connection(self._select_subprotocol(None, subprotocols))
        try:
            await self.call(self._admit(connection))
            yield Visitor(self, connection)
        finally:
            with contextlib.suppress(DoorClosedError):
                await self.call(connection.close())

    async def call(self, action: Coroutine[Any, Any, Result]) -> Result:
        """Run `action` on Viser's event loop.

        Raises:
            DoorClosedError: Viser does not run.
        """
        with self._loop_lock:
            if self._loop is None:
                action.close()
                raise DoorClosedError("Viser does not run")
            future = asyncio.run_coroutine_threadsafe(self._known(action), self._loop)
        return await asyncio.wrap_future(future)

    async def _known(self, action: Coroutine[Any, Any, Result]) -> Result:
        self._remember(asyncio.current_task())
        return await action

    async def _admit(self, connection: Connection) -> None:
        self._connections.add(connection)
        self._remember(asyncio.create_task(self._answer(connection)))

    async def _answer(self, connection: Connection) -> None:
        try:
            await self._handler(connection)
        except Exception:
            # As the websockets package does: what one visitor sends must not end the others.
            _log.exception("the 3-D scene has dropped a browser")
        finally:
            self._connections.discard(connection)
            await connection.close()

    def _remember(self, task: asyncio.Task[Any] | None) -> None:
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def start_viser(door: ViserDoor, label: str) -> viser.ViserServer:
    """A Viser server that is reached through `door` only.

    Raises:
        RuntimeError: the installed Viser opens its port in another way.
    """
    with _standing_in(door):
        server = viser.ViserServer(host="127.0.0.1", port=0, label=label, verbose=False)
    if not door.is_open:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} opens a port that anyone may use; install the version of pyproject.toml")
    return server


@contextlib.contextmanager
def _standing_in(door: ViserDoor) -> Iterator[None]:
    serve = websockets.asyncio.server.serve
    websockets.asyncio.server.serve = door.serve
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
