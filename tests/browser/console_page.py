"""A console's REST interface, and pages on it."""

import json
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from playwright.sync_api import FrameLocator, Locator, Page

PATIENCE_S = 60.0

REST_SCENE = """
addEventListener("DOMContentLoaded", () => {
    const style = document.createElement("style");
    style.id = "resting";
    style.textContent = '[style*="z-index: 0"][style*="position: relative"] { left: -9999px; }';
    document.head.append(style);
});
"""
"""Moves the scene out of sight, where Viser does not draw it: in software, drawing slows down all that is not about it."""


def eventually(condition: Callable[[], Any], what: str) -> Any:
    """The first true value of `condition`; fails with `what` when none comes."""
    value = happens(condition, PATIENCE_S)
    assert value, f"never happened: {what}"
    return value


def happens(condition: Callable[[], Any], within_s: float) -> Any:
    """The first true value of `condition`, or its last value when none comes in time."""
    deadline = time.monotonic() + within_s
    while not (value := condition()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return value


class Api:
    """The console's REST interface.

    Attributes:
        address: of the page, without a token.
    """

    def __init__(self, address: str, token: str | None = None) -> None:
        self.address = address
        self._headers = {"Content-Type": "application/json"}
        if token is not None:
            self._headers["Authorization"] = f"Bearer {token}"

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.address}/api/v1/{path}", data, self._headers, method=method)
        with urllib.request.urlopen(request, timeout=20.0) as response:
            text = response.read()
        return json.loads(text) if text else None

    def state(self) -> dict[str, Any]:
        return self.call("GET", "state")

    def until(self, condition: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
        """The first state that fulfils `condition`."""
        return eventually(lambda: (lambda state: state if condition(state) else None)(self.state()), what)


@dataclass
class Client:
    """One browser page on the console."""

    page: Page
    load_errors: list[str] = field(default_factory=list)

    @property
    def viser(self) -> FrameLocator:
        return self.page.frame_locator("#viser")

    @property
    def canvas(self) -> Locator:
        return self.viser.locator("canvas[data-engine]")

    @property
    def alert(self) -> Locator:
        """The alert in the scene's panel."""
        return self.viser.locator('[data-forcelens="alert"]')

    def open(self, address: str) -> None:
        """Load the page and wait until scene, panels and stream live."""
        errors: list[str] = []
        self.page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: errors.append(str(error)))
        self.page.add_init_script(REST_SCENE)
        self.page.goto(address)
        self.canvas.wait_for(state="attached")
        self.viser.get_by_label("Guidance").wait_for(state="attached")
        eventually(lambda: self.text("connection") == "live", "the page follows the stream")
        self.load_errors = errors.copy()

    def render(self, on: bool) -> None:
        """Let the scene draw, or rest as it does after `open`."""
        self.canvas.evaluate("(canvas, on) => (canvas.ownerDocument.getElementById('resting').disabled = on)", on)

    def text(self, test_id: str) -> str:
        return self.page.get_by_test_id(test_id).inner_text()

    def show_tab(self, name: str) -> None:
        self.viser.get_by_text(name, exact=True).click()

    def field(self, label: str) -> Locator:
        """The widget with a label: a checkbox, a dropdown, or a slider's track."""
        # One look for both: a widget drawn anew gets another id.
        return self.viser.locator(f'xpath=//*[@id = //label[contains(., "{label}")]/@for]')

    def number(self, label: str) -> Locator:
        """A slider's number field."""
        return self.field(label).locator("xpath=..").get_by_role("textbox")

    def enter(self, label: str, value: float) -> None:
        """Type into a slider's number field."""
        self.number(label).fill(str(value))

    def choose(self, label: str, option: str) -> None:
        """Pick an option of a dropdown."""
        self.field(label).click()
        self.viser.get_by_role("option", name=option, exact=True).click()
