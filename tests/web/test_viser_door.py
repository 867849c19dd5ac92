"""The only way to Viser: it behaves as the websocket would whose place it takes, and nothing listens beside it."""

import asyncio
import contextlib
import threading
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

import pytest
import viser.infra
import websockets.asyncio.server
from websockets.exceptions import ConnectionClosed

from web.viser_door import TO_VISER_CAPACITY, Connection, DoorClosedError, ViserDoor, Visitor, start_viser

Handler = Callable[[Connection], Awaitable[None]]


class Served:
    """A door that is open on an event loop of its own, as Viser's is."""

    def __init__(self, handler: Handler) -> None:
        self.door = ViserDoor()
        self._handler = handler
        self._opened = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))
        self._thread.start()
        assert self._opened.wait(10.0)

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        async with self.door.serve(self._handler, "127.0.0.1", 0, select_subprotocol=first):
            self._opened.set()
            await self._stop.wait()

    def stop(self) -> None:
        with contextlib.suppress(RuntimeError):  # it has stopped already
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10.0)
        assert not self._thread.is_alive()


def first(_: object, offered: Sequence[str]) -> str | None:
    return offered[0] if offered else None


@pytest.fixture
def serve() -> Iterator[Callable[[Handler], Served]]:
    opened: list[Served] = []

    def start(handler: Handler) -> Served:
        opened.append(Served(handler))
        return opened[-1]

    yield start
    for served in opened:
        served.stop()


def visit(served: Served, action: Callable[[Visitor], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        connection: AbstractAsyncContextManager[Visitor] = served.door.connect(["offered"])
        async with connection as visitor:
            return await action(visitor)

    return asyncio.run(asyncio.wait_for(run(), 20.0))


async def echo(connection: Connection) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            await connection.send(await connection.recv())


def test_messages_keep_their_order_and_their_type(serve: Callable[[Handler], Served]) -> None:
    async def talk(visitor: Visitor) -> list[str | bytes]:
        assert visitor.subprotocol == "offered"
        sent: list[str | bytes] = [str(index) if index % 3 else bytes([index]) for index in range(200)]
        sender = asyncio.create_task(send_all(visitor, sent))
        received = [await visitor.receive() for _ in sent]
        await sender
        assert received == sent
        return received

    async def send_all(visitor: Visitor, messages: list[str | bytes]) -> None:
        for message in messages:
            await visitor.send(message)

    assert len(visit(serve(echo), talk)) == 200


def test_a_visitor_that_does_not_read_makes_viser_wait(serve: Callable[[Handler], Served]) -> None:
    sent = []

    async def flood(connection: Connection) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                await connection.send(b"frame")
                sent.append(None)

    async def dawdle(visitor: Visitor) -> None:
        await visitor.receive()
        for _ in range(50):
            await asyncio.sleep(0.001)
        assert len(sent) <= 2

    visit(serve(flood), dawdle)


def test_a_visitor_that_goes_ends_the_handler_as_a_closed_socket_does_after_all_it_said(
    serve: Callable[[Handler], Served],
) -> None:
    heard, ended = [], threading.Event()

    async def listen(connection: Connection) -> None:
        try:
            while True:
                heard.append(await connection.recv())
        except ConnectionClosed:
            with pytest.raises(ConnectionClosed):
                await connection.send(b"too late")
            ended.set()

    async def speak(visitor: Visitor) -> None:
        for index in range(2 * TO_VISER_CAPACITY):
            await visitor.send(str(index))

    visit(serve(listen), speak)
    assert ended.wait(10.0)
    assert heard == [str(index) for index in range(2 * TO_VISER_CAPACITY)]


@pytest.mark.parametrize("failing", [False, True])
def test_a_handler_that_ends_ends_the_connection_after_its_last_word(serve: Callable[[Handler], Served], failing: bool) -> None:
    async def say_good_bye(connection: Connection) -> None:
        await connection.send("good bye")
        if failing:
            raise ValueError("a message that cannot be read")

    async def hear(visitor: Visitor) -> None:
        assert await visitor.receive() == "good bye"
        with pytest.raises(DoorClosedError):
            await visitor.receive()

    served = serve(say_good_bye)
    visit(served, hear)
    visit(served, hear)


def test_a_closing_server_ends_its_visitors_and_takes_no_more(serve: Callable[[Handler], Served]) -> None:
    served = serve(echo)

    async def stay(visitor: Visitor) -> None:
        waiting = asyncio.create_task(visitor.receive())
        await visitor.send("hello")
        assert await waiting == "hello"
        stopping = asyncio.create_task(asyncio.to_thread(served.stop))
        with pytest.raises(DoorClosedError):
            await visitor.receive()
        await stopping

    visit(served, stay)
    with pytest.raises(DoorClosedError):
        visit(served, stay)
    with pytest.raises(DoorClosedError):
        asyncio.run(ViserDoor().call(asyncio.sleep(0)))


def test_the_real_websockets_server_is_back_once_viser_has_started() -> None:
    before = websockets.asyncio.server.serve
    server = start_viser(ViserDoor(), "test")
    server.stop()
    assert websockets.asyncio.server.serve is before


def test_a_viser_that_opens_a_port_in_another_way_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a later version may; a console must not start behind an open door."""
    real_start = viser.infra.WebsockServer.start
    serve = websockets.asyncio.server.serve

    def start(self: viser.infra.WebsockServer) -> None:
        monkeypatch.setattr(websockets.asyncio.server, "serve", serve)
        real_start(self)

    monkeypatch.setattr(viser.infra.WebsockServer, "start", start)
    with pytest.raises(RuntimeError, match=r"pyproject\.toml"):
        start_viser(ViserDoor(), "test")
