"""The page loads clean, and its bar and keys do what they say."""

import pytest
from playwright.sync_api import Route

from tests.browser.console_page import Api, Client, eventually
from tests.browser.page_geometry import is_on_top


def test_it_loads_without_errors(client: Client, api: Api) -> None:
    assert client.load_errors == []
    eventually(lambda: client.text("mode") == "Running", "the bar shows the mode")
    assert client.text("backend") == "simulation, free"
    eventually(lambda: client.text("estimator") == api.state()["estimator"], "the bar shows the estimator")


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


def press_key(client: Client, key: str, code: str, modifiers: int = 0) -> None:
    """Press the key at a place that prints `key`, as a keyboard of any layout does. Modifiers: 1 Alt, 2 Control, 8 Shift."""
    devtools = client.page.context.new_cdp_session(client.page)
    for kind in ("keyDown", "keyUp"):
        devtools.send("Input.dispatchKeyEvent", {"type": kind, "key": key, "code": code, "modifiers": modifiers})
    devtools.detach()


@pytest.mark.parametrize("in_scene", [False, True], ids=["page", "scene"])
def test_keys_follow_their_place_whatever_the_layout_prints_there(client: Client, api: Api, in_scene: bool) -> None:
    focus = client.viser.locator("body") if in_scene else client.page.locator("body")
    focus.press("Shift")
    press_key(client, "g", "KeyI")  # acts no more than any other key
    for key, code, on in (("п", "KeyG", True), ("γ", "KeyG", False), ("g", "", True), ("G", "KeyG", False)):
        press_key(client, key, code)
        mode = "Guidance" if on else "Running"
        eventually(lambda mode=mode: client.text("mode") == mode, f"{key} at {code} leads to {mode}")
    press_key(client, " ", "Space")
    paused = api.until(lambda state: state["mode"] == "paused", "Space pauses")
    press_key(client, "ю", "Period")
    api.until(lambda state: state["time_s"] > paused["time_s"], "the key at the place of the full stop steps")
    dialog = client.page.get_by_test_id("shortcuts")
    for key, code, modifiers in ((",", "Slash", 8), ("?", "Digit7", 8)):
        press_key(client, key, code, modifiers)
        eventually(lambda: not dialog.is_hidden(), f"{key} at {code} opens the help")
        press_key(client, key, code, modifiers)
        eventually(dialog.is_hidden, f"{key} at {code} closes the help")


@pytest.mark.parametrize(
    ("key", "code", "modifiers"),
    [("у", "KeyE", 0), ("e", "KeyD", 0), ("e", "", 0), ("E", "KeyE", 8), ("Escape", "Escape", 2), ("Process", "Escape", 0)],
)
def test_the_estop_key_stops_by_place_by_letter_and_by_escape_with_anything_held(
    client: Client, api: Api, key: str, code: str, modifiers: int
) -> None:
    client.page.locator("body").press("Shift")
    press_key(client, key, code, modifiers)
    api.until(lambda state: state["mode"] == "estop", f"{key} at {code} stops")


def test_typing_into_a_field_is_not_a_shortcut(client: Client, api: Api) -> None:
    client.number("x [m]").press("e")
    client.number("x [m]").press("Space")
    client.number("x [m]").blur()
    client.viser.locator("body").press("g")
    state = api.until(lambda state: state["command"]["guidance"], "a key that was pressed later has arrived")
    assert state["mode"] == "running"


def test_help_lists_the_keys_and_leaves_the_estop_free(client: Client, api: Api) -> None:
    client.page.get_by_test_id("help").click()
    dialog = client.page.get_by_test_id("shortcuts")
    for told in ("E-stop", "Escape always stops", "key's place"):
        assert told in dialog.inner_text()
    assert is_on_top(client, "estop")
    client.page.keyboard.press("e")
    api.until(lambda state: state["mode"] == "estop", "the key stops while the help is open")
    dialog.get_by_text("Close").click()
    assert not dialog.is_visible()


def test_behind_a_proxy_that_rewrites_the_host_the_banner_tells_the_cure(client: Client) -> None:
    """Such a proxy makes the page's Origin differ from the Host that the server sees."""

    def rewrite(route: Route) -> None:
        headers = {**route.request.headers, "origin": "http://robot.example"}
        route.fulfill(response=route.fetch(headers=headers))

    client.page.route("**/api/v1/estop/check", rewrite)
    try:
        eventually(lambda: client.text("connection") == "not permitted", "a page that cannot stop the robot is not live")
        told = client.page.get_by_test_id("banner-link").inner_text()
        assert "robot.example" in told and "proxy_set_header Host $http_host;" in told
    finally:
        client.page.unroute("**/api/v1/estop/check")
    eventually(lambda: client.text("connection") == "live", "the cure helps at once")
