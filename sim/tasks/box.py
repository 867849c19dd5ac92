"""Box dragging (paper Sec. III.D): press on the box and drag it to and fro by a lateral force alone."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from control.command.limits import CommandLimits
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.scenes.box import CENTER_X_M, MASS_KG, SLIDE_DAMPING, TOP_HEIGHT_M
from sim.tasks.press import Press
from sim.tasks.task import Option, Phase, RunningMean, require_reach
from sim.tasks.view import TaskView

PITCH_RAD = 1.0
ABOVE_M = 0.05
FREQUENCY_HZ = 0.2
STIFFNESS = 25.0
"""N/m, on what the hand still is off the way meant."""
LARGEST_N = 14.0


class Box:
    """Drags the box by a sine of force that the way asks for."""

    NAME: ClassVar[str] = "box"
    SCENE: ClassVar[str] = "box"
    DESCRIPTION: ClassVar[str] = "Press on the box and drag it to and fro"
    OPTIONS: ClassVar[Mapping[str, Option]] = {
        "press_n": Option(20.0, 15.0, 30.0, "N"),
        "travel_m": Option(0.2, 0.05, 0.25, "m"),
        "periods": Option(2.0, 1.0, 10.0, ""),
    }

    def __init__(self, options: Mapping[str, float]) -> None:
        self._press, self._travel, self._periods = options["press_n"], options["travel_m"], options["periods"]
        self._squares = RunningMean(2)
        self._start_m = self._low_m = self._high_m = 0.0

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task."""
        require_reach("the way of the box", self.plan(), view, limits)

    def plan(self) -> np.ndarray:
        """The way of the box's middle."""
        return np.array([[CENTER_X_M, side * self._travel, TOP_HEIGHT_M] for side in (-1.0, 1.0)])

    def metrics(self) -> dict[str, float]:
        """Root mean square of the errors of the estimated forces, and how far the hand went."""
        lateral, normal = np.sqrt(self._squares())
        return {
            "force_y_rmse_n": float(lateral),
            "force_z_rmse_n": float(normal),
            "y_min_m": self._low_m,
            "y_max_m": self._high_m,
        }

    def way(self, elapsed_s: float) -> float:
        """Where the box is meant to be, m: a sine that grows over its first half period."""
        share = min(1.0, 2.0 * FREQUENCY_HZ * elapsed_s)
        ease = share * share * (3.0 - 2.0 * share)
        return self._travel * ease * float(np.sin(2.0 * np.pi * FREQUENCY_HZ * elapsed_s))

    def force(self, elapsed_s: float, place_m: float) -> float:
        """Lateral force, N, on the box: what its friction and mass take on the way meant, and a spring to it."""
        step = CONTROL_PERIOD_S
        before, now, after = (self.way(max(0.0, elapsed_s + shift)) for shift in (-step, 0.0, step))
        speed, acceleration = (after - before) / (2.0 * step), (after - 2.0 * now + before) / step**2
        force = SLIDE_DAMPING * speed + MASS_KG * acceleration + STIFFNESS * (now - place_m)
        return float(np.clip(force, -LARGEST_N, LARGEST_N))

    def phases(self) -> Iterator[Phase]:
        """See Task."""
        press = Press("box", np.array([CENTER_X_M, 0.0, TOP_HEIGHT_M + ABOVE_M]), PITCH_RAD, self._press)

        def drag(view: TaskView) -> Command:
            if view.phase_s < 0.03:
                self._start_m = float(view.hand_m[1])
            place = float(view.hand_m[1]) - self._start_m
            asked = np.array([0.0, -self.force(view.phase_s, place), self._press])
            if view.phase_s > 0.5:
                self._squares.add((view.force_n - asked)[1:] ** 2)
                self._low_m, self._high_m = min(self._low_m, place), max(self._high_m, place)
            return view.command(press.above_m, pitch_rad=PITCH_RAD, mask=(0, 1, 1), force_n=asked)

        yield from press.come_down()
        yield Phase("drag", drag, lambda _: False, limit_s=self._periods / FREQUENCY_HZ, wrong=press.lost, until=0.95)
        yield from press.lift()
