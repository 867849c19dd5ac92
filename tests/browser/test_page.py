"""The page loads clean, and its bar and keys do what they say."""

from tests.browser.console_page import Api, Client, eventually
from tests.browser.page_geometry import is_on_top


def test_it_loads_without_errors(client: Client, api: Api) -> None:
    assert client.load_errors == []
    eventually(lambda: client.text("mode") == "Running", "the bar shows the mode")
    assert client.text("backend") == "simulation, free"
    assert client.text("estimator") == api.state()["estimator"]


def test_pause_and_reset_buttons(client: Client, api: Api) -> None:
    client.page.get_by_test_id("pause").click()
    paused = api.until(lambda state: state["mode"] == "paused", "the button pauses")
    eventually(lambda: client.text("pause") == "Resume", "the button says what it does next")
    client.page.get_by_test_id("reset").click()
    api.until(lambda state: state["time_s"] < paused["time_s"], "the button resets")
    client.page.get_by_test_id("pause").click()
    api.until(lambda state: state["mode"] == "running", "the button resumes")


def test_keys_work_in_the_page_and_in_the_scene(client: Client, api: Api) -> None:
    presses = [(client.page, "Space", "Paused"), (client.viser, "Space", "Running")]
    presses += [(client.viser, "g", "Guidance"), (client.page, "g", "Running")]
    for where, key, mode in presses:
        where.locator("body").press(key)
        eventually(lambda mode=mode: client.text("mode") == mode, f"{key} leads to {mode}")
    state = api.state()
    assert (state["mode"], state["command"]["guidance"]) == ("running", False)


def test_typing_into_a_field_is_not_a_shortcut(client: Client, api: Api) -> None:
    client.number("x [m]").press("e")
    client.number("x [m]").press("Space")
    client.number("x [m]").blur()
    client.viser.locator("body").press("g")
    state = api.until(lambda state: state["command"]["guidance"], "a key that was pressed later has arrived")
    assert state["mode"] == "running"


def test_help_lists_the_keys_and_leaves_the_estop_free(client: Client) -> None:
    client.page.get_by_test_id("help").click()
    dialog = client.page.get_by_test_id("shortcuts")
    assert "E-stop" in dialog.inner_text()
    assert is_on_top(client, "estop")
    dialog.get_by_text("Close").click()
    assert not dialog.is_visible()
