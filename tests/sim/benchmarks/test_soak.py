"""What the soak counts."""

import math
import socket
import threading

import pytest

from sim.benchmarks import soak_calls
from sim.benchmarks.soak_attacks import raw_sockets
from sim.benchmarks.soak_calls import Generated, ToolMissingError, generated_calls
from sim.benchmarks.soak_console import call, lies


@pytest.mark.parametrize(("lean_deg", "fallen"), [(0.0, False), (45.0, False), (61.0, True), (90.0, True), (180.0, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_robot_that_leans_beyond_sixty_degrees_has_fallen(lean_deg: float, axis: int, fallen: bool) -> None:
    half = 0.5 * math.radians(lean_deg)
    tilt = [math.cos(half), 0.0, 0.0, 0.0]
    tilt[1 + axis] = math.sin(half)
    yaw = [math.cos(0.7), 0.0, 0.0, math.sin(0.7)]  # turning changes nothing
    w, _, _, z = yaw
    a, b, c, d = tilt
    turned = [w * a - z * d, w * b - z * c, w * c + z * b, w * d + z * a]
    assert lies({"base": {"orientation_wxyz": turned}}) == fallen


def test_where_nothing_is_known_it_has_fallen() -> None:
    assert lies({"base": {"orientation_wxyz": None}})


def test_failures_are_counted_by_their_check() -> None:
    generated = Generated(3, ["not_a_server_error: a", "negative_data_rejection: b", "not_a_server_error: c"])
    assert generated.count("not_a_server_error") == 2


def test_without_its_tool_the_cure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak_calls.shutil, "which", lambda *_, **__: None)
    with pytest.raises(ToolMissingError, match=r"\.\[soak\]"):
        generated_calls(1, 0, 1.0)


def test_a_call_that_nobody_answers_is_lost() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        closer = threading.Thread(target=lambda: listener.accept()[0].close())
        closer.start()
        assert call(port, "POST", "/estop").status == 0
        closer.join()
    assert call(port, "POST", "/estop").status == 0


def test_raw_sockets_end_in_time_whether_anybody_listens_or_not() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=1000) as listener:
        port = listener.getsockname()[1]
        assert raw_sockets(port, seed=1, duration_s=0.05) > 0
    assert raw_sockets(port, seed=1, duration_s=0.05) == 0
