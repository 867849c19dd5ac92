"""Board wiping (paper Sec. IV.B): a figure of eight by position, the press along z by force."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from control.command.limits import CommandLimits
from control.types import Command
from sim.scenes.board import PATTERN_CENTER_M, TOP_HEIGHT_M, pattern
from sim.tasks.task import CONTACT_S, Lasting, Option, Phase, reached, require_reach
from sim.tasks.view import TaskView

PITCH_RAD = 0.6
ABOVE_M = 0.06
TOUCH_N = 3.0
EASE_S = 1.0
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
        self._squares: list[np.ndarray] = []
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
        across, normal, lost = np.mean(self._squares or [np.full(3, np.nan)], axis=0)
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
        above = np.array([*PATTERN_CENTER_M, TOP_HEIGHT_M + ABOVE_M])
        touching, lifted = Lasting(CONTACT_S), Lasting(0.5)

        def press(view: TaskView, force_n: float) -> Command:
            return view.command(above, pitch_rad=PITCH_RAD, mask=(0, 0, 1), force_n=(0.0, 0.0, force_n))

        def wipe(view: TaskView) -> Command:
            self.target_m = self.place(view.phase_s)
            error = view.hand_m[:2] - self.target_m
            felt = view.force_n[2]
            if view.phase_s > EASE_S:
                self._squares.append(np.array([error @ error, (felt - self._force) ** 2, felt < 0.5]))
            ahead = self.place(min(view.phase_s + LEAD_S, self._duration))
            return view.command(
                np.array([*ahead, TOP_HEIGHT_M]), pitch_rad=PITCH_RAD, mask=(0, 0, 1), force_n=(0.0, 0.0, self._force)
            )

        def off_the_board(view: TaskView) -> str | None:
            return "the contact is lost" if view.force_n[2] < 0.3 * self._force else None

        yield Phase(
            "approach",
            lambda view: view.command(above, pitch_rad=PITCH_RAD),
            lambda view: view.phase_s > 1.0 and reached(view, above),
            limit_s=6.0,
            late="the hand does not come above the board",
            until=0.1,
        )
        yield Phase(
            "touch",
            lambda view: press(view, TOUCH_N),
            lambda view: touching(view, view.force_n[2] > 2.0),
            limit_s=5.0,
            late="no board is met",
            until=0.15,
        )
        yield Phase("press", lambda view: press(view, self._force), lambda _: False, limit_s=1.5, until=0.2)
        yield Phase("wipe", wipe, lambda _: False, limit_s=self._duration, wrong=off_the_board, until=0.95)
        self.target_m = None
        yield Phase(
            "lift",
            lambda view: view.command(above + [0.0, 0.0, 0.03], pitch_rad=PITCH_RAD),
            lambda view: lifted(view, abs(float(view.force_n[2])) < 2.0 and view.phase_s > 0.5),
            limit_s=4.0,
            late="the hand does not come off the board",
        )
