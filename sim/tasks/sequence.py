"""Several tasks in a row in the workshop (the paper's future work): drive to each, play it, try again where it fails.

The plan is short: what comes first, second and third. What comes next is chosen by what was felt: a task that failed has
backed off; the robot drives back, and comes again; what fails twice is left out.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.scenes.workshop import HUB_M, PLACES
from sim.tasks.door import Door
from sim.tasks.task import Option, Phase, Task, TaskRefusedError
from sim.tasks.valve import Valve
from sim.tasks.view import Site, TaskView
from sim.tasks.wipe import Wipe

KINDS: Mapping[int, tuple[str, type[Task], Mapping[str, float]]] = {
    1: ("valve", Valve, {"place_s": 15.0, "drive_s": 0.0}),
    2: ("board", Wipe, {"loops": 1.0}),
    3: ("door", Door, {}),
}
"""By number of the plan: the place, the task, and its options that are not at their defaults."""
_DOOR = 3
TRIES = 2
NEAR_M, FACING_RAD = 0.02, 0.03
SPEED_MPS, TURN_RPS = 0.25, 0.4


class Sequence:
    """Plays up to three tasks of the workshop."""

    NAME: ClassVar[str] = "sequence"
    SCENE: ClassVar[str] = "workshop"
    DESCRIPTION: ClassVar[str] = "Open the valve, wipe the board, leave through the door, in the order of a plan"
    OPTIONS: ClassVar[Mapping[str, Option]] = {
        name: Option(default, 0.0, 3.0, "1 valve, 2 board, 3 door, 0 nothing")
        for name, default in (("first", 1.0), ("second", 2.0), ("third", 3.0))
    }

    def __init__(self, options: Mapping[str, float]) -> None:
        self._plan = [int(options[name]) for name in ("first", "second", "third") if options[name] >= 1.0]
        self._done, self._tries, self._failed = 0, 0, ""
        self._metrics: dict[str, float] = {}

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task."""
        if not self._plan:
            raise TaskRefusedError("the plan is empty; set the options first, second and third")
        if _DOOR in self._plan[:-1]:
            raise TaskRefusedError("the door must come last in the plan: it closes behind the robot")
        if np.hypot(*(view.position_m - HUB_M)) > 1.0 or abs(view.yaw_rad) > 0.3:
            raise TaskRefusedError("the robot does not stand where the workshop begins; reset the scene")

    def plan(self) -> np.ndarray:
        """The way of the base between the places."""
        points = [(0.0, 0.0), HUB_M]
        for number in self._plan:
            place = PLACES[KINDS[number][0]]
            points += [(place.x_m, place.y_m), HUB_M]
        return np.array([[x, y, 0.02] for x, y in points])

    def metrics(self) -> dict[str, float]:
        """How many steps were done, and what there is to say about each."""
        return {"steps": float(len(self._plan)), "steps_done": float(self._done), "tries": float(self._tries), **self._metrics}

    def phases(self) -> Iterator[Phase]:
        """See Task."""
        for index, number in enumerate(self._plan):
            place, kind, options = KINDS[number]
            last = index + 1 == len(self._plan)
            begin, end = index / len(self._plan), (index + 1) / len(self._plan)
            for attempt in range(TRIES):
                self._tries += 1
                yield from self._go(place, begin, fresh=index == 0 and attempt == 0)
                task = kind({key: options.get(key, option.default) for key, option in kind.OPTIONS.items()})
                self._failed = ""
                for phase in task.phases():
                    progress = begin + phase.until * (end - begin)
                    yield self._at(place, phase, progress, gives_up=last and attempt + 1 == TRIES)
                    if self._failed:
                        break
                self._metrics |= {f"{place}_{key}": value for key, value in task.metrics().items()}
                if not self._failed:
                    self._done += 1
                    break
        if self._done < len(self._plan):
            missing = f"{len(self._plan) - self._done} of {len(self._plan)} steps were not done"
            yield Phase("report", lambda _: carry(0.0, 0.0), lambda _: False, limit_s=CONTROL_PERIOD_S, late=missing)

    def _at(self, place: str, phase: Phase, until: float, *, gives_up: bool) -> Phase:
        """A phase of a task that works in the frame of a place; what goes wrong in it is noted, and backed off from."""
        where = PLACES[place]
        site = Site(where.x_m, where.y_m, where.yaw_rad)

        def failed(reason: str) -> None:
            self._failed = reason

        return replace(
            phase,
            name=f"{place} {phase.name}",
            command=lambda view: phase.command(view.seen_from(site)),
            done=lambda view: phase.done(view.seen_from(site)),
            wrong=lambda view: phase.wrong(view.seen_from(site)),
            until=until,
            recover=None if gives_up else failed,
        )

    def _go(self, place: str, until: float, *, fresh: bool) -> Iterator[Phase]:
        """Drive to where the task at a place begins: straight to the hub, turn, straight ahead."""
        goal = PLACES[place]
        if fresh and place == "valve":
            return
        hub = np.array(HUB_M)

        def along(view: TaskView, point: np.ndarray) -> float:
            off = point - view.position_m
            return float(np.cos(view.yaw_rad) * off[0] + np.sin(view.yaw_rad) * off[1])

        def facing(view: TaskView) -> float:
            return float(np.angle(np.exp(1j * (goal.yaw_rad - view.yaw_rad))))

        def drive(view: TaskView, point: np.ndarray) -> Command:
            ahead = float(np.clip(1.5 * along(view, point), -SPEED_MPS, SPEED_MPS))
            return carry(ahead, 0.0)

        def there(view: TaskView) -> bool:
            return abs(along(view, hub)) < NEAR_M

        def turn(view: TaskView) -> Command:
            return carry(0.0, float(np.clip(1.5 * facing(view), -TURN_RPS, TURN_RPS)))

        def come(view: TaskView) -> Command:
            off = view.position_m - [goal.x_m, goal.y_m]
            aside = float(-np.sin(goal.yaw_rad) * off[0] + np.cos(goal.yaw_rad) * off[1])
            ahead = float(np.clip(1.2 * along(view, np.array([goal.x_m, goal.y_m])), -SPEED_MPS, SPEED_MPS))
            rate = 1.2 * (facing(view) - np.clip(2.0 * aside, -0.3, 0.3) * np.sign(ahead))
            return carry(ahead, float(np.clip(rate, -TURN_RPS, TURN_RPS)))

        late = "the robot does not come to its place"
        yield Phase("tuck", lambda _: carry(0.0, 0.0), lambda _: False, limit_s=1.0, until=until)
        yield Phase("drive", lambda view: drive(view, hub), there, limit_s=10.0, late=late, until=until)
        yield Phase("turn", turn, lambda view: abs(facing(view)) < FACING_RAD, limit_s=15.0, late=late, until=until)
        if place != "door":  # which is driven to from here anyway
            spot = np.array([goal.x_m, goal.y_m])
            yield Phase("come", come, lambda view: abs(along(view, spot)) < NEAR_M, limit_s=10.0, late=late, until=until)
        yield Phase("settle", lambda _: carry(0.0, 0.0), lambda _: False, limit_s=0.8, until=until)


def carry(ahead_mps: float, turn_rps: float) -> Command:
    """The hand at its usual place while the base drives."""
    return replace(DEFAULT_COMMAND, base_velocity=np.array([ahead_mps, 0.0, turn_rps]))
