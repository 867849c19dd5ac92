"""The form of an exact wrench reaches the simulation, and the page tells what acts."""

import pytest

from tests.browser.console_page import Api, Client, eventually


def test_a_push_from_the_form(client: Client, api: Api) -> None:
    client.show_tab("Push")
    client.field("Lasts [s]").fill("30")
    client.viser.get_by_role("button", name="Apply").click()
    (wrench,) = eventually(lambda: api.call("GET", "wrenches"), "the wrench acts")
    assert (wrench["body"], wrench["frame"], wrench["force_n"]) == ("end_effector", "heading", [20.0, 0.0, 0.0])
    assert wrench["duration_s"] == pytest.approx(30.0)
    table = client.viser.locator('[data-forcelens="wrenches"]')
    eventually(lambda: "end_effector: 20.0 N" in table.inner_text(), "the page lists it")
    client.viser.get_by_role("button", name="End all").click()
    eventually(lambda: api.call("GET", "wrenches") == [], "the wrench ends")
    eventually(lambda: "Nothing acts" in table.inner_text(), "the page says so")
    client.show_tab("Command")
