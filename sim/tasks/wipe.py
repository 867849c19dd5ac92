"""Board wiping (paper Sec. IV.B): a figure of eight by position, the press along z by force."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from control.command.limits import CommandLimits
from control.types import Command
from sim.scenes.board import PATTERN_CENTER_M, TOP_HEIGHT_M, pattern
from sim.tasks.press import Press
from sim.tasks.task import Option, Phase, RunningMean, require_reach
from sim.tasks.view import TaskView

PITCH_RAD = 0.6
ABOVE_M = 0.06
EASE_S = 1.0
HURRY = 0.8
"""Share of the planar error by which the command runs ahead besides: a rough or bumpy board holds the hand back."""
LEAD_S = 0.09
"""The reference filter and the arm follow so much later: what is commanded runs ahead of what is meant."""


class Wipe:
    """Wipes the board's pattern."""

    NAME: ClassVar[str] = "wipe"
    SCENE: ClassVar[str] = "board"
    DESCRIPTION: ClassVar[str] = "Wipe a figure of eight on the board, pressing evenly"
    OPTIONS: ClassVar[Mapping[str, Option]] = {
        "force_n": Option(15.0, 5.0, 25.0, "N"),
        "half_x_m": Option(0.06, 0.02, 0.10, "m"),
        "half_y_m": Option(0.15, 0.05, 0.24, "m"),
        "period_s": Option(8.0, 5.0, 20.0, "s"),
        "loops": Option(3.0, 1.0, 10.0, ""),
    }

    def __init__(self, options: Mapping[str, float]) -> None:
        self._force = options["force_n"]
        self._half = options["half_x_m"], options["half_y_m"]
        self._period = options["period_s"]
        self._duration = options["loops"] * self._period
        self._squares = RunningMean(3)
        self.target_m: np.ndarray | None = None

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task."""
        require_reach("the board's pattern", self.plan(), view, limits)

    def plan(self) -> np.ndarray:
        """The pattern."""
        points = pattern(np.linspace(0.0, 2.0 * np.pi, 65), self._half)
        return np.column_stack([points, np.full(len(points), TOP_HEIGHT_M)])

    def metrics(self) -> dict[str, float]:
        """Root mean square of the planar error against the pattern, and of the estimated normal force against the one asked."""
        across, normal, lost = self._squares()
        return {
            "position_rmse_cm": 100.0 * float(np.sqrt(across)),
            "force_rmse_n": float(np.sqrt(normal)),
            "contact_share": 1.0 - float(lost),
        }

    def place(self, elapsed_s: float) -> np.ndarray:
        """(2,) m, where the hand is meant to be; it starts and ends in the middle without a jerk."""
        ease = np.clip(min(elapsed_s, self._duration - elapsed_s) / EASE_S, 0.0, 1.0)
        center = np.array(PATTERN_CENTER_M)
        return center + ease * (pattern(2.0 * np.pi * elapsed_s / self._period, self._half) - center)

    def phases(self) -> Iterator[Phase]:
        """See Task."""
        press = Press("board", np.array([*PATTERN_CENTER_M, TOP_HEIGHT_M + ABOVE_M]), PITCH_RAD, self._force)

        def wipe(view: TaskView) -> Command:
            self.target_m = self.place(view.phase_s)
            error = view.hand_m[:2] - self.target_m
            felt = view.force_n[2]
            if view.phase_s > EASE_S:
                self._squares.add(np.array([error @ error, (felt - self._force) ** 2, felt < 0.5]))
            ahead = HURRY * (self.target_m - view.hand_m[:2]) + self.place(min(view.phase_s + LEAD_S, self._duration))
            return view.command(
                np.array([*ahead, TOP_HEIGHT_M]), pitch_rad=PITCH_RAD, mask=(0, 0, 1), force_n=(0.0, 0.0, self._force)
            )

        yield from press.come_down()
        yield Phase("wipe", wipe, lambda _: False, limit_s=self._duration, wrong=press.lost, until=0.95)
        self.target_m = None
        yield from press.lift()
