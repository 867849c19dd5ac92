"""An exact wrench on the simulated robot: where, which, for how long and how often; and what acts now."""

import html
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from sim.backends.simulation.wrenches import FRAMES
from sim.runtime.snapshot import Mode, on_hardware
from web import theme
from web.acting_wrenches import ActingWrenches
from web.robot_pose import RobotPose
from web.sink import ConsoleSink, notify
from web.widget_binding import Worker, attempt

MOST_TIMES = 50
_PICK, _PICKING = "Pick the point in the scene", "Click on the robot, or here to leave it"


def acting_html(rows: list[dict[str, Any]]) -> str:
    """Rows of the server's list of wrenches, one line each."""
    lines = [
        f"<div>{html.escape(row['body'])}: {np.linalg.norm(row['force_n']):.1f} N, {np.linalg.norm(row['torque_nm']):.1f} N m, "
        f"{row['remaining_s']:.1f} s left</div>"
        for row in rows
    ]
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="wrenches">{"".join(lines) or "Nothing acts."}</div>'


@dataclass
class _Series:
    """Wrenches that are still to come.

    Attributes:
        fields: of each.
        left: how many.
        period_s: simulated time from one to the next.
        scene: in which they were asked for; another one ends them.
        seen_s: simulated time when last looked at; a reset ends them.
        due_s: simulated time of the next.
    """

    fields: dict[str, Any]
    left: int
    period_s: float
    client: viser.ClientHandle | None
    scene: bytes = b""
    seen_s: float = -np.inf
    due_s: float = np.nan


class PushPanel:
    """The form; build it inside the container that shall hold it."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink, pose: RobotPose, acting: ActingWrenches) -> None:
        self._server, self._sink, self._pose, self._acting = server, sink, pose, acting
        self._worker = Worker()
        self._series: _Series | None = None
        self._snapshot: np.void | None = None
        gui = server.gui
        self._note = gui.add_html(
            f'<div style="{theme.SMALL_TEXT}">Pushes act on the simulated robot only.</div>', visible=False
        )
        self.form = gui.add_folder("Exact wrench")
        with self.form:
            self.body = gui.add_dropdown("On body", pose.bodies, initial_value="end_effector")
            self.point = gui.add_vector3("At point [m]", (0.0, 0.0, 0.0), step=0.01, hint="In the body's frame.")
            self.pick = gui.add_button(_PICK, icon=viser.Icon.TARGET)
            self.frame = gui.add_dropdown("Frame", FRAMES, initial_value="heading", hint="Of force and torque.")
            self.force = gui.add_vector3("Force [N]", (20.0, 0.0, 0.0), step=1.0)
            self.torque = gui.add_vector3("Torque [N m]", (0.0, 0.0, 0.0), step=0.5)
            self.duration = gui.add_number("Lasts [s]", 2.0, min=0.002, max=600.0, step=0.1, hint="With both ramps.")
            self.ramp = gui.add_number("Ramp [s]", 0.2, min=0.0, max=300.0, step=0.05, hint="Of the rise, and of the fall.")
            self.times = gui.add_number("Times", 1, min=1, max=MOST_TIMES, step=1)
            self.pause = gui.add_number("Pause [s]", 0.5, min=0.0, max=600.0, step=0.1, hint="From one to the next.")
            self.apply = gui.add_button("Apply", icon=viser.Icon.ARROW_UP_RIGHT)
            self.end = gui.add_button("End all")
            self.table = gui.add_html("")

        @self.apply.on_click
        async def _(event: viser.GuiEvent) -> None:
            series = _Series(self.fields(), int(self.times.value), self.duration.value + self.pause.value, event.client)
            self._series = None
            self._worker.submit("apply", lambda: attempt(lambda: self._begin(series), event.client))

        @self.end.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._series = None
            for row in self._acting.rows():
                key = row["id"]
                self._worker.submit(("end", key), lambda key=key: attempt(lambda: sink.remove_wrench(key), event.client))

        @self.pick.on_click
        async def _(_: viser.GuiEvent) -> None:
            self._picking(self.pick.label == _PICK)

    def fields(self) -> dict[str, Any]:
        """The wrench as entered, as the body of a POST /wrenches."""
        return {
            "body": self.body.value,
            "point_m": list(self.point.value),
            "frame": self.frame.value,
            "force_n": list(self.force.value),
            "torque_nm": list(self.torque.value),
            "duration_s": self.duration.value,
            "ramp_s": self.ramp.value,
        }

    def update(self, snapshot: np.void) -> None:
        """Show what acts at the time of a SNAPSHOT record, and send what is due of a series."""
        self._snapshot = snapshot
        simulated = not on_hardware(snapshot)
        if self.form.visible != simulated:
            self.form.visible = simulated
            self._note.visible = not simulated
        content = acting_html(self._acting.rows())
        if content != self.table.content:
            self.table.content = content
        if self._series is not None and not self._goes_on(self._series, snapshot):
            self._series = None

    def _begin(self, series: _Series) -> None:
        self._sink.add_wrench(**series.fields)
        series.left -= 1
        self._series = series

    def _goes_on(self, series: _Series, snapshot: np.void) -> bool:
        """Send the next wrench when it is due; false when the series is over, or a stop, a reset or a scene has ended it."""
        now, scene = float(snapshot["time_s"]), bytes(snapshot["scene"])
        if series.left <= 0 or snapshot["mode"] in (Mode.ESTOP, Mode.FAULT) or on_hardware(snapshot):
            return False
        if series.seen_s == -np.inf:
            series.scene, series.due_s = scene, now + series.period_s
        if now < series.seen_s or scene != series.scene:
            return False
        series.seen_s = now
        if now >= series.due_s:
            series.due_s += series.period_s
            series.left -= 1
            self._worker.submit(
                ("again", series.left), lambda: attempt(lambda: self._sink.add_wrench(**series.fields), series.client)
            )
        return True

    def _picking(self, on: bool) -> None:
        """Let the next click in the scene choose body and point, or leave it."""
        self._server.scene.remove_click_callback("all")
        self.pick.label = _PICKING if on else _PICK
        if not on:
            return

        @self._server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            if self.choose(np.array(event.ray_origin), np.array(event.ray_direction)):
                self._picking(False)
            else:
                notify(event.client, "there is no robot at this place; click on it")

    def choose(self, origin: np.ndarray, direction: np.ndarray) -> bool:
        """Enter the body and the point that a ray in world, (3,) m and (3,), meets; false when it meets none."""
        if self._snapshot is None:
            return False
        self._pose.update(self._snapshot)
        hit = self._pose.hit(origin, direction)
        if hit is None:
            return False
        x, y, z = (round(float(each), 3) for each in hit[1])
        self.body.value, self.point.value = hit[0], (x, y, z)
        return True
