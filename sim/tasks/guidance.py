"""Zero-force guidance (paper Sec. IV.D): whoever leads the hand leads the robot; nobody leads at the end, and it rests."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.types import Command
from sim.tasks.task import Option, Phase
from sim.tasks.view import TaskView

SETTLE_S = 2.0
REST_S = 12.0
"""Watched after the leads; the drift counts from SETTLE_S on."""


class GuidanceTask:
    """Yields to leads for a while, then watches whether the robot rests."""

    NAME: ClassVar[str] = "guidance"
    SCENE: ClassVar[str] = ""
    DESCRIPTION: ClassVar[str] = "Follow whoever leads the hand for a minute; in simulation somebody does"
    OPTIONS: ClassVar[Mapping[str, Option]] = {"lead_s": Option(60.0, 10.0, 600.0, "s")}

    def __init__(self, options: Mapping[str, float]) -> None:
        self._lead_s = options["lead_s"]
        self._path: list[np.ndarray] = []
        self._rest: np.ndarray | None = None
        self._largest_n = self._way_m = self._drift_m = 0.0

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task: it can begin anywhere."""

    def plan(self) -> np.ndarray:
        """Nothing is planned."""
        return np.empty((0, 3))

    def metrics(self) -> dict[str, float]:
        """Largest estimated force of the leads, how far they led the hand, and how far the base went when nobody led it."""
        return {"lead_force_n": self._largest_n, "hand_way_m": self._way_m, "drift_cm": 100.0 * self._drift_m}

    def phases(self) -> Iterator[Phase]:
        """See Task."""

        def follow(view: TaskView) -> Command:
            if view.phase_s > SETTLE_S:
                self._largest_n = max(self._largest_n, float(np.linalg.norm(view.force_n)))
                if not self._path or np.linalg.norm(view.hand_m - self._path[-1]) > 0.02:
                    self._way_m += float(np.linalg.norm(view.hand_m - self._path[-1])) if self._path else 0.0
                    self._path.append(view.hand_m)
            return replace(DEFAULT_COMMAND, guidance=True)

        def watch(view: TaskView) -> Command:
            if view.phase_s > SETTLE_S:
                self._rest = view.position_m if self._rest is None else self._rest
                self._drift_m = max(self._drift_m, float(np.linalg.norm(view.position_m - self._rest)))
            return replace(DEFAULT_COMMAND, guidance=True)

        yield Phase("lead", follow, lambda _: False, limit_s=self._lead_s, until=0.85)
        yield Phase("rest", watch, lambda _: False, limit_s=REST_S)
