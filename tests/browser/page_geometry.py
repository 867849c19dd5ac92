"""Where elements are, and whether anything covers them."""

from playwright.sync_api import FloatRect, Locator

from tests.browser.console_page import Client


def box(locator: Locator) -> FloatRect:
    found = locator.bounding_box()
    assert found is not None
    return found


def is_on_top(client: Client, test_id: str) -> bool:
    """Whether the centre of an element really belongs to it."""
    return client.page.get_by_test_id(test_id).evaluate(
        """(target) => {
            const box = target.getBoundingClientRect();
            const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
            return target === top || target.contains(top);
        }"""
    )
