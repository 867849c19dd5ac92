"""The push test's panel and its plot."""

import re

import numpy as np
import pytest
import viser

from tests.web.press import press
from tests.web.recording_push_tests import RecordingPushTests
from tests.web.recording_sink import until
from web.push_test import SHOWN_DEG, PullOutcome, PushTestStatus, plot_svg, push_test_html, spot
from web.push_test_panel import PushTestPanel

AHEAD = PullOutcome((1.0, 0.0, 0.0), False, 5.0, 0.2)
LEFT = PullOutcome((0.0, 1.0, 0.0), True, 40.0, 0.9)
UP = PullOutcome((0.0, 0.0, 1.0), False, 2.0, 0.1)


def test_ahead_is_up_left_is_left_and_a_fall_stands_on_the_rim() -> None:
    assert spot(AHEAD) == pytest.approx((0.0, -5.0 / SHOWN_DEG))
    assert spot(LEFT) == pytest.approx((-1.0, 0.0))
    assert len(re.findall("<path", plot_svg((AHEAD, LEFT, UP)))) == 1  # one cross


def test_the_summary_counts_falls_and_names_the_largest() -> None:
    text = push_test_html(PushTestStatus(False, 3, (AHEAD, LEFT, UP), "The <test> is done."))
    assert "The &lt;test&gt; is done." in text
    assert "Fell: 1 of 3; largest tilt 40.0&deg;; hand moved up to 0.90 m" in text
    assert "Straight up: 2.0&deg;" in text
    assert "Pull 2 of 3" in push_test_html(PushTestStatus(True, 3, (AHEAD,)))


def test_run_and_cancel_take_turns(server: viser.ViserServer, snapshot: np.void) -> None:
    tests = RecordingPushTests()
    panel = PushTestPanel(server.gui, tests)
    panel.update(snapshot)
    panel.mode.value, panel.force.value, panel.directions.value = "zero_force", 30.0, "26, all around"
    press(panel.run)
    until(lambda: tests.calls == [("zero_force", 30.0, 26)])
    tests.now, panel._next_s = PushTestStatus(True, 26), 0.0
    panel.update(snapshot)
    assert (panel.run.visible, panel.cancel.visible) == (False, True)
    press(panel.cancel)
    assert tests.calls[-1] is None
    tests.now, panel._next_s = PushTestStatus(False, 26, (AHEAD,), "The test ended: it was cancelled."), 0.0
    panel.update(snapshot)
    assert (panel.run.visible, panel.cancel.visible) == (True, False)
    assert "cancelled" in panel.plot.content


def test_a_robot_is_not_tested_this_way(server: viser.ViserServer, snapshot: np.void) -> None:
    panel = PushTestPanel(server.gui, RecordingPushTests())
    snapshot["backend"] = b"hardware"
    panel.update(snapshot)
    assert not panel.folder.visible
