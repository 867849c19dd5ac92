"""Bytes that no browser sends, on the wire: the server refuses them or serves on, and never fails."""

import socket

import pytest

from tests.server.running_server import RunningServer

ODD = [b"http://[", b"[", b"\xff\xfe", b"http://\xe2\x84\xa8", b'"', b"a=b;;=", b"%", b"://", b"\t", b"viser-v\xff"]
NAMES = [b"Host", b"Origin", b"Cookie", b"Authorization", b"Accept", b"Content-Type", b"Sec-WebSocket-Protocol"]
QUERIES = [b"\xff", b"%ff", b"token=%", b"token=\x80", b"&&=", b"rate_hz=%5B", b"fields=%00", b"[", b"%5B%"]
PATHS = [b"/", b"/viser", b"/viser/", b"/static/main.js", b"/static", b"/docs/", b"/api/v1/state", b"/api/v1/estop/check"]
UPGRADE = (
    b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)


def status(server: RunningServer, start: bytes, *headers: bytes) -> int:
    """Status of the answer to a request."""
    request = start + b" HTTP/1.1\r\n" + b"".join(headers) + b"\r\n"
    with socket.create_connection(("127.0.0.1", server.port), timeout=20.0) as connection:
        connection.sendall(request)
        first = connection.makefile("rb").readline()
    assert first, f"closed without an answer: {request}"
    return int(first.split()[1])


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", NAMES)
def test_odd_headers(server: RunningServer, name: bytes, odd: bytes) -> None:
    host = b"" if name == b"Host" else b"Host: localhost\r\n"
    for method, rest in ((b"GET", b""), (b"POST", b"Content-Length: 0\r\n"), (b"GET", UPGRADE)):
        for path in (b"/viser", b"/api/v1/stream", b"/api/v1/estop/check"):
            answered = status(server, method + b" " + path, host, name + b": " + odd + b"\r\n", rest)
            assert answered < 500
            if rest and name in (b"Host", b"Origin"):
                assert answered >= 400 or not odd.strip()


@pytest.mark.parametrize("query", QUERIES)
def test_odd_queries(server: RunningServer, query: bytes) -> None:
    for path in PATHS:
        for upgrade in (b"", UPGRADE):
            assert status(server, b"GET " + path + b"?" + query, b"Host: localhost\r\n", upgrade) < 500


def test_a_handshake_that_is_too_much_is_not_kept_waiting(server: RunningServer) -> None:
    many = b"".join(b"X-%d: y\r\n" % index for index in range(200))
    for extra in (many, b"X: " + b"y" * 20_000 + b"\r\n"):
        assert 400 <= status(server, b"GET /viser", b"Host: localhost\r\n", extra, UPGRADE) < 500
