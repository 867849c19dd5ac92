"""Wrong tokens are answered ever later, right ones at once, and peace is forgiven."""

import asyncio

import pytest
from starlette.types import Message

import server.access
from server.failed_tries import FIRST_S, FORGET_S, LONGEST_S, FailedTries
from tests.server.asgi_request import HOST, guarded

TOKEN = "correct horse"
WRONG = "wrong horses"


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_delay_grows_to_its_limit_and_shrinks_with_time() -> None:
    clock = Clock()
    tries = FailedTries(clock)
    delays = [tries.delay_s() for _ in range(1000)]
    assert delays[0] == FIRST_S
    assert delays == sorted(delays)
    assert delays[-1] == LONGEST_S
    clock.now += 7 * FORGET_S
    assert tries.delay_s() == FIRST_S, "a flood is not remembered for longer than a minute or so"


@pytest.mark.parametrize("flood", [0, 100])
def test_a_flood_of_guesses_waits_while_the_operator_does_not(flood: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By every way of showing a token, also from the address that the guesses come from."""
    waits: list[float] = []
    release = asyncio.Event()

    async def wait(_receive: object, duration_s: float) -> None:
        waits.append(duration_s)
        await release.wait()

    monkeypatch.setattr(server.access, "_wait_with", wait)
    app = guarded(TOKEN)

    async def ask(headers: list[tuple[bytes, bytes]], query: bytes = b"") -> int:
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": query}
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            return {"type": "http.request", "body": b""}

        await app(scope | {"headers": [(b"host", HOST.encode()), *headers]}, receive, send)
        return sent[0]["status"]

    async def run() -> None:
        bearer = [asyncio.create_task(ask([(b"authorization", f"Bearer {WRONG}{i}".encode())])) for i in range(flood)]
        in_address = [asyncio.create_task(ask([], f"token={WRONG}{i}".encode())) for i in range(flood)]
        await asyncio.sleep(0)
        assert await ask([(b"authorization", f"Bearer {TOKEN}".encode())]) == 200
        assert await ask([], b"token=correct+horse") == 200
        assert await ask([]) == 401, "who shows nothing does not guess"
        assert await ask([(b"cookie", b"forcelens_0=stale")]) == 401
        guesses = [*bearer, *in_address]
        assert not any(guess.done() for guess in guesses)
        assert len(waits) == 2 * flood
        release.set()
        assert {await guess for guess in guesses} <= {401}

    asyncio.run(run())


def test_who_hangs_up_is_not_waited_for() -> None:
    async def receive() -> Message:
        return {"type": "http.disconnect"}

    asyncio.run(asyncio.wait_for(server.access._wait_with(receive, 3600.0), 20.0))
