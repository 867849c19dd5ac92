"""The console: one Viser server behind a door of ours, and the pump that turns snapshots into pixels.

The pump runs at 30 Hz in a thread of its own and rests while nobody watches. It reads the newest snapshot and sets only
what changed; Viser drops superseded messages, so a slow client skips frames instead of falling behind.
"""

import contextlib
import io
import logging
import threading
import time
from collections.abc import Callable

import numpy as np
import viser

from web import theme
from web.acting_wrenches import ActingWrenches
from web.again_panel import AgainPanel
from web.alert import Alert
from web.camera import Camera
from web.charts import ForceCharts
from web.command_panel import CommandPanel
from web.drag import GrabHandle, TargetGizmo
from web.estimators_panel import EstimatorsPanel
from web.force_arrows import ForceArrows
from web.ghost import Ghost
from web.hand_load_panel import HandLoadPanel
from web.hardware_panel import HardwarePanel
from web.history_panel import HistoryPanel
from web.objects import SceneObjects
from web.other_future import OtherFuture
from web.policy_panel import PolicyPanel
from web.push_panel import PushPanel
from web.push_test import PushTests
from web.push_test_panel import PushTestPanel
from web.readings_panel import ReadingsPanel
from web.record_panel import RecordPanel
from web.replay_panel import ReplayPanel
from web.robot_pose import RobotPose
from web.scene import Scene
from web.setup_panel import SetupPanel
from web.sink import ConsoleSink
from web.task_plan import TaskPlan
from web.tasks_panel import TasksPanel
from web.view_panel import ViewPanel
from web.viser_door import ViserDoor, start_viser
from web.wheel_contacts import WheelContacts

PUMP_PERIOD_S = 1.0 / 30.0
AFTER_ERROR_S = 1.0
_PANEL_WIDTH_PX = 320
_CHARTS_WIDTH_PX = 300

_log = logging.getLogger(__name__)


class Console:
    """Everything that Viser shows of one robot, for any number of browsers.

    Attributes:
        door: the way to it.
    """

    def __init__(self, sink: ConsoleSink, snapshot_source: Callable[[], np.void | None], push_tests: PushTests) -> None:
        """
        Args:
            sink: what the operator's actions go to.
            snapshot_source: newest SNAPSHOT record, or None when the control process is dead.
            push_tests: runs them.
        """
        self._snapshot_source = snapshot_source
        self.door = ViserDoor()
        # Viser prints an address, at which there is nothing, and later that it stopped.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = start_viser(self.door, label="Forcelens")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._pump, name="console-pump", daemon=True)
        self._build(sink, push_tests)

    def _build(self, sink: ConsoleSink, push_tests: PushTests) -> None:
        server = self._server
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=theme.BRAND)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._scene = Scene(server)
        self._objects = SceneObjects(server)
        self._other_future, self._ghost = OtherFuture(), Ghost(server)
        self._camera = Camera(server)
        self._forces = ForceArrows(server)
        self._contacts = WheelContacts(server)
        pose = RobotPose()
        self._wrenches = ActingWrenches(server, sink, pose)
        self._grab = GrabHandle(server, sink)
        self._gizmo = TargetGizmo(server, sink)
        self._plan = TaskPlan(server, sink)
        self._alert = Alert(server)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Command"):
            self._command = CommandPanel(server, sink)
        with tabs.add_tab("Tasks"):
            self._tasks = TasksPanel(server, sink)
        with tabs.add_tab("Setup"):
            self._setup = SetupPanel(server, sink)
            self._hand_load = HandLoadPanel(gui, sink)
            self._policy = PolicyPanel(gui)
        with tabs.add_tab("Push"):
            self._push = PushPanel(server, sink, pose, self._wrenches)
            self._push_test = PushTestPanel(gui, push_tests)
        with tabs.add_tab("Time"):
            self._history = HistoryPanel(server, sink)
            self._record = RecordPanel(gui, sink)
            self._replay = ReplayPanel(gui, sink)
            self._again = AgainPanel(gui, sink)
        with tabs.add_tab("Robot"):
            self._hardware = HardwarePanel(server, sink)
        ViewPanel(server, sink, tabs.add_tab("View"), self._camera, self._forces, self._contacts)
        panel = gui.add_panel()
        with panel.add_tab("Force on the hand", viser.Icon.CHART_LINE):
            self._charts = ForceCharts(gui)
        with panel.add_tab("Estimators", viser.Icon.SCALE):
            self._estimators = EstimatorsPanel(gui, sink)
        with panel.add_tab("Scene", viser.Icon.GAUGE):
            self._readings = ReadingsPanel(server, sink)
        panel.dock_left()
        panel.set_width(_CHARTS_WIDTH_PX)

    def start(self) -> None:
        """Start the pump."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the pump and the Viser server."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def has_viewers(self) -> bool:
        """Whether any browser shows the scene."""
        return bool(self._server.get_clients())

    def _pump(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            if self.has_viewers():
                try:
                    self.draw(self._snapshot_source())
                except Exception:
                    # One bad frame must not freeze the page for good; the next frame starts afresh.
                    _log.exception("the console could not draw a snapshot")
                    self._stop.wait(AFTER_ERROR_S)
            due = max(due + PUMP_PERIOD_S, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def draw(self, snapshot: np.void | None) -> None:
        """Show one SNAPSHOT record, or that there is none."""
        with self._server.atomic():
            self._alert.update(snapshot)
            self._hardware.update(snapshot)
            if snapshot is None:
                self._forces.hide()
                self._contacts.hide()
                self._wrenches.hide()
            else:
                self._draw_live(snapshot)
        self._server.flush()

    def _draw_live(self, snapshot: np.void) -> None:
        self._scene.update(snapshot)
        self._objects.update(snapshot)
        self._forces.update(snapshot)
        self._contacts.update(snapshot)
        self._wrenches.update(snapshot)
        self._push.update(snapshot)
        self._push_test.update(snapshot)
        self._grab.update(snapshot)
        self._gizmo.update(snapshot)
        self._camera.update(snapshot)
        self._command.update(snapshot)
        self._setup.update(snapshot)
        self._hand_load.update(snapshot)
        self._policy.update(snapshot)
        self._tasks.update(snapshot)
        self._plan.update(snapshot)
        self._readings.update(snapshot)
        self._history.update(snapshot)
        self._record.update(snapshot)
        self._replay.update(snapshot)
        self._again.update()
        self._other_future.update(snapshot)
        self._ghost.update(float(snapshot["time_s"]), self._other_future)
        self._charts.update(snapshot, self._again if self._again.ready else self._other_future)
        self._estimators.update(snapshot)
