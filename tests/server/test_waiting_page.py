"""What is told while the control laws compile, over real sockets."""

import socket
from collections.abc import Iterator

import httpx
import pytest

from server.listening import listen
from server.waiting_page import WaitingPage


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with listen("127.0.0.1", 0) as listener:
        yield listener


def ask(listener: socket.socket, path: str, method: str = "GET") -> httpx.Response:
    return httpx.request(method, f"http://127.0.0.1:{listener.getsockname()[1]}{path}", timeout=10.0)


def test_a_browser_sees_the_progress_and_asks_again(listener: socket.socket) -> None:
    with WaitingPage(listener) as page:
        page.tell(0, 100)
        assert "0 of 100" in ask(listener, "/").text
        page.tell(37, 100)
        answer = ask(listener, "/?token=secret")
    assert answer.status_code == 503
    assert "Compiling the control laws, once: 37 of 100" in answer.text
    assert 'http-equiv="refresh"' in answer.text
    assert "secret" not in answer.text


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_script_is_told_when_to_ask_again(listener: socket.socket, method: str) -> None:
    with WaitingPage(listener) as page:
        page.tell(1, 2)
        answer = ask(listener, "/api/v1/estop", method)
    assert answer.status_code == 503
    assert answer.headers["Retry-After"] == "1"
    assert "1 of 2" in answer.json()["detail"]


def test_the_console_takes_the_socket_over_even_while_a_connection_is_idle(listener: socket.socket) -> None:
    address = listener.getsockname()
    with WaitingPage(listener) as page, socket.create_connection(address):
        page.tell(1, 2)
        assert ask(listener, "/").status_code == 503
    with socket.create_connection(address) as late:
        served, peer = listener.accept()
        with served:
            assert peer == late.getsockname()


def test_where_nothing_compiles_nothing_is_served(listener: socket.socket) -> None:
    with WaitingPage(listener):
        pass
    with socket.create_connection(listener.getsockname()):
        listener.accept()[0].close()
