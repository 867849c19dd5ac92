"""What a task means to do, as a line in the scene, and what the hand has wiped, as a trace on the board."""

import numpy as np
import viser

from control.frames import rotation_z
from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Worker

TRACE_POINTS = 1500
TRACE_STEP_M = 0.004
_INK = (60, 110, 200)
_PRESSED_N = 1.0


class TaskPlan:
    """The line of the task at work, in world; and of the board the trace of the pressing hand."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._api, self._sink, self._worker = server.scene, sink, Worker()
        self._shown_id = 0
        self._points: list[np.ndarray] = []
        self._scene, self._time_s = "", 0.0
        self.line: viser.LineSegmentsHandle | None = None
        self.trace: viser.PointCloudHandle | None = None

    def update(self, snapshot: np.void) -> None:
        """Show the plan of the task of a SNAPSHOT record, and where it wipes."""
        key = int(snapshot["task_id"]) if snapshot["task_in_charge"] and snapshot["task_outcome"] == 0 else 0
        if key != self._shown_id:
            self._shown_id = key
            if self.line is not None:
                self.line.remove()
                self.line = None
            if key:
                yaw = float(snapshot["heading_yaw"] - snapshot["odometry_yaw"])
                origin = snapshot["base_position"] * [1.0, 1.0, 0.0]
                origin = origin - rotation_z(yaw) @ np.append(snapshot["odometry_position"], 0.0)
                self._worker.submit("plan", lambda: self._draw(yaw, origin))
        self._wipe(snapshot)

    def _draw(self, yaw_rad: float, origin_m: np.ndarray) -> None:
        try:
            points = np.array(self._sink.tasks.get()["plan_m"])
        except (ValueError, RuntimeError):
            return  # it is over already
        if len(points) < 2:
            return
        points = points @ rotation_z(yaw_rad).T + origin_m
        segments = np.stack([points[:-1], points[1:]], axis=1)
        self.line = self._api.add_line_segments("/task_plan", segments, theme.TARGET, thickness=0.006)

    def _wipe(self, snapshot: np.void) -> None:
        scene, time_s = snapshot["scene"].decode(), float(snapshot["time_s"])
        if scene != self._scene or time_s < self._time_s:
            self._points.clear()
            if self.trace is not None:
                self.trace.remove()
                self.trace = None
        self._scene, self._time_s = scene, time_s
        if b"wiped_share" not in snapshot["reading_names"] or not snapshot["force_true_n"][2] > _PRESSED_N:
            return
        # The lowest point of the tool's ball, a hair above the board.
        place = snapshot["end_effector_position_in_world"] - [0.0, 0.0, 0.018]
        if self._points and np.linalg.norm(place - self._points[-1]) < TRACE_STEP_M:
            return
        self._points = [*self._points[-TRACE_POINTS + 1 :], place]
        cloud = np.array(self._points, np.float32)
        if self.trace is None:
            self.trace = self._api.add_point_cloud("/wiped", cloud, _INK, point_size=0.012, point_shape="circle")
        else:
            self.trace.points = cloud
