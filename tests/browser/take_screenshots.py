"""The README's pictures, taken anew from the page as it is: `python -m tests.browser.take_screenshots [FOLDER]`.

Needs Chromium. The simulation runs slowly, so that a software renderer keeps up with it.
"""

import sys
from contextlib import closing
from pathlib import Path

from playwright.sync_api import sync_playwright

from control.paths import ASSETS
from tests.browser.conftest import FLAGS, VIEWPORT, chromium_path
from tests.browser.console_page import PATIENCE_S, Api, Client
from tests.browser.scene_mouse import error, grab, next_frames, size
from tests.console_process import ConsoleProcess

SPEED = 0.2


def dragging(client: Client, api: Api, path: Path) -> None:
    """The hand while it is pulled, the estimate close to the truth."""
    client.render(True)
    client.page.locator("body").press("1")
    grab(client, api)
    api.until(lambda state: error(state) < 0.15 * size(state, "force_true_n"), "the estimate follows the truth")
    next_frames(client)
    client.page.screenshot(path=path)
    client.page.mouse.up()
    api.until(lambda state: size(state, "force_true_n") == 0.0, "the release lets go")


def stopped(client: Client, api: Api, path: Path) -> None:
    """The e-stop, latched and at rest."""
    client.page.get_by_test_id("estop").click()
    latched_s = api.until(lambda state: state["mode"] == "estop", "the e-stop latches")["time_s"]
    api.until(lambda state: state["time_s"] > latched_s + 1.0, "the robot sinks")
    api.until(lambda state: max(map(abs, state["joints"]["velocity"])) < 0.05, "the robot rests")
    next_frames(client)
    next_frames(client)
    client.page.screenshot(path=path)


def main() -> None:
    """Take both."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ASSETS / "screenshots"
    executable = chromium_path()
    if executable is None:
        sys.exit("no Chromium found; install one (apt-get install chromium)")
    with closing(ConsoleProcess()) as console, sync_playwright() as playwright:
        api = Api(console.address)
        browser = playwright.chromium.launch(executable_path=executable, args=list(FLAGS))
        page = browser.new_page(viewport=VIEWPORT)
        page.set_default_timeout(1000.0 * PATIENCE_S)
        client = Client(page)
        client.open(console.address)
        api.call("POST", "run", {"state": "running", "speed": SPEED})
        api.until(lambda state: state["time_s"] > 1.0, "the robot stands")
        dragging(client, api, folder / "dragging.png")
        stopped(client, api, folder / "estop.png")
        browser.close()


if __name__ == "__main__":
    main()
