"""The keepalive of operating sockets overrides hooks of uvicorn that are no public interface: they must exist and be called."""

import inspect

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from server.websocket_protocol import ShallowWebSocketProtocol


def test_uvicorn_still_has_every_hook_that_is_overridden() -> None:
    overridden = {
        name for name, value in vars(ShallowWebSocketProtocol).items() if inspect.isfunction(value) and name[0] != "_"
    }
    assert overridden == {"connection_made", "data_received", "handle_connect", "keepalive_timeout"}
    for name in overridden:
        assert inspect.isfunction(getattr(WebSocketsSansIOProtocol, name, None)), f"uvicorn has no {name} any more"


def test_uvicorn_calls_the_keepalive_hook_through_the_timer_that_is_replaced() -> None:
    source = inspect.getsource(WebSocketsSansIOProtocol)
    assert "self.pong_timer = self.loop.call_later(self.ping_timeout, self.keepalive_timeout)" in source
    assert "self.handle_connect(" in source
