"""Two browsers agree; one whose network fails lets go of the robot and comes back; one may be a phone."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import ViewportSize

from tests.browser.console_page import Api, Client, eventually
from tests.browser.page_geometry import box, is_on_top
from tests.browser.scene_mouse import grab, size
from tests.browser.tcp_proxy import TcpProxy

PHONE: ViewportSize = {"width": 390, "height": 844}


def test_a_browser_that_vanishes_lets_go_and_reconnects(second_client: Client, api: Api, proxy: TcpProxy) -> None:
    client = second_client
    grab(client, api)
    proxy.cut()
    client.render(False)
    api.until(lambda state: size(state, "force_true_n") == 0.0, "the hand is let go")
    eventually(lambda: client.text("connection").startswith("lost"), "the page shows the loss")
    assert client.page.get_by_test_id("banner-link").is_visible()
    client.page.mouse.up()
    # The scene must come back without the focus, too.
    client.page.locator(".brand").click()
    proxy.mend()
    eventually(lambda: client.text("connection") == "live", "the stream comes back")
    api.call("PATCH", "command", {"guidance": True})
    eventually(lambda: client.field("Guidance").is_checked(), "the scene comes back")
    client.field("Guidance").click()
    api.until(lambda state: not state["command"]["guidance"], "the widgets act again")


def test_a_browser_whose_network_falls_silent_lets_go(second_client: Client, api: Api, proxy: TcpProxy) -> None:
    grab(second_client, api)
    proxy.silence()
    second_client.render(False)
    api.until(lambda state: size(state, "force_true_n") == 0.0, "the hand is let go")
    proxy.mend()
    second_client.page.mouse.up()
    eventually(lambda: second_client.text("connection") == "live", "the stream goes on")


def test_changes_show_in_both(client: Client, second_client: Client, api: Api) -> None:
    api.call("PATCH", "command", {"mask": [0, 0, 1], "force_n": [0.0, 0.0, 8.5], "base_velocity": [0.1, 0.0, 0.0]})
    for each in (client, second_client):
        eventually(each.field("z: force").is_checked, "the mode shows")
        eventually(lambda each=each: float(each.number("fz [N]").input_value()) == 8.5, "the force shows")
        eventually(lambda each=each: float(each.number("ahead [m/s]").input_value()) == 0.1, "the velocity shows")
    second_client.field("z: force").click()
    eventually(lambda: not client.field("z: force").is_checked(), "a change in one browser shows in the other")
    second_client.page.get_by_test_id("pause").click()
    eventually(lambda: client.text("mode") == second_client.text("mode") == "Paused", "both show the mode")


@pytest.fixture
def phone(second_client: Client) -> Iterator[Client]:
    """The second browser, as small as a phone for a while."""
    whole = second_client.page.viewport_size
    assert whole is not None
    second_client.page.set_viewport_size(PHONE)
    yield second_client
    second_client.page.set_viewport_size(whole)


def test_a_phone_shows_the_robot_and_a_drawer_shrinks_it(phone: Client, api: Api) -> None:
    eventually(lambda: box(phone.canvas)["width"] == pytest.approx(PHONE["width"], abs=1.0), "the scene takes the whole width")
    assert phone.page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    assert is_on_top(phone, "estop")
    sheet = phone.viser.locator('[data-forcelens="sheet"]')
    assert not sheet.is_visible()
    eventually(lambda: box(phone.canvas)["height"] > 0.6 * PHONE["height"], "nothing that was said before takes its room")
    whole = box(phone.canvas)

    phone.page.get_by_test_id("panel").click()
    eventually(sheet.is_visible, "the drawer opens")
    eventually(lambda: box(phone.canvas)["height"] < 0.55 * whole["height"], "the scene makes room")
    assert box(sheet)["y"] >= box(phone.canvas)["y"] + box(phone.canvas)["height"] - 1.0
    assert is_on_top(phone, "estop")
    phone.page.get_by_test_id("panel").click()
    eventually(lambda: not sheet.is_visible(), "the drawer closes")
