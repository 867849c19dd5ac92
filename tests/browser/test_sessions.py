"""Two consoles on one host in one browser: each page stops its own robot, and says so when it cannot."""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from tests.browser.console_page import PATIENCE_S, Api, eventually
from tests.console_process import ConsoleProcess

TOKENS = ("first+token/==", "second token")


class GuardedConsole(ConsoleProcess):
    """A console with a token, and its REST interface."""

    def __init__(self, token: str, port: int = 0) -> None:
        super().__init__(port=port, FORCELENS_TOKEN=token)
        self.api = Api(self.address.partition("?")[0].rstrip("/"), token)
        self.api.call("POST", "run", {"state": "paused"})  # or two of them take the machine


@pytest.fixture
def start() -> Iterator[Callable[..., GuardedConsole]]:
    started: list[GuardedConsole] = []

    def start_one(token: str, port: int = 0) -> GuardedConsole:
        started.append(GuardedConsole(token, port))
        return started[-1]

    yield start_one
    for console in started:
        if console.process.poll() is None:
            console.close()


@pytest.fixture
def context(resting_browser: Browser) -> Iterator[BrowserContext]:
    """Tabs that share their cookies, with nothing where the scene would be: it takes long to draw."""
    context = resting_browser.new_context()
    context.set_default_timeout(1000.0 * PATIENCE_S)
    context.route("**/viser/", lambda route: route.fulfill(content_type="text/html", body=""))
    yield context
    context.close()


def connection(page: Page) -> str:
    return page.get_by_test_id("connection").inner_text()


def open_page(context: BrowserContext, address: str) -> Page:
    page = context.new_page()
    page.goto(address)
    eventually(lambda: connection(page) == "live", "the page may stop the robot")
    return page


def test_each_page_stops_its_own_robot(context: BrowserContext, start: Callable[..., GuardedConsole]) -> None:
    consoles = [start(token) for token in TOKENS]
    pages = [open_page(context, console.address) for console in consoles]
    for page, console in zip(pages, consoles, strict=True):
        assert page.url == console.api.address + "/", "the token has left the address"
        assert page.evaluate("history.length") <= 2, "and the history"
    pages[0].get_by_test_id("estop").click()
    consoles[0].api.until(lambda state: state["mode"] == "estop", "the first page stops the first robot")
    assert consoles[1].api.state()["mode"] == "paused"
    pages[1].get_by_test_id("estop").click()
    consoles[1].api.until(lambda state: state["mode"] == "estop", "the second page stops the second robot")
    assert [connection(page) for page in pages] == ["live", "live"]


def test_a_page_that_cannot_stop_the_robot_says_so_and_comes_back(
    context: BrowserContext, start: Callable[..., GuardedConsole]
) -> None:
    console = start(TOKENS[0])
    page = open_page(context, console.address)
    banner = page.get_by_test_id("banner-link")

    context.clear_cookies()
    eventually(lambda: connection(page) == "not permitted", "a lost session shows while the stream flows on")
    assert "cannot stop the robot" in banner.inner_text()
    assert "address that Forcelens printed" in banner.inner_text()
    open_page(context, console.address).close()
    eventually(lambda: connection(page) == "live", "another tab of the browser brings it back")
    assert not banner.is_visible()

    port = console.port
    console.close()
    eventually(lambda: connection(page).startswith("lost"), "the page shows the loss")
    console = start(TOKENS[0], port)
    eventually(lambda: connection(page) == "live", "the page comes back after a restart")

    console.close()
    console = start(TOKENS[1], port)
    eventually(lambda: connection(page) == "not permitted", "a restart with another token shows")
    open_page(context, console.address).close()
    eventually(lambda: connection(page) == "live", "the new address brings it back")
