"""Two browsers and a script: one drives, the others see who, and anyone stops."""

from collections.abc import Callable, Iterator
from urllib.error import HTTPError

import pytest
from playwright.sync_api import Browser, Route

from tests.browser.console_page import Api, Client, eventually


@pytest.fixture
def two(
    client: Client, api: Api, resting_browser: Browser, open_client: Callable[[Browser, str], Client]
) -> Iterator[tuple[Client, Client]]:
    other = open_client(resting_browser, api.address)
    yield client, other
    for each in (client, other):
        if each.text("driver") == "you":
            each.page.get_by_test_id("drive").click()
    eventually(lambda: api.call("GET", "lease")["operator"] is None, "nobody drives any more")
    other.page.close()


def name_of(client: Client) -> str:
    return client.page.get_by_test_id("operator-name").input_value()


def test_one_drives_the_others_see_who_and_anyone_stops(two: tuple[Client, Client], api: Api) -> None:
    first, second = two
    assert first.text("driver") == second.text("driver") == "anyone"
    first.page.get_by_test_id("drive").click()
    eventually(lambda: first.text("driver") == "you", "the first drives")
    eventually(lambda: second.text("driver") == name_of(first), "the second sees who")
    with pytest.raises(HTTPError, match="409"):
        api.call("PATCH", "command", {"guidance": True})

    # What the scene's widgets ask for is refused like the page's buttons and the script.
    second.field("Guidance").click()
    eventually(
        lambda: second.viser.get_by_text(f"{name_of(first)} drives").first.is_visible(),
        "the widget is refused, with who drives",
    )
    second.page.get_by_test_id("pause").click()
    eventually(lambda: name_of(first) in second.page.get_by_role("alert").inner_text(), "the button is refused")
    first.field("z: force").click()
    state = api.until(lambda state: state["command"]["mask"] == [0, 0, 1], "the driver's widgets act")
    assert (state["mode"], state["command"]["guidance"]) == ("running", False)

    second.page.get_by_test_id("drive").click()
    eventually(lambda: second.text("driver") == "you", "one click takes over")
    eventually(lambda: first.text("driver") == name_of(second), "the first sees it")
    second.page.get_by_test_id("pause").click()
    api.until(lambda state: state["mode"] == "paused", "the new driver's button acts")
    eventually(lambda: second.text("pause") == "Resume", "the button says what it does next")
    second.page.get_by_test_id("pause").click()
    api.until(lambda state: state["mode"] == "running", "it acts again")

    first.page.get_by_test_id("estop").click()
    api.until(lambda state: state["mode"] == "estop", "who watches may stop")
    button = first.page.get_by_test_id("estop")
    eventually(lambda: button.get_attribute("data-pending") is None, "the answer arrives, or the page would press again")

    for _ in range(2):  # within seconds
        second.page.get_by_test_id("estop-action").click()
    api.until(lambda state: state["mode"] == "running", "who drives may clear")


def test_the_page_asks_on_after_an_answer_that_broke_off(client: Client, api: Api) -> None:
    """A busy page or a proxy in the way: one answer without its body must not end the asking."""
    broken: list[str] = []

    def cut(route: Route) -> None:
        broken.append(route.request.method)
        route.fulfill(status=200, content_type="application/json", body="")

    eventually(lambda: client.text("driver") == "anyone", "nobody drives")
    client.page.route("**/api/v1/lease", cut)
    try:
        eventually(lambda: client.text("driver") == "anyone" and broken, "the page asked")
    finally:
        client.page.unroute("**/api/v1/lease")
    client.page.get_by_test_id("drive").click()
    eventually(lambda: client.text("driver") == "you", "the page drives")
    client.page.get_by_test_id("drive").click()
    eventually(lambda: api.call("GET", "lease")["operator"] is None, "and gives back")
