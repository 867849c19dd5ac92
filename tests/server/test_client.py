"""The client and its examples against a live console."""

import http.server
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from control.paths import ROOT
from server.client import (
    Console,
    InvalidFieldError,
    MissingError,
    NotPermittedError,
    RefusedError,
    UnreachableError,
    WaitTimeoutError,
    _error,
)
from server.examples import compare_estimators, lead, press, two_operators, watch
from server.lease import LIFE_S
from tests.server.running_server import RunningServer

EXAMPLES = (press.press, compare_estimators.compare_estimators, lead.lead, watch.watch, two_operators.two_operators)


@pytest.fixture
def console(server: RunningServer) -> Iterator[Console]:
    with Console(f"http://127.0.0.1:{server.port}") as console:
        console.select(scene="free")
        console.pause()
        yield console


def test_it_needs_nothing_but_numpy_and_websockets() -> None:
    heavy = {"fastapi", "pydantic", "uvicorn", "mujoco", "pinocchio", "viser", "control", "sim", "web", "matplotlib", "scipy"}
    code = f"import sys, server.client; assert not {heavy} & set(sys.modules), sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.__name__)
def test_examples_draw_what_happens(console: Console, example: object, tmp_path: Path) -> None:
    assert callable(example)
    picture = tmp_path / "picture.png"
    example(console, picture)
    from matplotlib.image import imread

    drawn = imread(picture)
    assert min(drawn.shape[:2]) > 300
    assert 0.02 < (drawn[..., :3] < 0.95).any(axis=2).mean() < 0.5, "lines on an empty ground"
    assert console.call("GET", "lease")["operator"] is None
    assert console.state().mode != "estop"


def test_a_step_answers_with_the_state_after_it(console: Console) -> None:
    console.reset(seed=3)
    before = console.step(1)
    after = console.step(25)
    assert after.time_s == pytest.approx(before.time_s + 0.05)
    assert after.hand_position_m.shape == after.base_position_m.shape == (3,)
    assert set(after.force_estimates_n) == {entry["name"] for entry in console.call("GET", "estimator")["available"]}
    console.reset(seed=3)
    console.step(1)
    assert console.step(25)["joints"] == after["joints"], "the same seed leads to the same state"


def test_a_wrench_lasts_as_long_as_its_context(console: Console) -> None:
    with console.wrench([0.0, 0.0, 10.0]):
        pressed = console.step(5)
    np.testing.assert_allclose(pressed.force_true_n, [0, 0, 10], atol=1e-6)
    np.testing.assert_allclose(console.step(5).force_true_n, 0.0, atol=1e-6)
    assert console.call("GET", "wrenches") == []
    with console.wrench([0.0, 0.0, 10.0], duration_s=0.004):  # expires before
        console.step(5)


def test_refusals_are_exceptions_with_the_words_of_the_console(console: Console) -> None:
    with pytest.raises(InvalidFieldError, match="-40 to 40 N") as invalid:
        console.command(force_n=np.array([0.0, 0.0, 55.0]))
    assert invalid.value.fields == ("force_n[2]",)
    with pytest.raises(MissingError):
        console.call("DELETE", "wrenches/999")
    with pytest.raises(MissingError):
        console.call("GET", "nothing")
    console.run()
    with pytest.raises(RefusedError, match="paused"):
        console.step(1)
    console.estop()
    with pytest.raises(RefusedError, match="e-stop"):
        console.command(guidance=True)
    console.clear_estop()
    with pytest.raises(WaitTimeoutError, match="did not happen within"):
        console.wait_until(lambda state: state.time_s > 1e6, timeout_s=0.1)
    with pytest.raises(InvalidFieldError, match="nonsense"):
        next(console.stream(fields=["nonsense"]))
    assert isinstance(_error(401, b'{"detail": "a token is required"}'), NotPermittedError)
    assert "teapot" in str(_error(418, b"teapot"))


def test_the_stream_carries_what_was_asked_for(console: Console) -> None:
    console.run()
    times = []
    for state in console.stream(100, ["odometry"]):
        times.append(state.time_s)
        assert "joints" not in state.sections and state["odometry"]["sigma_m"] >= 0.0
        if len(times) == 5:
            break
    assert times == sorted(set(times))


def test_a_lease_is_kept_while_its_context_lasts_and_then_given_back(console: Console, server: RunningServer) -> None:
    with console.lease("script"):
        for _ in range(2):
            time.sleep(0.6 * LIFE_S)
            assert server.http.get("/api/v1/lease").json()["operator"] == "script"
        console.command(guidance=False)
        with Console(console.address) as other, pytest.raises(RefusedError, match="script drives"), other.lease("other"):
            pass
    assert server.http.get("/api/v1/lease").json()["operator"] is None


def unreachable() -> Iterator[tuple[str, str]]:
    """Addresses at which there is no console, and what kind each is of."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = probe.getsockname()[1]
    yield f"http://127.0.0.1:{free}", "nobody"
    with socket.create_server(("127.0.0.1", 0)) as silent:
        yield f"http://127.0.0.1:{silent.getsockname()[1]}", "silent"
    web = http.server.HTTPServer(("127.0.0.1", 0), http.server.SimpleHTTPRequestHandler)
    thread = threading.Thread(target=web.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{web.server_port}", "another server"
    web.shutdown()
    thread.join()
    web.server_close()
    yield "http://no-such-host.invalid", "no such host"


def test_a_wrong_address_fails_soon_with_the_cure() -> None:
    for address, kind in unreachable():
        started_s = time.monotonic()
        with pytest.raises((UnreachableError, MissingError), match="forcelens"):
            Console(address, timeout_s=1.0)
        assert time.monotonic() - started_s < 5.0, kind
