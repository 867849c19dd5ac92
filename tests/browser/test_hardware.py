"""The page drives an emulated robot over its wire: picker, confirmations, guidance, e-stop, and back to the simulation."""

from collections.abc import Iterator
from typing import Any

import pytest

from sim.emulator.process import EmulatorProcess
from tests.browser.console_page import PATIENCE_S, Api, Client, eventually, happens

pytestmark = pytest.mark.hardware
BEGINS_WITHIN_S = 5.0
PUSHES = 4
AFTER_PUSH_S = 6.0

ONWARD = {
    "observe": ("Engage", "engage"),
    "damped": ("Stand up", "stand"),
    "ready": ("Start the controller", "start"),
    "fault": ("Clear the fault", "clear"),
}
"""Button and request that lead on from a state of the drives."""

ASKED_FIRST = ("engage", "stand", "start")


@pytest.fixture
def robot(domain: int, arm_port: int, client: Client, api: Api) -> Iterator[EmulatorProcess]:
    robot = EmulatorProcess(domain, arm_port)
    client.show_tab("Robot")
    yield robot
    client.show_tab("Command")  # where the other tests expect this page
    if api.state()["backend"] == "hardware":
        api.call("POST", "estop")
        api.call("PUT", "backend", {"name": "simulation"})
    robot.close()


def press(client: Client, button: str) -> None:
    """Without waiting until the button stands still: a busy machine draws so seldom that the drives damp meanwhile."""
    client.viser.get_by_role("button", name=button, exact=True).evaluate("button => button.click()")


def drives(state: str) -> Any:
    """Condition that the drives have reached a state."""

    def reached(snapshot: dict[str, Any]) -> bool:
        return snapshot["drive"] is not None and snapshot["drive"]["state"] == state

    return reached


def lead_to(client: Client, api: Api, goal: str) -> None:
    """Press what leads on, and confirm it, again where a busy machine made the drives damp, until they are there."""

    def reached() -> bool:
        hardware = api.call("GET", "hardware")
        button, request = ONWARD.get(hardware["state"], ("", ""))
        if hardware["state"] != goal and request in hardware["requests"] and not hardware["engaging"]:
            press(client, button)
            if request in ASKED_FIRST:
                assert not drives(goal)(api.state())
                press(client, f"Yes: {button.lower()}")
            happens(lambda: request not in api.call("GET", "hardware")["requests"], BEGINS_WITHIN_S)
        return drives(goal)(api.state())

    assert happens(reached, PATIENCE_S), f"not {goal}: {api.call('GET', 'hardware')}"


def push_until_it_follows(client: Client, api: Api, robot: EmulatorProcess) -> None:
    """Push the hand ahead, again where a busy machine made the drives damp meanwhile, until the base has gone along."""
    for _ in range(PUSHES):
        client.show_tab("Robot")
        lead_to(client, api, "policy")
        client.show_tab("Command")
        if not api.state()["command"]["guidance"]:
            client.field("Guidance").click()
        api.until(lambda state: state["command"]["guidance"], "guidance is on")
        start, push = robot.report(), {"force_n": [12.0, 0.0, 0.0], "duration_s": 3.0, "ramp_s": 0.3}
        robot.order(push=push)

        def ended(start: dict[str, Any] = start) -> bool:
            return (
                followed(start)
                or robot.report()["time_s"] > start["time_s"] + AFTER_PUSH_S
                or not drives("policy")(api.state())
            )

        def followed(start: dict[str, Any] = start) -> bool:
            return robot.report()["base_position_m"][0] - start["base_position_m"][0] > 0.2

        happens(ended, PATIENCE_S)
        if followed() and drives("policy")(api.state()):
            return
    pytest.fail(f"the robot does not follow its hand: {api.call('GET', 'hardware')}, {api.state()['fault_words']}")


def test_from_the_picker_to_guidance_to_the_estop_and_back(client: Client, api: Api, robot: EmulatorProcess) -> None:
    client.choose("Backend", "hardware")
    api.until(drives("observe"), "the console listens to the robot")
    panel = client.viser.locator('[data-forcelens="hardware"]')
    eventually(lambda: "DRY RUN" in panel.inner_text(), "a dry run is the default and shows")
    assert "protocol-verified, not robot-verified" in panel.inner_text()
    eventually(lambda: client.text("backend") == "hardware, dry run: observe", "the status bar says so too")
    assert client.page.get_by_test_id("reset").is_disabled()
    client.field("Dry run").click()
    api.until(lambda state: drives("observe")(state) and not state["drive"]["dry_run"], "commands will be sent")

    for goal in ("damped", "ready", "policy"):
        lead_to(client, api, goal)
    rows = client.viser.locator('[data-forcelens="motors"] tr')
    eventually(lambda: rows.count() == 23, "the health of 22 motors shows")
    true_row = client.page.locator('#forces tr[data-force="true"]')
    assert true_row.inner_text().split() == ["true", "–", "–", "–"]  # a robot has no truth

    push_until_it_follows(client, api, robot)

    client.page.get_by_test_id("estop").click()
    api.until(lambda state: state["mode"] == "estop" and drives("fault")(state), "the button stops the drives")
    stopped = robot.report()
    assert stopped["stiffness_max"] == 0.0 and stopped["damping_min"] > 0.0
    eventually(lambda: robot.report()["frames_obeyed"] > stopped["frames_obeyed"] + 50, "it damps by commands, not by time-out")
    client.page.get_by_test_id("estop-action").click()
    client.page.get_by_test_id("estop-action").click()
    client.show_tab("Robot")

    def cleared() -> bool:
        if drives("fault")(api.state()):
            press(client, "Clear the fault")
        return drives("damped")(api.state())

    eventually(cleared, "at rest the fault can be cleared")
    client.choose("Backend", "simulation")
    api.until(lambda state: state["backend"] == "simulation" and state["mode"] == "running", "the simulation runs again")
    eventually(lambda: client.text("backend") == "simulation, free", "the page shows it")
