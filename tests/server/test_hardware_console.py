"""A console as people run it drives an emulated robot over its wire; whoever is killed, the motors end up damped.

Runs in real time, so nothing is asserted about durations; `python -m sim.benchmarks.hardware_link` measures them.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest

from sim.emulator.process import EmulatorProcess
from tests.console_process import ConsoleProcess
from tests.dds_domain import dds_domain
from tests.server.contract import check_answer

pytestmark = [pytest.mark.hardware, pytest.mark.realtime]
PATIENCE_S = 40.0
ONWARD = {"observe": "engage", "damped": "stand", "ready": "start", "fault": "clear"}
"""What leads on from a state of the drives."""

STIFF = ("standing_up", "ready")
"""A slow look may miss the first."""


def eventually(condition: Callable[[], Any], what: str, told: Callable[[], Any] = str) -> None:
    """Wait until `condition`; `told()` is what a failure shows beside `what`."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"never happened: {what} {told()}"
        time.sleep(0.02)


class Console(ConsoleProcess):
    """A console, and its REST interface."""

    def __init__(self, *arguments: str) -> None:
        super().__init__(*arguments)
        self.http = httpx.Client(base_url=f"{self.address}/api/v1/", timeout=60.0, event_hooks={"response": [check_answer]})

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        response = self.http.request(method, path, json=body)
        assert response.is_success, response.text
        return response.json()

    def drives(self) -> str:
        return self.call("GET", "hardware")["state"]

    def connect(self) -> None:
        self.call("PUT", "backend", {"name": "hardware", "options": {"dry_run": False}})

    def lead_to(self, *goals: str) -> None:
        """Ask for what leads on, again where a busy machine made the drives damp, until they are in one of these states."""

        def reached() -> bool:
            hardware = self.call("GET", "hardware")
            if hardware["state"] in goals:
                return True
            request = ONWARD.get(hardware["state"])
            if request in hardware["requests"] and not hardware["engaging"]:
                self.http.post("hardware", json={"request": request})
            return False

        eventually(reached, f"the drives are {' or '.join(goals)}", lambda: self.call("GET", "hardware"))

    def close(self) -> None:
        self.http.close()
        super().close()


@pytest.fixture
def robot() -> Iterator[EmulatorProcess]:
    with dds_domain() as domain:
        robot = EmulatorProcess(domain)
        yield robot
        robot.close()


@pytest.fixture
def start(robot: EmulatorProcess) -> Iterator[Callable[[], Console]]:
    consoles: list[Console] = []

    def start() -> Console:
        consoles.append(Console(*robot.arguments))
        return consoles[-1]

    yield start
    for console in consoles:
        console.close()


def await_damping(robot: EmulatorProcess) -> None:
    """Until the robot obeys frames, not its own time-out, that carry damping and no stiffness."""

    def damps() -> bool:
        before, after = robot.report(), robot.report()
        fresh = after["frames_obeyed"] > before["frames_obeyed"] or after["time_s"] == before["time_s"]
        return fresh and after["stiffness_max"] == 0.0 and after["damping_min"] > 0.0

    eventually(damps, "damping on the wire")
    obeyed = robot.report()["frames_obeyed"]
    eventually(lambda: robot.report()["frames_obeyed"] > obeyed + 20, "damping goes on")


def stiff(robot: EmulatorProcess) -> bool:
    return robot.report()["stiffness_max"] > 10.0


def test_whoever_is_killed_the_robot_is_damped(start: Callable[[], Console], robot: EmulatorProcess) -> None:
    console = start()
    console.connect()
    for goal in ("damped", "ready", "policy"):
        console.lead_to(goal)
    eventually(lambda: stiff(robot), "it stands by the controller")

    refused = console.http.put("backend", json={"name": "simulation"})
    assert refused.status_code == 409 and "sit or damp it first" in refused.json()["detail"]
    for method, path, body in (
        ("POST", "run", {"state": "paused"}),
        ("POST", "step", {"ticks": 1}),
        ("POST", "reset", {}),
        ("PUT", "scene", {"name": "box"}),
        ("PUT", "mismatch", {"mass_scale": 1.1}),
        ("POST", "wrenches", {"force_n": [1, 0, 0], "frame": "world", "duration_s": 1.0}),
        ("POST", "hardware", {"request": "engage"}),
    ):
        response = console.http.request(method, path, json=body)
        assert response.status_code == 409 and response.json()["detail"], path
    assert console.call("GET", "state")["end_effector"]["force_true_n"] is None
    assert console.call("GET", "mismatch")["mass_scale_true"] is None

    os.kill(console.control_pid(), signal.SIGKILL)
    await_damping(robot)
    eventually(lambda: "CONTROL_PROCESS_DEAD" in console.call("GET", "state")["faults"], "it is noticed")
    assert console.drives() == "fault"  # read from the I/O process, which lives
    assert console.call("POST", "estop") == {"latched": True, "mode": "fault"}
    assert "e-stop" in console.call("GET", "hardware")["faults"]
    console.call("POST", "control/restart")
    eventually(lambda: console.call("GET", "state")["mode"] == "estop", "the e-stop outlives the dead process")
    assert not stiff(robot)
    forbidden = console.http.post("hardware", json={"request": "clear"})
    assert forbidden.status_code == 409 and "estop/clear" in forbidden.json()["detail"]
    console.call("POST", "estop/clear")
    console.lead_to(*STIFF)
    eventually(lambda: stiff(robot), "it stands up")
    os.kill(console.process.pid, signal.SIGKILL)
    await_damping(robot)

    console = start()
    console.connect()  # waits for the I/O process that the dead console has left
    console.lead_to(*STIFF)
    eventually(lambda: stiff(robot), "it stands up")
    control = console.control_pid()
    os.kill(console.process.pid, signal.SIGSTOP)  # so that neither sees the other die
    os.kill(control, signal.SIGKILL)
    os.kill(console.process.pid, signal.SIGKILL)
    await_damping(robot)


def test_a_robot_that_does_not_answer_leaves_the_simulation_running(
    start: Callable[[], Console], robot: EmulatorProcess
) -> None:
    robot.order(freeze=True)
    console = start()
    refused = console.http.put("backend", json={"name": "hardware"})
    assert refused.status_code == 409
    assert "no state from the base" in refused.json()["detail"] and "simulation runs" in refused.json()["detail"]
    state = console.call("GET", "state")
    assert state["backend"] == "simulation" and state["drive"] is None
    robot.order(freeze=False)
    console.call("PUT", "backend", {"name": "hardware"})
    assert console.call("GET", "state")["drive"] == {"state": "observe", "faults": [], "dry_run": True}
    console.process.terminate()
    assert console.process.wait(PATIENCE_S) == 0
