"""A real browser on a real console.

Skipped, saying so, where there is no Chromium; with CI=true its absence is a failure. Software rendering manages a few
frames per second, so tests wait for conditions, mostly of the REST state, and never for a time.
"""

import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from sim.emulator.process import free_udp_port
from tests.browser.console_page import PATIENCE_S, Api, Client
from tests.browser.tcp_proxy import TcpProxy
from tests.console_process import ConsoleProcess
from tests.dds_domain import dds_domain

VIEWPORT: ViewportSize = {"width": 1280, "height": 800}
SMALL: ViewportSize = {"width": 1000, "height": 600}
HANG_S = 240
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking")
RESTING_FLAGS = (*FLAGS, "--disable-gpu-compositing", "--disable-gpu-rasterization")
"""In software, a page put together the way of a 3-D scene opens at half the speed and takes half a core at rest. Without it,
a scene that draws keeps everything else waiting."""


def chromium_path() -> str | None:
    """Path of a Chromium on this machine, None without one."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.browser)


@pytest.fixture(autouse=True)
def no_test_hangs() -> Iterator[None]:
    """A browser that stops answering fails the test: mouse and script calls have no time limit of their own."""

    def give_up(_signal: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"the browser did not answer within {HANG_S} s")

    previous = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(HANG_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


@pytest.fixture(scope="package")
def launch() -> Iterator[Callable[[tuple[str, ...]], Browser]]:
    """Starts a browser with flags, and ends it in the end."""
    executable = chromium_path()
    if executable is None:
        message = f"no Chromium found (looked for {', '.join(BROWSERS)}); install one to run the browser tests"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    with sync_playwright() as playwright:
        started: list[Browser] = []

        def start(flags: tuple[str, ...]) -> Browser:
            started.append(playwright.chromium.launch(executable_path=executable, args=list(flags)))
            return started[-1]

        yield start
        for browser in started:
            browser.close()


@pytest.fixture(scope="package")
def browser(launch: Callable[[tuple[str, ...]], Browser]) -> Browser:
    return launch(FLAGS)


@pytest.fixture(scope="package")
def resting_browser(launch: Callable[[tuple[str, ...]], Browser]) -> Browser:
    """For pages whose scene never draws."""
    return launch(RESTING_FLAGS)


@pytest.fixture(scope="package")
def domain() -> Iterator[int]:
    """DDS domain of the robot that the console meets when it is switched to hardware."""
    with dds_domain() as domain:
        yield domain


@pytest.fixture(scope="package")
def arm_port() -> int:
    """Where that robot has its arm."""
    return free_udp_port()


@pytest.fixture(scope="package")
def console(browser: Browser, domain: int, arm_port: int) -> Iterator[ConsoleProcess]:
    console = ConsoleProcess("--domain", str(domain), "--arm-port", str(arm_port))
    yield console
    console.close()


@pytest.fixture
def api(console: ConsoleProcess) -> Iterator[Api]:
    """The REST interface of a running, freshly reset simulation, which rests afterwards: it takes half a core."""
    api = Api(console.address)
    if api.state()["mode"] == "estop":
        api.call("POST", "estop/clear")
    api.call("POST", "reset", {})
    api.call("POST", "run", {"state": "running", "speed": 1.0})
    api.until(lambda state: state["mode"] == "running" and state["time_s"] > 0.2, "the robot stands")
    yield api
    api.call("POST", "run", {"state": "paused"})


@pytest.fixture(scope="package")
def open_client() -> Iterator[Callable[[Browser, str], Client]]:
    """Opens pages and closes them in the end. Opening one takes seconds, so tests share them."""
    pages: list[Page] = []

    def open_page(browser: Browser, address: str) -> Client:
        page = browser.new_page(viewport=VIEWPORT)
        page.set_default_timeout(1000.0 * PATIENCE_S)
        pages.append(page)
        client = Client(page)
        client.open(address)
        return client

    yield open_page
    for page in pages:
        page.close()


@pytest.fixture(scope="package")
def first_client(browser: Browser, console: ConsoleProcess, open_client: Callable[[Browser, str], Client]) -> Client:
    return open_client(browser, console.address)


@pytest.fixture
def client(first_client: Client, api: Api) -> Client:
    """A page whose scene rests."""
    return first_client


@pytest.fixture
def drawing_client(first_client: Client, api: Api) -> Iterator[Client]:
    """The same page, with its scene drawing, small because drawing is slow."""
    first_client.page.set_viewport_size(SMALL)
    first_client.render(True)
    yield first_client
    first_client.render(False)
    first_client.page.set_viewport_size(VIEWPORT)


@pytest.fixture(scope="module")
def proxy(console: ConsoleProcess) -> Iterator[TcpProxy]:
    """A way to the console that a test can cut."""
    with TcpProxy(int(console.address.rsplit(":", 1)[1])) as proxy:
        yield proxy


@pytest.fixture(scope="module")
def second_client(browser: Browser, proxy: TcpProxy, open_client: Callable[[Browser, str], Client]) -> Iterator[Client]:
    """Another browser, behind a network that can fail."""
    second = open_client(browser, proxy.address)
    second.page.set_viewport_size(SMALL)
    yield second
    second.page.close()
