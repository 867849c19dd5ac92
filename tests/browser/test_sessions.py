"""Two consoles on one host in one browser: each page stops its own robot, and says so when it cannot."""

from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import pytest
from console_page import PATIENCE_S, Server, eventually, start_server
from playwright.sync_api import Browser, BrowserContext, Page

TOKENS = ("first+token/==", "second token")


@pytest.fixture
def start(browser: Browser) -> Iterator[Callable[..., Server]]:
    started: list[Server] = []

    def start_one(token: str, port: int = 0) -> Server:
        started.append(start_server(token=token, port=port))
        return started[-1]

    yield start_one
    for server in started:
        if server.process.poll() is None:
            server.stop()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    """Tabs that share their cookies, with nothing where the scene would be: it takes long to draw."""
    context = browser.new_context()
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


def test_each_page_stops_its_own_robot(context: BrowserContext, start: Callable[..., Server]) -> None:
    servers = [start(token) for token in TOKENS]
    pages = [open_page(context, server.printed) for server in servers]
    for page, server in zip(pages, servers, strict=True):
        assert page.url == server.api.address + "/", "the token has left the address"
        assert page.evaluate("history.length") <= 2, "and the history"
        server.api.until(lambda state: state["mode"] == "running", "the robot stands")
    pages[0].get_by_test_id("estop").click()
    servers[0].api.until(lambda state: state["mode"] == "estop", "the first page stops the first robot")
    assert servers[1].api.state()["mode"] == "running"
    pages[1].get_by_test_id("estop").click()
    servers[1].api.until(lambda state: state["mode"] == "estop", "the second page stops the second robot")
    assert [connection(page) for page in pages] == ["live", "live"]


def test_a_page_that_cannot_stop_the_robot_says_so_and_comes_back(
    context: BrowserContext, start: Callable[..., Server]
) -> None:
    server = start(TOKENS[0])
    page = open_page(context, server.printed)
    banner = page.get_by_test_id("banner-link")

    context.clear_cookies()
    eventually(lambda: connection(page) == "not permitted", "a lost session shows while the stream flows on")
    assert "cannot stop the robot" in banner.inner_text()
    assert "address that Forcelens printed" in banner.inner_text()
    open_page(context, server.printed).close()
    eventually(lambda: connection(page) == "live", "another tab of the browser brings it back")
    assert not banner.is_visible()

    port = urlsplit(server.api.address).port
    server.stop()
    eventually(lambda: connection(page).startswith("lost"), "the page shows the loss")
    server = start(TOKENS[0], port)
    eventually(lambda: connection(page) == "live", "the page comes back after a restart")

    server.stop()
    server = start(TOKENS[1], port)
    eventually(lambda: connection(page) == "not permitted", "a restart with another token shows")
    open_page(context, server.printed).close()
    eventually(lambda: connection(page) == "live", "the new address brings it back")
