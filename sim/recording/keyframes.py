"""The pipeline's state every ten seconds of a recording, from which it can be run again.

What it carries is copied at once, by the history of a simulation where it does so at that tick anyway; to pack it takes
longer than a tick has time, so that is done a little at a time in the ticks that follow.
"""

import logging
from collections.abc import Callable

from control.pipeline import Pipeline
from control.state.capture import Moment, StateError
from control.state.file import StateFileError, StatePacking
from control.timing import TICK_S
from sim.recording.tap import Tap

EVERY_TICKS = round(10.0 / TICK_S)
PATIENCE_TICKS = 250
"""How long the history is waited for, which keeps a moment as often unless a task is at work."""

_PER_TICK = 2
"""Values packed per tick: some 30 us."""

_log = logging.getLogger(__name__)


class Keyframes:
    """Puts keyframes into a tap while a recording is under way.

    Args:
        tap: where the recorder listens.
        kept: the moment that the history has kept at this very tick, None if it has none.
        every: ticks from one to the next.
    """

    def __init__(self, tap: Tap, kept: Callable[[], Moment | None], every: int = EVERY_TICKS) -> None:
        self._tap = tap
        self._kept = kept
        self._every = every
        self.start()

    def start(self) -> None:
        """A recording starts, with the state that it starts from."""
        self._tick = 0  # before which the last one lies
        self._moment: Moment | None = None  # to be packed
        self._packing: StatePacking | None = None
        self._stopped = False

    def ticked(self, pipeline: Pipeline) -> None:
        """A tick of the recording is over, and nothing was done to the pipeline since."""
        if self._stopped:
            return
        try:
            self._advance(pipeline)
        except (StateError, StateFileError) as error:
            self._stopped = True
            _log.warning("the recording has no more keyframes: %s", error)

    def _advance(self, pipeline: Pipeline) -> None:
        if self._moment is not None:
            self._packing, self._moment = StatePacking(pipeline, self._moment), None
        elif self._packing is None:
            self._moment = self._due(pipeline)
        elif self._packing.advance(_PER_TICK):
            self._tap.put_keyframe(self._tick, self._packing.data())
            self._packing = None

    def _due(self, pipeline: Pipeline) -> Moment | None:
        waited = self._tap.count - self._tick - self._every
        if waited < 0:
            return None
        moment = self._kept()
        if moment is None and waited >= PATIENCE_TICKS:
            moment = Moment(pipeline)
        if moment is not None:
            self._tick = self._tap.count
        return moment
