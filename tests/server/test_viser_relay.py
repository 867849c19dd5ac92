"""The relay to the 3-D scene's server, which here sends back what it gets."""

import os

import msgspec
import pytest
from websockets import Subprotocol
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.server.running_server import SCENE_PROTOCOL, RunningServer


def test_text_and_bytes_go_through_unchanged_and_the_subprotocol_is_echoed(server: RunningServer) -> None:
    offered = [Subprotocol("other"), SCENE_PROTOCOL]
    with connect(server.socket_url("/viser"), subprotocols=offered, max_size=None, compression=None) as scene:
        assert scene.subprotocol == SCENE_PROTOCOL
        for message in ("grüße", b"\x00\xff", os.urandom(3_000_000), ""):
            scene.send(message)
            assert scene.recv(20.0) == message


def test_messages_keep_their_order(server: RunningServer) -> None:
    with connect(server.socket_url("/viser"), subprotocols=[SCENE_PROTOCOL]) as scene:
        for index in range(200):
            scene.send(str(index))
        assert [scene.recv(20.0) for _ in range(200)] == [str(index) for index in range(200)]


def test_no_browser_can_open_a_public_tunnel(server: RunningServer) -> None:
    with connect(server.socket_url("/viser"), subprotocols=[SCENE_PROTOCOL]) as scene:
        scene.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        scene.send(b"next")
        assert scene.recv(20.0) == b"next"


def test_foreign_pages_are_refused(server: RunningServer) -> None:
    with pytest.raises(InvalidStatus) as refused, connect(server.socket_url("/viser"), origin="https://evil.example"):  # pyright: ignore[reportArgumentType]
        pass
    assert refused.value.response.status_code == 403
