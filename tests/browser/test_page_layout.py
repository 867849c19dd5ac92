"""Nothing covers the robot or the e-stop on a laptop."""

from tests.browser.console_page import Client
from tests.browser.page_geometry import box, is_on_top

LAPTOP_WIDTH, LAPTOP_HEIGHT = 1280, 800


def test_a_laptop_shows_all_at_once(client: Client) -> None:
    assert client.page.evaluate("document.documentElement.scrollWidth") == LAPTOP_WIDTH
    stop = box(client.page.get_by_test_id("estop"))
    assert stop["x"] + stop["width"] <= LAPTOP_WIDTH
    assert is_on_top(client, "estop")
    assert box(client.canvas)["width"] > 0.45 * LAPTOP_WIDTH
    assert box(client.canvas)["height"] > 0.8 * LAPTOP_HEIGHT
    for name in ("commanded", "estimated", "true"):
        assert client.page.locator(f'tr[data-force="{name}"]').is_visible()
