"""Pulling the robot by its hand with the mouse: the estimated force follows the true one and returns to zero."""

import numpy as np
import pytest

from tests.browser.console_page import Api, Client, eventually
from tests.browser.scene_mouse import drag, error, grab, size


def test_the_estimate_follows_the_pull_and_its_release(drawing_client: Client, api: Api) -> None:
    client = drawing_client
    grab(client, api)
    pulled = api.until(lambda state: error(state) < 0.3 * size(state, "force_true_n"), "the estimate follows the truth")
    assert size(pulled, "force_estimated_n") > 2.0
    shown = client.page.locator('[data-force="estimated"] td').all_inner_texts()
    assert max(abs(float(text)) for text in shown) > 0.5
    client.page.mouse.up()
    released = api.until(lambda state: size(state, "force_true_n") == 0.0, "the release lets go")
    api.until(lambda state: size(state, "force_estimated_n") < 1.5, "the estimate returns to zero")
    assert released["mode"] == "running"


def test_the_gizmo_moves_the_target(drawing_client: Client, api: Api) -> None:
    client = drawing_client
    before = np.array(api.state()["command"]["position_m"])
    its_z_arrow = before + [0.0, 0.0, 0.12]
    drag(client, lambda: its_z_arrow, (0.0, -25.0), lambda: api.state()["command"]["position_m"][2] > before[2] + 0.01)
    client.page.mouse.up()
    after = api.state()
    assert after["command"]["position_m"][:2] == pytest.approx(before[:2], abs=5e-3)
    eventually(
        lambda: float(client.number("z [m]").input_value()) == pytest.approx(after["command"]["position_m"][2], abs=0.06),
        "the slider follows the gizmo",
    )
