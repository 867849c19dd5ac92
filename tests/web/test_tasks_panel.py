"""The panel of tasks, the chart of readings and the plan in the scene show what the snapshot and the sink say."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from sim.runtime.snapshot import named
from sim.scenes import parameters
from sim.tasks import TASKS, options_of
from tests.web.recording_sink import RecordingSink
from web.readings_panel import ReadingsPanel
from web.task_plan import TaskPlan
from web.tasks_panel import PAPER, TasksPanel, label, status_html

ANSWER: dict[str, Any] = {
    "name": "wipe",
    "phase": "press <on>",
    "progress": 0.4,
    "outcome": None,
    "reason": None,
    "metrics": {"position_rmse_cm": 0.81, "peak_force_estimated_n": None},
    "plan_m": [[0.5, 0.0, 0.4], [0.6, 0.0, 0.4], [0.6, 0.1, 0.4]],
}


def until(holds: Callable[[], bool]) -> None:
    """Waits for the worker of a panel."""
    deadline = time.monotonic() + 5.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def at_work(snapshot: np.void, name: str) -> np.void:
    snapshot["task_id"], snapshot["task_name"], snapshot["task_in_charge"] = 3, name, True
    return snapshot


def test_status_tells_the_papers_figure_and_the_reason() -> None:
    text = status_html(ANSWER)
    assert "press &lt;on&gt;" in text
    assert "0.81 cm" in text and "2.90 cm" in text
    assert "aborted: the operator took over" in status_html(
        {**ANSWER, "outcome": "aborted", "reason": "the operator took over"}
    )
    assert label("site_yaw_rad") == "site yaw [rad]" and label("loops") == "loops"


def test_the_papers_figures_are_of_metrics_that_exist() -> None:
    for name, figures in PAPER.items():
        task = TASKS[name]({key: option.default for key, option in options_of(name).items()})
        assert set(figures) <= set(task.metrics())


def test_a_task_is_begun_with_its_own_options_and_can_be_aborted(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    sink.tasks.answer = ANSWER
    panel = TasksPanel(server, sink)
    panel.task.value = "pull"
    until(lambda: panel.options["pull"]["time_s"].visible)
    assert not panel.options["push"]["force_n"].visible
    panel.update(at_work(snapshot, "pull"))
    assert panel.abort.visible and not panel.start.visible
    until(lambda: "press &lt;on&gt;" in panel.status.content)
    snapshot["task_outcome"] = 1
    panel.update(snapshot)
    assert panel.start.visible and not panel.abort.visible


def test_readings_have_a_chart_each_and_parameters_a_slider(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    panel = ReadingsPanel(server, sink)
    panel.update(snapshot)
    assert panel.note.visible and not panel.charts
    snapshot["scene"] = b"door"
    snapshot["reading_names"][:2], snapshot["readings"][:2] = [b"door_angle_rad", b"lever_angle_rad"], [0.4, 0.1]
    known = parameters("door")
    snapshot["parameter_names"][: len(known)] = [parameter.name for parameter in known]
    snapshot["parameters"][: len(known)] = [parameter.maximum for parameter in known]
    assert named(snapshot, "reading") == {"door_angle_rad": 0.4, "lever_angle_rad": 0.1}
    panel.update(snapshot)
    panel._next_send_s, snapshot["time_s"] = 0.0, 1.0
    panel.update(snapshot)
    assert list(panel.charts) == ["door_angle_rad", "lever_angle_rad"]
    assert (panel.charts["door_angle_rad"].title or "").endswith("0.400")
    assert {name: slider.value for name, slider in panel.sliders.items()} == {p.name: p.maximum for p in known}
    assert not panel.note.visible


def test_the_plan_is_drawn_where_odometry_says_and_goes_with_the_task(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    sink.tasks.answer = ANSWER
    plan = TaskPlan(server, sink)
    snapshot["base_position"], snapshot["odometry_position"] = [1.0, 2.0, 0.4], [0.2, 0.0]
    snapshot["heading_yaw"], snapshot["odometry_yaw"] = np.pi / 2, 0.0
    plan.update(at_work(snapshot, "wipe"))
    until(lambda: plan.line is not None)
    assert plan.line is not None
    # The odometry began 0.2 m behind, with x ahead, that is along y of the world.
    np.testing.assert_allclose(plan.line.points[0, 0], [1.0, 2.3, 0.4], atol=1e-6)
    snapshot["task_outcome"] = 2
    plan.update(snapshot)
    assert plan.line is None


def test_the_board_keeps_the_trace_of_a_pressing_hand(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    plan = TaskPlan(server, sink)
    snapshot["scene"], snapshot["reading_names"][0] = b"board", b"wiped_share"
    for step in range(5):
        snapshot["end_effector_position_in_world"] = [0.6, 0.02 * step, 0.44]
        snapshot["time_s"] = 0.1 * step
        plan.update(snapshot)
    assert plan.trace is not None and len(plan.trace.points) == 5
    snapshot["time_s"] = 0.0
    snapshot["force_true_n"] = 0.0
    plan.update(snapshot)
    assert plan.trace is None
