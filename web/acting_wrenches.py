"""The wrenches that act on the simulated robot, asked for now and then, and their arrows in the scene."""

import time
from concurrent.futures import Future
from typing import Any

import numpy as np
import viser

from control.frames import rotation_z
from sim.runtime.snapshot import on_hardware
from web import theme
from web.force_arrows import METERS_PER_NEWTON, SHOWN_FROM_N, Arrows
from web.robot_pose import RobotPose
from web.sink import ConsoleSink

PERIOD_S = 0.25
MOST_SHOWN = 8


def level(row: dict[str, Any]) -> float:
    """How far a wrench has risen, 0 to 1, from its row of the list."""
    remaining, ramp = row["remaining_s"], row["ramp_s"]
    rising = min(row["duration_s"] - remaining, remaining)
    return 1.0 if ramp <= 0.0 else float(np.clip(rising / ramp, 0.0, 1.0))


class ActingWrenches:
    """What acts, as of now.

    Attributes:
        arrows: one for each of the oldest MOST_SHOWN that act on the robot, at the point where it acts.
    """

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink, pose: RobotPose) -> None:
        self._sink, self._pose = sink, pose
        self._asked: Future[list[dict[str, Any]]] | None = None
        self._listed: list[dict[str, Any]] = []
        self._listed_s = 0.0
        self._next_s = 0.0
        self._now_s = 0.0
        self.arrows = Arrows(server, "/wrenches", [theme.HANDLE] * MOST_SHOWN, 0.0075)

    def rows(self) -> list[dict[str, Any]]:
        """Rows of the server's list, oldest first, with the time that is left now; without what has ended since."""
        passed = max(self._now_s - self._listed_s, 0.0)
        return [row | {"remaining_s": row["remaining_s"] - passed} for row in self._listed if row["remaining_s"] > passed]

    def update(self, snapshot: np.void) -> None:
        """Draw what acts at the time of a SNAPSHOT record; on hardware nothing does."""
        self._now_s = float(snapshot["time_s"])
        if on_hardware(snapshot):
            self._listed = []
        else:
            self._ask()
        self._draw(snapshot)

    def hide(self) -> None:
        """Draw nothing: there is no live snapshot."""
        self.arrows.hide()

    def _ask(self) -> None:
        if self._asked is not None and self._asked.done():
            try:
                self._listed = self._asked.result()
            except (ValueError, RuntimeError):
                self._listed = []  # no control process, of which the page tells enough
            self._listed_s, self._asked = self._now_s, None
        now = time.monotonic()
        if self._asked is None and now >= self._next_s:
            self._next_s = now + PERIOD_S
            try:
                self._asked = self._sink.list_wrenches()
            except (ValueError, RuntimeError):
                self._listed = []

    def _draw(self, snapshot: np.void) -> None:
        origins, vectors = np.zeros((MOST_SHOWN, 3)), np.zeros((MOST_SHOWN, 3))
        shown = np.zeros(MOST_SHOWN, bool)
        rows = [row for row in self.rows() if row["body"] in self._pose.bodies][:MOST_SHOWN]
        if rows:
            self._pose.update(snapshot)
        for index, row in enumerate(rows):
            position, to_world = self._pose.pose(row["body"])
            frames = {"world": np.eye(3), "heading": rotation_z(snapshot["heading_yaw"]), "body": to_world}
            force = level(row) * frames[row["frame"]] @ np.asarray(row["force_n"])
            origins[index] = position + to_world @ np.asarray(row["point_m"])
            vectors[index] = METERS_PER_NEWTON * force
            shown[index] = np.linalg.norm(force) >= SHOWN_FROM_N
        self.arrows.draw(origins, vectors, shown)
