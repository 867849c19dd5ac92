"""Whether and how fast a loop ticks: running at a speed, held, or stepping through a hold."""

from typing import Any

from control.timing import TICK_S
from server.messages import Event, Outcome
from server.session_events import EventError

SPEED_RANGE = (0.1, 4.0)
REPLAY_SPEED_RANGE = (0.1, 8.0)
MAX_STEPS = 5000
"""Ten seconds: steps are made at the pace of the robot's own time, whatever the speed."""


class RunControl:
    """Counts ticks down while held. Knows nothing of what is ticked.

    Attributes:
        running: not held.
        speed: simulated over wall-clock time while running.
    """

    def __init__(self, *, running: bool) -> None:
        self.running = running
        self.speed = 1.0
        self._ticks_left = 1  # so that there is something to show in a hold
        self._step: Event | None = None

    @property
    def ticking(self) -> bool:
        """Whether the next turn makes a tick."""
        return self.running or self._ticks_left > 0

    @property
    def period_s(self) -> float:
        """Wall-clock time between two turns."""
        return TICK_S / self.speed if self.running else TICK_S

    def set(self, state: str | None, speed: float | None) -> dict[str, Any]:
        """Run or hold, at a speed; None leaves either as it is. Answers both."""
        if speed is not None:
            self.speed = speed
        if state is not None:
            self.running = state == "running"
        return {"state": "running" if self.running else "paused", "speed": self.speed}

    def step(self, event: Event) -> None:
        """Begin as many ticks as a step event asks for.

        Raises:
            EventError: running, or another step is under way.
        """
        if self.running:
            raise EventError(Outcome.REFUSED, 'the simulation is running; POST /api/v1/run {"state": "paused"} first')
        if self._step is not None:
            raise EventError(Outcome.REFUSED, "a step is still under way; wait for its answer, or pause to end it")
        self._step = event
        self._ticks_left = event.arguments["ticks"]

    def show_one(self) -> None:
        """Make at least one tick, so that a change is seen in a hold."""
        self._ticks_left = max(self._ticks_left, 1)

    def ticked(self) -> Event | None:
        """Count a tick; the step event that it completes, if it does."""
        self._ticks_left = max(self._ticks_left - 1, 0)
        return self.cut_short() if self._ticks_left == 0 else None

    def cut_short(self) -> Event | None:
        """End the step that is under way; its event, None when there is none."""
        event, self._step = self._step, None
        if event is not None:
            self._ticks_left = 0
        return event
