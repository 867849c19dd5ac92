"""A dead control process shows in the page, and a button brings it back."""

import os
import signal

from tests.browser.console_page import Api, Client, eventually
from tests.console_process import ConsoleProcess


def test_a_dead_control_process_shows_and_restarts(client: Client, api: Api, console: ConsoleProcess) -> None:
    os.kill(console.control_pid(), signal.SIGKILL)
    eventually(lambda: client.text("mode") == "Stopped", "the bar shows it")
    eventually(client.alert.is_visible, "the scene's panel shows it")
    client.page.get_by_test_id("control-action").click()
    api.until(
        lambda state: state["mode"] == "paused" and "CONTROL_PROCESS_DEAD" not in state["faults"], "it restarts in a hold"
    )
    eventually(lambda: client.text("mode") == "Paused", "the bar shows it")
    assert not client.page.get_by_test_id("banner-control").is_visible()
    client.page.get_by_test_id("pause").click()
    api.until(lambda state: state["mode"] == "running", "it runs again")
