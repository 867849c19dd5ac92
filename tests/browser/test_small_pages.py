"""A page at 400 %, a phone on its side and a phone upright: scene and e-stop are there, and the hand is in the picture."""

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import ViewportSize

from tests.browser.conftest import VIEWPORT
from tests.browser.console_page import Api, Client, eventually
from tests.browser.page_geometry import box, is_on_top
from tests.browser.scene_mouse import drag, hand, pixel, size

AT_400_PERCENT: ViewportSize = {"width": 320, "height": 256}
LYING: ViewportSize = {"width": 640, "height": 360}
PHONE: ViewportSize = {"width": 390, "height": 844}
SMALL = {"400 %": AT_400_PERCENT, "lying": LYING, "phone": PHONE}
FINGER_PX = 44.0
FARTHEST_HANDS = np.array([[x, y, z] for x in (0.3, 0.8) for y in (-0.3, 0.3) for z in (0.2, 0.8)])


@pytest.fixture(params=SMALL.values(), ids=list(SMALL))
def small(request: pytest.FixtureRequest, client: Client) -> Iterator[Client]:
    client.page.set_viewport_size(request.param)
    eventually(lambda: box(client.page.get_by_test_id("viser"))["width"] == request.param["width"], "the page has its size")
    eventually(lambda: box(client.canvas)["width"] == pytest.approx(request.param["width"], abs=1.0), "the scene fills it")
    yield client
    client.page.set_viewport_size(VIEWPORT)


def test_scene_and_estop_are_usable(small: Client, api: Api) -> None:
    viewport = small.page.viewport_size
    assert viewport is not None
    assert small.page.evaluate("document.documentElement.scrollWidth") == viewport["width"]
    assert box(small.canvas)["height"] >= 0.5 * viewport["height"]
    scene = box(small.page.get_by_test_id("viser"))
    assert scene["y"] + scene["height"] <= viewport["height"]

    small.page.mouse.move(5, viewport["height"] - 5)
    small.page.mouse.wheel(0, 1000)  # what lies below the scene, if anything does
    for name in ("estop", "pause", "reset", "panel", "help"):
        assert is_on_top(small, name), name
    stop = box(small.page.get_by_test_id("estop"))
    assert min(stop["width"], stop["height"]) >= FINGER_PX
    assert is_on_top(small, "mode")
    small.page.get_by_test_id("estop").click()
    api.until(lambda state: state["mode"] == "estop", "the button stops")
    eventually(lambda: small.text("estop") == "STOPPED", "the page shows it")
    assert is_on_top(small, "estop")
    assert box(small.canvas)["height"] >= 0.3 * viewport["height"], "the banner leaves room"
    small.page.get_by_test_id("estop-action").click()
    small.page.get_by_test_id("estop-action").click()
    api.until(lambda state: state["mode"] != "estop", "two presses clear")


def test_the_drawer_opens_and_leaves_the_estop_free(small: Client) -> None:
    sheet = small.viser.locator('[data-forcelens="sheet"]')
    assert not sheet.is_visible()
    small.page.get_by_test_id("panel").click()
    eventually(sheet.is_visible, "the drawer opens")
    viser = box(small.page.get_by_test_id("viser"))
    assert box(sheet)["height"] > 0.45 * viser["height"]
    assert is_on_top(small, "estop")
    small.page.get_by_test_id("panel").click()
    eventually(lambda: not sheet.is_visible(), "the drawer closes")


def test_the_help_leaves_the_estop_free(small: Client) -> None:
    small.page.get_by_test_id("help").click()
    assert is_on_top(small, "estop")
    small.page.get_by_test_id("shortcuts").get_by_text("Close").click()


def test_the_hand_is_in_the_picture_wherever_it_reaches(small: Client) -> None:
    scene = box(small.canvas)
    for point in FARTHEST_HANDS:
        x, y = pixel(small, point)
        assert scene["x"] < x < scene["x"] + scene["width"], point
        assert scene["y"] < y < scene["y"] + scene["height"], point


def test_the_picture_is_what_we_think_it_is(small: Client, api: Api) -> None:
    """The ball at the hand is where the hand should be: pulled there, it pulls."""
    small.render(True)
    drag(small, lambda: hand(api.state()), (30.0, -15.0), lambda: size(api.state(), "force_true_n") > 2.0)
    small.page.mouse.up()
    small.render(False)
