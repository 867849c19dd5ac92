"""Where things are on the canvas, and how to pull the hand there."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.browser.console_page import Api, Client, happens
from web.camera import PRESETS, START, fov_rad

ATTEMPTS = 4
WORKS_WITHIN_S = 12.0


def pixel(client: Client, point: np.ndarray) -> tuple[float, float]:
    """Where the first camera shows a point (3,) m in world."""
    position, look_at = (np.array(each) for each in PRESETS[START])
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    ray = point - position
    box = client.canvas.bounding_box()
    assert box is not None
    focal = box["height"] / 2.0 / np.tan(fov_rad(box["width"] / box["height"]) / 2.0) / (ray @ ahead)
    return (
        box["x"] + box["width"] / 2.0 + focal * (ray @ right),
        box["y"] + box["height"] / 2.0 + focal * (ray @ np.cross(ahead, right)),
    )


def drag(client: Client, start: Callable[[], np.ndarray], move_px: tuple[float, float], worked: Callable[[], bool]) -> None:
    """Press on a moving point (3,) m in world and move the mouse, until `worked`; the button stays down.

    A press between two slow frames may miss and turn the camera instead: then the camera is put back for another try.
    """
    mouse = client.page.mouse
    for _ in range(ATTEMPTS):
        x, y = pixel(client, start())
        mouse.move(x - 4.0, y)
        mouse.move(x, y)
        # The press must meet what Viser already knows to be under the pointer.
        next_frames(client)
        mouse.down()
        for part in (0.4, 0.7, 1.0):
            mouse.move(x + part * move_px[0], y + part * move_px[1])
        if happens(worked, WORKS_WITHIN_S):
            return
        mouse.up()
        client.page.locator("body").press("1")
        next_frames(client)
        next_frames(client)
    pytest.fail(f"dragging from {start()} had no effect in {ATTEMPTS} attempts")


def grab(client: Client, api: Api) -> None:
    """Press on the ball at the hand and pull to the upper right until it pulls; the scene draws from here on."""
    client.render(True)
    api.until(lambda state: np.allclose(hand(state), state["command"]["position_m"], atol=0.008), "the hand is at rest")
    drag(client, lambda: hand(api.state()), (45.0, -25.0), lambda: size(api.state(), "force_true_n") > 3.0)


def hand(state: dict[str, Any]) -> np.ndarray:
    """Position (3,) m of the hand; the robot has not moved since its reset, so heading and world agree."""
    return np.array(state["end_effector"]["position_m"])


def size(state: dict[str, Any], name: str) -> float:
    return float(np.linalg.norm(state["end_effector"][name]))


def error(state: dict[str, Any]) -> float:
    hand = state["end_effector"]
    return float(np.linalg.norm(np.subtract(hand["force_estimated_n"], hand["force_true_n"])))


def next_frames(client: Client) -> None:
    """Wait until the scene has drawn again, for a few seconds at most."""
    client.canvas.evaluate(
        """() => new Promise((done) => {
            requestAnimationFrame(() => requestAnimationFrame(done));
            setTimeout(done, 5000);
        })"""
    )
