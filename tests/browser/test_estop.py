"""The e-stop latches, shows what the control process reports, and clears only on purpose."""

import pytest

from tests.browser.console_page import Api, Client, eventually


def test_the_button_latches_until_it_is_cleared_with_two_presses(client: Client, api: Api) -> None:
    client.page.get_by_test_id("estop").click()
    api.until(lambda state: state["mode"] == "estop", "the button stops")
    eventually(lambda: client.text("mode") == "E-stop" and client.text("estop") == "STOPPED", "the page shows it")
    eventually(client.alert.is_visible, "the scene's panel shows it")

    client.page.get_by_test_id("reset").click()
    clear = client.page.get_by_test_id("estop-action")
    clear.click()
    assert api.state()["mode"] == "estop"
    clear.click()
    api.until(lambda state: state["mode"] != "estop", "two presses clear")
    eventually(lambda: client.text("estop") == "E-STOP", "the page shows it")
    eventually(lambda: not client.alert.is_visible(), "the scene's panel shows it")


@pytest.mark.parametrize("key", ["e", "Escape"])
def test_a_key_in_the_scene_stops(client: Client, api: Api, key: str) -> None:
    client.viser.locator("body").press(key)
    api.until(lambda state: state["mode"] == "estop", f"{key} stops")


@pytest.mark.parametrize("chord", ["Escape", "Shift+Escape"])
def test_escape_stops_even_while_typing(client: Client, api: Api, chord: str) -> None:
    client.number("x [m]").press(chord)
    client.number("x [m]").blur()
    api.until(lambda state: state["mode"] == "estop", "Escape stops")


def test_a_stop_by_rest_shows(client: Client, api: Api) -> None:
    api.call("POST", "estop")
    eventually(lambda: client.text("estop") == "STOPPED", "the page shows a stop from elsewhere")


def test_a_command_is_refused_with_words_while_stopped(client: Client, api: Api) -> None:
    api.call("POST", "estop")
    eventually(client.alert.is_visible, "the scene's panel shows the stop")
    client.field("Guidance").click()
    notice = client.viser.get_by_text("the e-stop is latched")
    notice.wait_for()
    eventually(lambda: not client.field("Guidance").is_checked(), "the checkbox returns to what is true")
    assert not api.state()["command"]["guidance"]
