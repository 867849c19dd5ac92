"""The form of an exact wrench, and what acts."""

from typing import Any

import numpy as np
import pytest
import viser

from sim.runtime.snapshot import Mode
from tests.web.press import press
from tests.web.recording_sink import RecordingSink, until
from web.acting_wrenches import ActingWrenches, level
from web.force_arrows import METERS_PER_NEWTON
from web.push_panel import PushPanel
from web.robot_pose import RobotPose

ROW = {
    "id": 7,
    "body": "end_effector",
    "point_m": [0.0, 0.0, 0.1],
    "frame": "heading",
    "force_n": [0.0, 20.0, 0.0],
    "torque_nm": [0.0, 0.0, 0.0],
    "duration_s": 2.0,
    "ramp_s": 0.5,
    "remaining_s": 1.0,
}


@pytest.fixture(scope="module")
def pose() -> RobotPose:
    return RobotPose()


@pytest.fixture
def acting(server: viser.ViserServer, sink: RecordingSink, pose: RobotPose) -> ActingWrenches:
    return ActingWrenches(server, sink, pose)


@pytest.fixture
def panel(server: viser.ViserServer, sink: RecordingSink, pose: RobotPose, acting: ActingWrenches) -> PushPanel:
    return PushPanel(server, sink, pose, acting)


def pushes(sink: RecordingSink) -> list[dict[str, Any]]:
    return [argument for name, argument in sink.calls if name == "add_wrench"]


def at(snapshot: np.void, time_s: float) -> np.void:
    snapshot["time_s"] = time_s
    return snapshot


def test_the_wrench_is_sent_as_entered(panel: PushPanel, sink: RecordingSink) -> None:
    panel.body.value, panel.point.value, panel.frame.value = "base", (0.1, 0.0, 0.2), "world"
    panel.force.value, panel.torque.value = (0.0, -30.0, 5.0), (0.0, 1.0, 0.0)
    panel.duration.value, panel.ramp.value = 1.5, 0.25
    press(panel.apply)
    assert sink.wait_for("add_wrench") == {
        "body": "base",
        "point_m": [0.1, 0.0, 0.2],
        "frame": "world",
        "force_n": [0.0, -30.0, 5.0],
        "torque_nm": [0.0, 1.0, 0.0],
        "duration_s": 1.5,
        "ramp_s": 0.25,
    }


def begun(panel: PushPanel, sink: RecordingSink, times: int) -> None:
    """A series of pushes of 2 s each with 0.5 s between them."""
    panel.duration.value, panel.pause.value, panel.times.value = 2.0, 0.5, times
    press(panel.apply)
    until(lambda: panel._series is not None)
    assert len(pushes(sink)) == 1


def test_a_series_comes_by_simulated_time_and_ends(panel: PushPanel, sink: RecordingSink, snapshot: np.void) -> None:
    begun(panel, sink, 3)
    for time_s, sent in ((10.0, 1), (12.4, 1), (12.6, 2), (14.9, 2), (15.1, 3), (30.0, 3), (60.0, 3)):
        panel.update(at(snapshot, time_s))
        until(lambda sent=sent: len(pushes(sink)) == sent)
    assert panel._series is None


@pytest.mark.parametrize("end", ["reset", "scene", "estop", "fault", "button"])
def test_what_stops_the_robot_ends_the_series(panel: PushPanel, sink: RecordingSink, snapshot: np.void, end: str) -> None:
    begun(panel, sink, 3)
    panel.update(at(snapshot, 10.0))
    if end == "button":
        press(panel.end)
    elif end == "scene":
        snapshot["scene"] = b"box"
    elif end != "reset":
        snapshot["mode"] = {"estop": Mode.ESTOP, "fault": Mode.FAULT}[end]
    panel.update(at(snapshot, 0.1 if end == "reset" else 13.0))
    assert panel._series is None
    panel.update(at(snapshot, 20.0))
    assert len(pushes(sink)) == 1


def test_what_acts_is_listed_and_can_be_ended(
    panel: PushPanel, acting: ActingWrenches, sink: RecordingSink, snapshot: np.void
) -> None:
    sink.wrenches = [ROW, ROW | {"id": 8, "remaining_s": 0.2}]
    listed(acting, snapshot)
    panel.update(snapshot)
    assert panel.table.content.count("end_effector: 20.0 N") == 2
    press(panel.end)
    sink.wait_for("remove_wrench")
    until(lambda: {argument for name, argument in sink.calls if name == "remove_wrench"} == {7, 8})
    acting.update(at(snapshot, 0.5))
    assert [row["id"] for row in acting.rows()] == [7]  # the other has expired meanwhile


def listed(acting: ActingWrenches, snapshot: np.void) -> None:
    """Ask, and draw the answer."""
    acting.update(at(snapshot, 0.0))
    acting.update(at(snapshot, 0.0))


def test_an_arrow_stands_where_a_wrench_acts_and_turns_with_the_robot(
    acting: ActingWrenches, sink: RecordingSink, pose: RobotPose, snapshot: np.void
) -> None:
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["base_orientation_wxyz"] = [np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)]
    sink.wrenches = [ROW]
    listed(acting, snapshot)
    position, rotation = pose.pose("end_effector")
    tail, tip = acting.arrows.points[0]
    np.testing.assert_allclose(tail, position + rotation @ ROW["point_m"], atol=1e-5)
    np.testing.assert_allclose(tip - tail, [-20.0 * METERS_PER_NEWTON, 0.0, 0.0], atol=1e-5)
    assert acting.arrows.visible
    acting.update(at(snapshot, 1.1))
    assert not acting.arrows.visible


def test_nothing_acts_on_hardware(acting: ActingWrenches, sink: RecordingSink, panel: PushPanel, snapshot: np.void) -> None:
    sink.wrenches = [ROW]
    listed(acting, snapshot)
    snapshot["backend"] = b"hardware"
    acting.update(snapshot)
    panel.update(snapshot)
    assert acting.rows() == [] and not acting.arrows.visible and not panel.form.visible


def test_an_arrow_grows_and_shrinks_with_the_ramps() -> None:
    assert [level(ROW | {"remaining_s": left}) for left in (2.0, 1.75, 1.0, 0.25)] == [0.0, 0.5, 1.0, 0.5]
    assert level(ROW | {"ramp_s": 0.0, "remaining_s": 2.0}) == 1.0


def test_a_click_on_the_robot_enters_body_and_point(panel: PushPanel, pose: RobotPose, snapshot: np.void) -> None:
    panel.update(snapshot)
    pose.update(snapshot)
    below = pose.pose("base")[0] + [0.05, 0.0, -2.0]
    assert panel.choose(below, np.array([0.0, 0.0, 1.0]))
    assert panel.body.value == "base"
    assert panel.point.value[0] == pytest.approx(0.05, abs=1e-3) and panel.point.value[2] < 0.0
    assert not panel.choose(below, np.array([0.0, 0.0, -1.0]))
