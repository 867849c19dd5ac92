"""Before anybody has proved anything: endless heads, requests that never come whole, more connections than files."""

import asyncio
import contextlib
import gc
import inspect
import resource
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from urllib.parse import urlsplit

import httpx
import pytest
from fastapi import FastAPI
from starlette.types import Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from control.paths import ROOT
from server import admission, http_protocol
from server.admission import (
    ALWAYS_SERVED,
    LONGEST_WAIT_S,
    MAX_BURST,
    MAX_CALLS,
    MAX_RATE_HZ,
    MAX_SOCKETS,
    Admission,
    CallRate,
    Turns,
)
from server.crowd import max_connections
from server.http_protocol import MAX_HEAD_BYTES, GuardedHttpProtocol
from server.web_server import uvicorn_config
from tests.server.running_server import RunningServer

HEAD = b"GET /api/v1/state HTTP/1.1\r\nHost: 127.0.0.1\r\n"
PATIENCE_S = 20.0
SHORT_S = 0.3
TOKEN = "correct horse battery"


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)


def ends(connection: socket.socket) -> bool:
    """Whether the server closes the connection; waits for it."""
    try:
        while connection.recv(65536):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


def send_for_ever(connection: socket.socket, piece: bytes, most: int) -> int:
    """Bytes sent until the server would take no more."""
    sent = 0
    try:
        while sent < most:
            connection.sendall(piece)
            sent += len(piece)
    except ConnectionError:
        pass
    return sent


def stops(port: int, **headers: str) -> bool:
    answer = httpx.post(f"http://127.0.0.1:{port}/api/v1/estop", timeout=PATIENCE_S, headers=headers)
    return answer.json() == {"latched": True, "mode": "estop"}


@pytest.mark.parametrize("start", [HEAD + b"X-Endless: ", b"GET /", HEAD], ids=["header", "address", "headers"])
def test_a_head_without_end_is_refused_early(server: RunningServer, start: bytes) -> None:
    piece = b"X: y\r\n" * 2000 if start is HEAD else b"y" * 12_000
    with connect(server.port) as connection:
        connection.sendall(start)
        assert send_for_ever(connection, piece, 40_000_000) < 20_000_000  # the rest did not even fit into buffers
    assert stops(server.port)


def test_a_head_that_is_a_little_too_large_is_told_so(server: RunningServer) -> None:
    with httpx.Client(base_url=server.http.base_url, timeout=PATIENCE_S) as http:
        assert http.get("/api/v1/state", headers={"X": "y" * MAX_HEAD_BYTES}).status_code == 431
        assert http.get("/api/v1/state", headers={"X": "y" * (MAX_HEAD_BYTES // 2)}).status_code == 200


@pytest.mark.parametrize(
    "start",
    [
        b"",
        b"G",
        HEAD,
        b"PUT /api/v1/scene HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n{",
        HEAD + b"\r\n" + HEAD,
    ],
    ids=["nothing", "letter", "head", "body", "second head"],
)
def test_a_request_that_never_comes_whole_is_not_waited_for(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch, start: bytes
) -> None:
    monkeypatch.setattr(http_protocol, "REQUEST_TIMEOUT_S", SHORT_S)
    with connect(server.port) as connection:
        connection.sendall(start)
        assert ends(connection)


def test_a_trickle_is_no_progress(server: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "REQUEST_TIMEOUT_S", SHORT_S)
    with connect(server.port) as connection:
        end = time.monotonic() + PATIENCE_S
        with pytest.raises(ConnectionError):
            while time.monotonic() < end:
                connection.sendall(b"G")
                time.sleep(SHORT_S / 10)


def test_a_call_that_takes_longer_than_its_request_may_is_answered(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "REQUEST_TIMEOUT_S", SHORT_S)
    server.http.post("/api/v1/run", json={"state": "paused"}).raise_for_status()
    ticks = round(4.0 * SHORT_S / 0.002)
    assert server.http.post("/api/v1/step", json={"ticks": ticks}).status_code == 200


def test_an_answer_that_nobody_takes_is_given_up(server: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "WRITE_PATIENCE_S", SHORT_S)
    page = len(server.http.get("/viser/", headers={"Accept-Encoding": "identity"}).content)
    with closing(socket.socket()) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", server.port))
        connection.sendall(20 * (b"GET /viser/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"))
        time.sleep(10.0 * SHORT_S)
        connection.settimeout(PATIENCE_S)
        received = 0
        with contextlib.suppress(ConnectionError):
            while data := connection.recv(65536):
                received += len(data)
    assert received < 10 * page


def dead_connections() -> int:
    """Of all servers in this process."""
    return sum(isinstance(each, GuardedHttpProtocol) and each not in each.connections for each in gc.get_objects())


def test_whoever_breaks_off_after_his_answer_leaves_nothing_behind(server: RunningServer) -> None:
    before = dead_connections()
    for _ in range(20):
        with connect(server.port) as connection:
            connection.sendall(HEAD + b"\r\n")
            assert connection.recv(12) == b"HTTP/1.1 200"
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # ends by a reset
    end = time.monotonic() + uvicorn_config(FastAPI()).timeout_keep_alive / 2.0
    while dead_connections() > before:
        assert time.monotonic() < end
        time.sleep(0.05)


def test_the_newest_gets_in_whoever_waits_longest_goes(server: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "MAX_CONNECTIONS", 20)
    with ExitStack() as stack:
        crowd = [stack.enter_context(closing(connect(server.port))) for _ in range(60)]
        crowd[-1].sendall(HEAD + b"\r\n")
        assert crowd[-1].recv(12) == b"HTTP/1.1 200"
        assert ends(crowd[0])
        assert stops(server.port)


def test_a_call_that_is_being_answered_makes_no_room(server: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "MAX_CONNECTIONS", 20)
    server.http.post("/api/v1/run", json={"state": "paused"}).raise_for_status()
    body = b'{"ticks": 500}'
    with ExitStack() as stack:
        stepping = stack.enter_context(closing(connect(server.port)))
        head = b"POST /api/v1/step HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        stepping.sendall(head + b"Content-Length: %d\r\n\r\n" % len(body) + body)
        server.wait_for(lambda state: state["mode"] == "paused" and state["time_s"] > 0.01)
        for _ in range(60):
            stack.enter_context(closing(connect(server.port)))
        assert stepping.recv(12) == b"HTTP/1.1 200"


@pytest.mark.parametrize(("kind", "most"), [("http", MAX_CALLS), ("websocket", MAX_SOCKETS)])
def test_too_much_at_once_is_refused_but_no_estop(kind: str, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "MAX_BURST", 1e6)
    monkeypatch.setattr(admission, "TURN_S", 0.0)
    served: list[str] = []

    async def stuck(scope: Scope, _: Receive, __: Send) -> None:
        served.append(scope["path"])
        await asyncio.sleep(3600.0)

    async def ask() -> list[Message]:
        guard, answers = Admission(stuck), []

        async def receive() -> Message:
            return {"type": f"{kind}.{'request' if kind == 'http' else 'connect'}"}

        async def answer(message: Message) -> None:
            answers.append(message)

        def call(path: str) -> asyncio.Task[None]:
            extensions = {"websocket.http.response": {}}
            scope = {"type": kind, "path": path, "state": {}, "headers": [], "method": "GET", "extensions": extensions}
            return asyncio.create_task(guard(scope, receive, answer))

        async def let_in(count: int) -> None:
            while len(served) < count:
                await asyncio.sleep(0)

        calls = [call("/api/v1/scene") for _ in range(most)]
        await let_in(most)
        await call("/api/v1/scene")
        calls += [call(path) for path in ALWAYS_SERVED]
        await asyncio.sleep(0)
        for each in calls:
            each.cancel()
        await asyncio.gather(*calls, return_exceptions=True)
        again = call("/api/v1/scene")
        await let_in(most + len(ALWAYS_SERVED) + 1)
        again.cancel()
        return answers

    answers = asyncio.run(ask())
    assert answers[0]["status"] == 429
    assert served == ["/api/v1/scene"] * most + [*ALWAYS_SERVED, "/api/v1/scene"]


def test_one_call_is_worked_on_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "TURN_S", 3600.0)
    turns, at_work, together = Turns(), 0, []

    async def work() -> None:
        nonlocal at_work
        async with turns.turn():
            at_work += 1
            together.append(at_work)
            await asyncio.sleep(0)
            at_work -= 1

    async def crowd() -> None:
        await asyncio.gather(*(work() for _ in range(20)))

    asyncio.run(crowd())
    assert together == [1] * 20


def test_an_estop_waits_for_nobodys_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "TURN_S", 3600.0)
    served: list[str] = []

    async def stuck(scope: Scope, _: Receive, __: Send) -> None:
        served.append(scope["path"])
        await asyncio.sleep(3600.0)

    async def receive() -> Message:
        return {"type": "http.request"}

    async def answer(_: Message) -> None:
        return None

    async def ask() -> None:
        guard = Admission(stuck)
        for path in ("/api/v1/scene", "/api/v1/scene", "/api/v1/estop"):
            scope: Scope = {"type": "http", "path": path, "headers": [], "method": "POST"}
            asyncio.get_running_loop().create_task(guard(scope, receive, answer))
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    asyncio.run(ask())
    assert served == ["/api/v1/scene", "/api/v1/estop"]


def test_a_call_that_waits_lets_the_next_in_even_one_that_it_waits_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "TURN_S", 0.0)
    turns, asked = Turns(), asyncio.Event()

    async def wait() -> None:
        async with turns.turn():
            await asked.wait()

    async def ask() -> None:
        async with turns.turn():
            asked.set()

    async def both() -> None:
        waiting = [asyncio.create_task(wait()) for _ in range(3)]
        await asyncio.sleep(0)
        await ask()
        await asyncio.gather(*waiting)
        async with asyncio.timeout(PATIENCE_S), turns.turn():
            pass  # all turns were given back

    asyncio.run(both())


def test_whoever_waits_for_his_answers_is_slowed_to_the_rate_and_never_refused() -> None:
    now, calls = 0.0, 0
    rate = CallRate(lambda: now)
    while now < 10.0:
        wait_s = rate.wait_s()
        assert wait_s is not None
        now += wait_s + 1e-5
        calls += 1
    assert calls == pytest.approx(10.0 * MAX_RATE_HZ + MAX_BURST, rel=0.01)


def test_of_many_who_do_not_wait_the_rate_is_served_and_the_rest_refused() -> None:
    now = 0.0
    rate = CallRate(lambda: now)
    assert sum(rate.wait_s() is not None for _ in range(3 * int(MAX_BURST))) == MAX_BURST + LONGEST_WAIT_S * MAX_RATE_HZ
    served = 0
    for tick in range(1, 4001):
        now = tick / (4.0 * MAX_RATE_HZ)
        served += rate.wait_s() is not None
    assert served == pytest.approx(1000, abs=1)


def test_a_flood_is_refused_and_the_estop_is_not(server: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "MAX_BURST", 5.0)
    monkeypatch.setattr(admission, "MAX_RATE_HZ", 0.5)  # so that this machine can exceed it
    with ThreadPoolExecutor(8) as pool:
        flood = list(pool.map(lambda _: server.http.get("/api/v1/command").status_code, range(40)))
        assert all(server.http.post("/api/v1/estop/check").status_code == 200 for _ in range(20))
        assert stops(server.port)
    assert set(flood) == {200, 429}


@pytest.fixture
def console() -> Iterator[int]:
    """Port of a console of its own, with a token, that may open 256 files."""
    process = subprocess.Popen(
        [sys.executable, "-m", "server", "--no-browser", "--port", "0", "--token", TOKEN],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (256, 256)),
    )
    assert process.stdout is not None
    yield urlsplit(process.stdout.readline().split()[-1]).port or 0
    process.kill()
    process.communicate()


@pytest.mark.parametrize("said", [b"", HEAD, HEAD + b"Authorization: Bearer wrong\r\n\r\n"], ids=["nothing", "half", "wrong"])
def test_more_connections_than_files_do_not_keep_the_operator_from_stopping(console: int, said: bytes) -> None:
    with ExitStack() as stack:
        for _ in range(400):
            connection = stack.enter_context(closing(connect(console)))
            with contextlib.suppress(ConnectionError):
                connection.sendall(said)
        for _ in range(5):
            assert stops(console, Authorization=f"Bearer {TOKEN}")


def test_one_connection_in_four_files() -> None:
    assert max_connections(1024) == 256
    assert max_connections(256) == 64
    assert max_connections(resource.RLIM_INFINITY) == 256


def test_uvicorn_still_has_every_hook_that_is_overridden() -> None:
    names = {name for name, value in vars(GuardedHttpProtocol).items() if inspect.isfunction(value) and name[0] != "_"}
    assert {"connection_made", "data_received", "on_headers_complete", "on_message_complete", "pause_writing"} <= names
    for name in names:
        assert inspect.isfunction(getattr(HttpToolsProtocol, name, None)), f"uvicorn has no {name} any more"
