"""The page's tare and tool, and the payload of the simulated hand."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import viser

from tests.web.press import edit, press
from tests.web.recording_sink import RecordingSink, until
from web.hand_load_panel import HandLoadPanel, hand_load_html
from web.setup_panel import SetupPanel


@pytest.fixture
def panel(server: viser.ViserServer, sink: RecordingSink) -> HandLoadPanel:
    return HandLoadPanel(server.gui, sink)


def test_the_tool_as_entered_is_set_and_shown_tools_do_not_undo_what_is_entered(
    panel: HandLoadPanel, sink: RecordingSink, snapshot: np.void
) -> None:
    panel.update(snapshot)
    panel.mass.value, panel.center.value = 0.8, (0.05, 0.0, -0.02)
    panel.update(snapshot)
    press(panel.put)
    assert sink.wait_for("set_tool") == (0.8, (0.05, 0.0, -0.02))
    snapshot["tool_mass"], snapshot["tool_center_of_mass"] = 1.1, [0.1, 0.0, 0.0]
    panel.update(snapshot)
    assert (panel.mass.value, panel.center.value) == (1.1, (0.1, 0.0, 0.0))


@pytest.mark.parametrize(("button", "call"), [("tare", "tare"), ("clear", "clear_tare"), ("identify", "identify_tool")])
def test_every_button_asks(panel: HandLoadPanel, sink: RecordingSink, button: str, call: str) -> None:
    press(getattr(panel, button))
    assert sink.wait_for(call) is None


class Client:
    """A browser as far as notifications go."""

    client_id = 0

    def __init__(self, add_notification: Callable[..., None]) -> None:
        self.add_notification = add_notification


def test_a_refusal_is_shown_to_who_asked(panel: HandLoadPanel, sink: RecordingSink) -> None:
    told: list[Any] = []
    sink.refusal = RuntimeError("the hand moves; tare it at rest")
    client = Client(lambda *words, **_: told.append(words))
    press(panel.tare, client)
    sink.wait_for("tare")
    until(lambda: told == [("Refused", "the hand moves; tare it at rest")])


def test_the_motion_shows_how_far_it_is_and_cannot_be_asked_for_twice(panel: HandLoadPanel, snapshot: np.void) -> None:
    snapshot["tool_progress"] = 0.4
    panel.update(snapshot)
    assert panel.progress.visible and panel.progress.value == 40.0 and panel.identify.disabled
    snapshot["tool_progress"] = np.nan
    panel.update(snapshot)
    assert not panel.progress.visible and not panel.identify.disabled


def test_the_note_tells_tare_and_tool_and_why_none_was_found(snapshot: np.void) -> None:
    assert "Tare: none" in hand_load_html(snapshot) and "Tool: none" in hand_load_html(snapshot)
    snapshot["tare_n"], snapshot["tool_mass"], snapshot["tool_center_of_mass"] = [0.5, 0.0, -1.0], 0.8, [0.05, 0.0, 0.0]
    snapshot["tool_message"] = b"<ended>"
    text = hand_load_html(snapshot)
    assert "0.50, 0.00, -1.00 N" in text and "0.80 kg at 5.0, 0.0, 0.0 cm" in text
    assert "&lt;ended&gt;" in text


def test_a_payload_changes_nothing_else_of_the_robot(server: viser.ViserServer, sink: RecordingSink) -> None:
    setup = SetupPanel(server, sink)
    edit(setup.payload, 1.5)
    assert sink.wait_for("set_mismatch") == {"payload_kg": 1.5}
