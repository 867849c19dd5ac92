"""What strangers may do to a console: raw bytes, floods of calls and sockets, processes stopped or killed in every order."""

import asyncio
import contextlib
import itertools
import json
import multiprocessing
import os
import random
import signal
import socket
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection

from sim.benchmarks.soak_console import API, SoakConsole

HOST = b"Host: 127.0.0.1\r\n"
PATCH = f"PATCH {API}/command HTTP/1.1\r\n".encode() + HOST + b"Content-Type: application/json\r\n"
MAX_WRENCHES = 64
FLOODERS = 10
MOST_OPEN = 500
WEB_STOPPED_S = 2.0


def raw_sockets(port: int, seed: int, duration_s: float) -> int:
    """Half requests, endless heads, large bodies and random bytes on many connections; returns how many were opened."""
    dice = random.Random(seed)
    with contextlib.ExitStack() as stack:
        opened, end = 0, time.monotonic() + duration_s
        while time.monotonic() < end:
            with contextlib.suppress(OSError):
                connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=2.0))
                opened += 1
                for piece in _nonsense(dice):
                    connection.sendall(piece)
            if opened % MOST_OPEN == MOST_OPEN - 1:
                stack.close()
    return opened


def _nonsense(dice: random.Random) -> Iterator[bytes]:
    kind = dice.randrange(8)
    if kind == 0:
        return
    if kind == 1:
        yield dice.randbytes(dice.randrange(1, 4000))
    elif kind == 2:
        yield b"GET /api/v1/state HTTP/1.1\r\n" + HOST
    elif kind == 3:
        yield b"GET / HTTP/1.1\r\n" + HOST + b"X: "
        yield from itertools.repeat(b"y" * 16_000, 200)
    elif kind == 4:
        yield b"PUT /api/v1/mismatch HTTP/1.1\r\n" + HOST + b"Content-Type: application/json\r\nContent-Length: 3000000\r\n\r\n"
        yield from itertools.repeat(b"[1," * 5000, 200)
    elif kind == 5:
        yield b"GET /api/v1/stream HTTP/1.1\r\n" + HOST + b"Upgrade: websocket\r\nConnection: Upgrade\r\n"
        yield b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + dice.randbytes(16).hex().encode() + b"\r\n\r\n"
    elif kind == 6:
        yield b"POST /api/v1/estop/clear HTTP/1.1\r\n" + HOST + b"Origin: http://[\r\nContent-Length: 0\r\n\r\n"
    else:
        yield b"POST /api/v1/run HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n"


def flood(port: int, seed: int, duration_s: float) -> dict[str, int]:
    """PATCHes from ten clients as fast as they are answered, in a process of its own; how many were answered by status.

    "lost" counts calls without an answer.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_flood, args=(port, seed, duration_s, theirs))
    process.start()
    counts = ours.recv()
    process.join()
    return counts


def _flood(port: int, seed: int, duration_s: float, answer: Connection) -> None:
    answer.send(asyncio.run(_clients(port, seed, duration_s)))


async def _clients(port: int, seed: int, duration_s: float) -> dict[str, int]:
    counts: dict[str, int] = {}
    end = time.monotonic() + duration_s
    await asyncio.gather(*(_patch_on(port, random.Random(seed + client), end, counts) for client in range(FLOODERS)))
    return counts


async def _patch_on(port: int, dice: random.Random, end: float, counts: dict[str, int]) -> None:
    reader = writer = None
    while time.monotonic() < end:
        try:
            if writer is None or reader is None:
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
            body = json.dumps({"force_n": [0.0, 0.0, round(dice.uniform(-5.0, 5.0), 2)]}).encode()
            writer.write(PATCH + b"Content-Length: %d\r\n\r\n" % len(body) + body)
            lines = (await reader.readuntil(b"\r\n\r\n")).decode().lower().splitlines()
            length = next(int(line.split(":")[1]) for line in lines if line.startswith("content-length"))
            await reader.readexactly(length)
            outcome = lines[0].split()[1]
        except (OSError, asyncio.IncompleteReadError):
            reader = writer = None
            outcome = "lost"
        counts[outcome] = counts.get(outcome, 0) + 1


def fill_with_wrenches(console: SoakConsole, duration_s: float) -> int:
    """As many wrenches as are allowed, too weak to move the robot; how many were taken."""
    body = {"force_n": [0.01, 0.0, 0.01], "frame": "heading", "duration_s": max(duration_s, 1.0), "ramp_s": 0.1}
    return sum(console.call("POST", "/wrenches", body).status == 201 for _ in range(MAX_WRENCHES))


def _kill_control(console: SoakConsole) -> None:
    os.kill(console.server.control_pid, signal.SIGKILL)


def _stop_then_kill_control(console: SoakConsole) -> None:
    os.kill(console.server.control_pid, signal.SIGSTOP)
    time.sleep(0.5)
    os.kill(console.server.control_pid, signal.SIGKILL)


def _stop_control_for_a_while(console: SoakConsole) -> None:
    os.kill(console.server.control_pid, signal.SIGSTOP)
    time.sleep(WEB_STOPPED_S)
    os.kill(console.server.control_pid, signal.SIGCONT)


def _stop_web_for_a_while(console: SoakConsole) -> None:
    os.kill(console.server.pid, signal.SIGSTOP)
    time.sleep(WEB_STOPPED_S)
    os.kill(console.server.pid, signal.SIGCONT)


def _stop_web_and_kill_control(console: SoakConsole) -> None:
    os.kill(console.server.pid, signal.SIGSTOP)
    os.kill(console.server.control_pid, signal.SIGKILL)
    os.kill(console.server.pid, signal.SIGCONT)


KILLS: dict[str, Callable[[SoakConsole], None]] = {
    "control killed": _kill_control,
    "control stopped, then killed": _stop_then_kill_control,
    "control stopped for a while": _stop_control_for_a_while,
    "web stopped for a while": _stop_web_for_a_while,
    "web stopped, control killed": _stop_web_and_kill_control,
}
"""After each the console must be used again, after a restart where control was killed."""
