"""Only the operator who grabbed the hand pulls it, and nobody pulls it for ever."""

import numpy as np
import pytest
import viser

from tests.web.recording_sink import RecordingSink
from web.command_panel import reachable
from web.drag import GrabHandle, TargetGizmo


@pytest.fixture
def grab(server: viser.ViserServer, sink: RecordingSink) -> GrabHandle:
    return GrabHandle(server, sink)


def test_a_second_client_neither_steals_nor_releases_the_hand(grab: GrabHandle, sink: RecordingSink) -> None:
    grab.pull(1, (0.6, 0.0, 0.6))
    grab.pull(2, (9.0, 9.0, 9.0))
    grab.pull(2, None)
    grab.pull(1, (0.7, 0.0, 0.6))
    assert sink.calls == [("set_drag", (0.6, 0.0, 0.6)), ("set_drag", (0.7, 0.0, 0.6))]


def test_after_release_any_client_may_grab(grab: GrabHandle, sink: RecordingSink) -> None:
    grab.pull(1, (0.6, 0.0, 0.6))
    grab.pull(1, None)
    grab.pull(2, (0.5, 0.0, 0.6))
    assert sink.calls[1:] == [("set_drag", None), ("set_drag", (0.5, 0.0, 0.6))]


def test_who_is_refused_does_not_keep_the_others_from_the_hand(
    grab: GrabHandle, sink: RecordingSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: object) -> None:
        raise RuntimeError("another drives")

    grab.pull(1, (0.6, 0.0, 0.6))
    with monkeypatch.context() as patched, pytest.raises(RuntimeError, match="another drives"):
        patched.setattr(sink, "set_drag", refuse)
        grab.pull(1, (0.7, 0.0, 0.6))
    grab.pull(2, (0.5, 0.0, 0.6))
    assert sink.calls[-1] == ("set_drag", (0.5, 0.0, 0.6))


def test_letting_go_without_having_grabbed_does_nothing(grab: GrabHandle, sink: RecordingSink) -> None:
    grab.pull(1, None)
    assert sink.calls == []


def test_the_spring_is_drawn_while_the_simulation_reports_it(grab: GrabHandle, snapshot: np.void) -> None:
    grab.update(snapshot)
    assert not grab.spring.visible
    snapshot["drag_active"] = True
    snapshot["drag_target_in_world"] = [0.8, 0.1, 0.7]
    grab.update(snapshot)
    assert grab.spring.visible
    np.testing.assert_allclose(grab.spring.points[0], [snapshot["end_effector_position_in_world"], [0.8, 0.1, 0.7]], rtol=1e-6)


def test_the_gizmo_stands_at_the_target_and_on_a_force_axis_at_the_hand(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    gizmo = TargetGizmo(server, sink)
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["base_position"] = [1.0, 2.0, 0.36]
    snapshot["command"]["position_m"] = [0.5, 0.1, 0.6]
    snapshot["command"]["mask"] = [0, 0, 1]
    snapshot["applied_command"]["position_m"] = [0.0, 0.0, 0.7]
    gizmo.update(snapshot)
    np.testing.assert_allclose(gizmo.handle.position, [0.9, 2.5, 0.7], atol=1e-9)
    assert gizmo.handle.active_axes == (True, True, False)


def test_moving_the_gizmo_commands_the_reachable_point_in_heading(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    gizmo = TargetGizmo(server, sink)
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["base_position"] = [1.0, 2.0, 0.36]
    gizmo.update(snapshot)
    gizmo.move(np.array([0.9, 2.5, 0.6]))
    gizmo.move(np.array([1.0, 9.0, 0.6]))
    near, far = (call[1]["position_m"] for call in sink.calls)
    np.testing.assert_allclose(near, [0.5, 0.1, 0.6], atol=1e-9)
    np.testing.assert_allclose(far, reachable([7.0, 0.0, 0.6], sink.limits), atol=1e-9)
    assert np.linalg.norm(np.array(far) - sink.limits.shoulder_m) <= sink.limits.reach_m
