"""A contributor's controller that raises in its third second, from the control process to REST."""

import pytest

from control.pipeline import UnknownNameError
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.errors import ControlDeadError
from sim.runtime.simulation import Simulation, SimulationConfig
from tests.misshapen_controller import Misshapen
from tests.server.running_server import RunningServer, running_server

SOUND_S = 2.2


def contributed(config: SimulationConfig) -> Simulation:
    """A session as a contributor makes it."""
    session = Simulation(config)
    session.pipeline.add_controller("mine", Misshapen(session.pipeline.controllers["model_based"], SOUND_S))
    return session


def refused(config: SimulationConfig) -> Simulation:
    """A session whose configuration names what does not exist."""
    raise UnknownNameError("controller", "theirs", ("mine",))


def fail_and_switch(server: RunningServer) -> None:
    """Select the controller with the defect, wait for its fault, and select a sound one."""
    http = server.http
    http.put("/api/v1/controller", json={"name": "mine"}).raise_for_status()
    server.wait_for(lambda state: state["controller"] == "mine" and state["mode"] == "running")
    state = server.wait_for(lambda state: state["mode"] == "fault")
    assert {"CONTROLLER_ERROR", "STALE_TARGETS"} <= {*state["faults"]} == {*state["fault_words"]}
    assert "mine, ValueError: operands could not be broadcast" in state["fault_words"]["CONTROLLER_ERROR"]
    assert "motors are damping only" in state["message"] and "mine" in state["message"]
    assert http.get("/api/v1/health").status_code == 200

    http.put("/api/v1/controller", json={"name": "model_based"}).raise_for_status()
    state = server.wait_for(lambda state: state["mode"] == "running")
    assert state["controller"] == "model_based"
    assert {*state["faults"]} <= {"LOOP_OVERRUNS"}  # a busy machine's own
    assert state["message"] is None


def test_rest_shows_the_fault_the_log_the_line_and_another_controller_takes_over(capfd: pytest.CaptureFixture[str]) -> None:
    # Within the test: what a process writes that a fixture has started is not what capfd reads.
    with running_server(ControlLaunch(make_session=contributed)) as server:
        fail_and_switch(server)
    logged = capfd.readouterr().err
    assert logged.count("Traceback") == 1
    assert "CONTROLLER_ERROR of 'mine'" in logged
    assert "self._sound.step(inputs) + np.zeros" in logged


def test_a_refused_construction_says_what_to_do_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    client = ControlClient(ControlLaunch(make_session=refused))
    client.start()
    with pytest.raises(ControlDeadError, match="available: mine"):
        client.wait_ready()
    client.close()
    assert "Traceback" not in capfd.readouterr().err
