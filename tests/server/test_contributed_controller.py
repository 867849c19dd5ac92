"""A contributor's controller that raises in its third second, from the control process to REST."""

import time
from collections.abc import Callable, Iterator

import httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient

from control.pipeline import UnknownNameError
from control.whole_body.controller import Controller, ControllerInput
from server.app import create_app
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.errors import ControlDeadError
from server.operator import Operator
from sim.runtime.session import Session, SessionConfig

SOUND_S = 2.2


class Misshapen:
    """Delegates to a sound controller until its third second."""

    def __init__(self, sound: Controller) -> None:
        self._sound = sound
        self._start_s: float | None = None

    def reset(self) -> None:
        self._sound.reset()

    def step(self, inputs: ControllerInput) -> np.ndarray:
        time_s = inputs.sensor.time_s
        self._start_s = time_s if self._start_s is None else self._start_s
        return self._sound.step(inputs) + np.zeros(22 if time_s - self._start_s < SOUND_S else 21)


def contributed(config: SessionConfig) -> Session:
    """A session as a contributor makes it."""
    session = Session(config)
    session.pipeline.add_controller("mine", Misshapen(session.pipeline.controllers["model_based"]))
    return session


def refused(config: SessionConfig) -> Session:
    """A session whose configuration names what does not exist."""
    raise UnknownNameError("controller", "theirs", ("mine",))


@pytest.fixture
def http() -> Iterator[httpx.Client]:
    launch = ControlLaunch(make_session=contributed)
    client = ControlClient(launch)
    client.start()
    client.wait_ready()
    with TestClient(create_app(Operator(client, launch), viser_port=1), base_url="http://127.0.0.1") as http:
        yield http
    client.close()


def wait_for(http: httpx.Client, condition: Callable[[dict], bool]) -> dict:
    end = time.monotonic() + 40.0
    while not condition(state := http.get("/api/v1/state").json()):
        assert time.monotonic() < end, f"did not happen; the state is {state}"
        time.sleep(0.01)
    return state


def test_rest_shows_the_fault_the_log_the_line_and_another_controller_takes_over(
    http: httpx.Client, capfd: pytest.CaptureFixture[str]
) -> None:
    http.put("/api/v1/controller", json={"name": "mine"}).raise_for_status()
    wait_for(http, lambda state: state["controller"] == "mine" and state["mode"] == "running")
    state = wait_for(http, lambda state: state["mode"] == "fault")
    assert {"CONTROLLER_ERROR", "STALE_TARGETS"} <= {*state["faults"]} == {*state["fault_words"]}
    assert "mine, ValueError: operands could not be broadcast" in state["fault_words"]["CONTROLLER_ERROR"]
    assert "motors are damping only" in state["message"] and "mine" in state["message"]
    assert http.get("/api/v1/health").status_code == 200

    http.put("/api/v1/controller", json={"name": "model_based"}).raise_for_status()
    state = wait_for(http, lambda state: state["mode"] == "running")
    assert state["controller"] == "model_based"
    assert (state["faults"], state["fault_words"], state["message"]) == ([], {}, None)
    logged = capfd.readouterr().err
    assert logged.count("ValueError: operands could not be broadcast together") == 2  # its first line and its traceback
    assert "line" in logged and "self._sound.step(inputs) + np.zeros" in logged


def test_a_refused_construction_says_what_to_do_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    client = ControlClient(ControlLaunch(make_session=refused))
    client.start()
    with pytest.raises(ControlDeadError, match="available: mine"):
        client.wait_ready()
    client.close()
    assert "Traceback" not in capfd.readouterr().err
