"""Nothing covers the robot or the e-stop on a laptop, and a bar with much to say stays in order."""

from itertools import combinations

import pytest

from sim.runtime.fault_words import FAULT_WORDS
from tests.browser.conftest import VIEWPORT
from tests.browser.console_page import Client
from tests.browser.page_geometry import box, is_on_top

LAPTOP_WIDTH, LAPTOP_HEIGHT = 1280, 800

WARN = """async (words) => {
    const { showLimits } = await import(new URL("static/status_bar.js", document.baseURI));
    showLimits(words);
    const parts = [...document.querySelectorAll(".bar > :not(.facts), .facts > div")];
    const boxes = parts.map((each) => each.getBoundingClientRect());
    return boxes.filter((box) => box.width > 0).map((box) => [box.left, box.top, box.right, box.bottom]);
}"""
"""Warns of `words`; boxes (n, 4) of all that the bar holds."""


def test_a_laptop_shows_all_at_once(client: Client) -> None:
    assert client.page.evaluate("document.documentElement.scrollWidth") == LAPTOP_WIDTH
    stop = box(client.page.get_by_test_id("estop"))
    assert stop["x"] + stop["width"] <= LAPTOP_WIDTH
    assert is_on_top(client, "estop")
    assert box(client.canvas)["width"] > 0.45 * LAPTOP_WIDTH
    assert box(client.canvas)["height"] > 0.8 * LAPTOP_HEIGHT
    for name in ("commanded", "estimated", "true"):
        assert client.page.locator(f'tr[data-force="{name}"]').is_visible()


@pytest.mark.parametrize("width", [LAPTOP_WIDTH, 1000])
def test_a_long_warning_crowds_nothing(client: Client, width: int) -> None:
    client.page.set_viewport_size({"width": width, "height": LAPTOP_HEIGHT})
    height = box(client.page.locator(".bar"))["height"]
    boxes = client.page.evaluate(WARN, list(FAULT_WORDS.values()))
    assert box(client.page.locator(".bar"))["height"] == height
    for (left, top, right, bottom), (other_left, other_top, other_right, other_bottom) in combinations(boxes, 2):
        across = min(right, other_right) - max(left, other_left)
        down = min(bottom, other_bottom) - max(top, other_top)
        assert across <= 0.5 or down <= 0.5
    assert all(left >= 0 and right <= width for left, _, right, _ in boxes)
    client.page.set_viewport_size(VIEWPORT)


@pytest.mark.parametrize("width", [LAPTOP_WIDTH, 1440, 1920, 390])
def test_the_words_of_a_fault_are_whole(client: Client, width: int) -> None:
    client.page.set_viewport_size({"width": width, "height": LAPTOP_HEIGHT})
    client.page.evaluate(WARN, [max(FAULT_WORDS.values(), key=len)])
    shown = """() => {
        const { scrollHeight, clientHeight, scrollWidth, clientWidth } = document.getElementById("limits");
        return [scrollHeight - clientHeight, scrollWidth - clientWidth];
    }"""
    assert max(client.page.evaluate(shown)) <= 1
    client.page.set_viewport_size(VIEWPORT)
