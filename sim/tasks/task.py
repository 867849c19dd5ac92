"""What a task is: options, a check before anything moves, and named phases, one after the other.

Phases and not a behaviour tree: what a hand does at a valve or a door is a line of steps, each with one way on and one reason
to fail, and a generator says that in the order in which it happens.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from control.command.limits import DEFAULT_COMMAND, CommandLimits, clip_command
from control.types import Command
from sim.tasks.view import TaskView

ZERO_S = 0.8
"""More than what a tare takes the mean of."""

REACHED_M = 0.02
"""A hand so close to its target has reached it; limits may not move a target farther."""


@dataclass(frozen=True, slots=True)
class Option:
    """A number that shapes a task; its name carries the unit where `unit` does not say it all."""

    default: float
    minimum: float
    maximum: float
    unit: str


SITE_OPTIONS = {
    "site_x_m": Option(0.0, -20.0, 20.0, "m"),
    "site_y_m": Option(0.0, -20.0, 20.0, "m"),
    "site_yaw_rad": Option(0.0, -3.15, 3.15, "rad"),
}
"""Where the frame of the site is believed to lie in the robot's odometry; of every task."""


class TaskRefusedError(RuntimeError):
    """A task that cannot begin from here; the message says why and what to do."""


def never(_: TaskView) -> str | None:
    """A guard that finds nothing wrong."""
    return None


@dataclass(frozen=True, slots=True)
class Phase:
    """One step of a task.

    Attributes:
        name: for people.
        command: asked anew every control period.
        done: whether the next phase begins.
        limit_s: time after which it is over.
        late: why the task has then failed; None where time is what ends the phase.
        wrong: why the task must stop, such as a contact that is lost; None while all is well.
        patience_s: for how long that must last.
        until: progress, 0 to 1, at the end of the phase.
        recover: told the reason of a failure, which does not end the task then: the hand backs off, and the next phase begins.
    tares: what the hand reads at the end becomes its zero, where it is free and still.
    """

    name: str
    command: Callable[[TaskView], Command]
    done: Callable[[TaskView], bool]
    limit_s: float
    late: str | None = None
    wrong: Callable[[TaskView], str | None] = never
    patience_s: float = 0.5
    until: float = 1.0
    recover: Callable[[str], None] | None = None
    tares: bool = False


class Task(Protocol):
    """One attempt at something. A task sees estimates only, and commands nothing that an operator could not."""

    NAME: ClassVar[str]
    SCENE: ClassVar[str]
    DESCRIPTION: ClassVar[str]
    OPTIONS: ClassVar[Mapping[str, Option]]

    def __init__(self, options: Mapping[str, float]) -> None: ...

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """
        Raises:
            TaskRefusedError: it cannot begin from here.
        """

    def phases(self) -> Iterator[Phase]:
        """The phases; the next one is asked for when the last one is done."""
        ...

    def metrics(self) -> dict[str, float]:
        """What there is to say about it so far; names carry units."""
        ...

    def plan(self) -> np.ndarray:
        """(n, 3) m, in the site's frame: a line that shows what is meant, for drawing."""
        ...


def require_reach(what: str, points_m: np.ndarray, view: TaskView, limits: CommandLimits) -> None:
    """
    Raises:
        TaskRefusedError: a point (n, 3) of the site's frame is out of the hand's reach from here.
    """
    for point in np.atleast_2d(points_m):
        wanted = view.in_heading(point)
        command = Command(np.zeros(3), np.zeros(3), wanted, DEFAULT_COMMAND.orientation_wxyz, np.zeros(3))
        if np.linalg.norm(clip_command(command, limits).position_m - wanted) > REACHED_M:
            at = ", ".join(f"{value:.2f}" for value in wanted)
            raise TaskRefusedError(
                f"{what} is out of reach: it is believed at ({at}) m in the heading frame. Drive the robot to where the site "
                "lies ahead of it, reset the scene, or say with the options site_x_m, site_y_m and site_yaw_rad where it is"
            )


def zeroing(command: Callable[[TaskView], Command], until: float) -> Phase:
    """The hand rests before it touches anything, and what it reads there becomes its zero: most of an estimate's error over the
    next minute is what the model's masses lack in this posture.
    """
    return Phase("zero", command, lambda _: False, limit_s=ZERO_S, until=until, tares=True)


def reached(view: TaskView, point_m: np.ndarray, within_m: float = REACHED_M) -> bool:
    """Whether the hand is at a point (3,) of the site's frame."""
    return bool(np.linalg.norm(view.hand_m - point_m) < within_m)


class RunningMean:
    """Mean of vectors (size,) that come one by one; not a number before the first."""

    def __init__(self, size: int) -> None:
        self._sum, self._count = np.zeros(size), 0

    def add(self, values: np.ndarray) -> None:
        """One more."""
        self._sum += values
        self._count += 1

    def __call__(self) -> np.ndarray:
        """The mean (size,)."""
        return self._sum / self._count if self._count else np.full(len(self._sum), np.nan)


class Lasting:
    """Whether something has been true for a while."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._since_s: float | None = None

    def __call__(self, view: TaskView, holds: bool) -> bool:
        """Tell what holds now."""
        if not holds:
            self._since_s = None
            return False
        self._since_s = view.time_s if self._since_s is None else self._since_s
        return view.time_s - self._since_s >= self._seconds


CONTACT_S = 0.06
"""A force must be felt so long to be a contact: a moving hand feels its own jerks."""
