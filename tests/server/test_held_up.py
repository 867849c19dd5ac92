"""A web process that was held up while the robot drove: the robot has stopped, and stays so until it is asked again."""

import signal
import time
from collections.abc import Iterator

import httpx
import pytest

from tests.server.test_command_line import start

PATIENCE_S = 60.0


class Console:
    """`python -m server` in a process that can be held up."""

    def __init__(self) -> None:
        self.process = start("--port", "0")
        assert self.process.stdout is not None
        address = self.process.stdout.readline().split()[-1]
        self._http = httpx.Client(base_url=f"{address}api/v1/", timeout=PATIENCE_S)

    def state(self) -> dict:
        return self._http.get("state").raise_for_status().json()

    def patch(self, **fields: object) -> dict:
        return self._http.patch("command", json=fields).raise_for_status().json()

    def until_speed(self, low: float, high: float) -> None:
        end = time.monotonic() + PATIENCE_S
        while not low <= (speed := self.state()["applied_command"]["base_velocity"][0]) <= high:
            assert time.monotonic() < end, f"the speed stays at {speed}"
            time.sleep(0.01)

    def hold_up(self, seconds: float) -> None:
        self.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self.process.send_signal(signal.SIGCONT)


@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    yield console
    console.process.kill()
    console.process.communicate()


def test_a_robot_that_lost_its_console_for_a_moment_does_not_drive_on_by_itself(console: Console) -> None:
    console.patch(base_velocity=[0.3, 0.0, 0.0])
    console.until_speed(0.25, 0.35)
    console.hold_up(2.0)
    assert console.patch(mask=[0, 0, 1])["base_velocity"] == [0.0, 0.0, 0.0]  # asks for something else
    console.until_speed(-1e-3, 1e-3)
    began_s = console.state()["time_s"]
    while console.state()["time_s"] < began_s + 1.0:
        assert abs(console.state()["applied_command"]["base_velocity"][0]) < 1e-3
    console.patch(base_velocity=[0.3, 0.0, 0.0])
    console.until_speed(0.25, 0.35)
