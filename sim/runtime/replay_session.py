"""The session of a recording: it shows what was, and sends nothing to anybody."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from control.timing import TICK_S
from sim.recording.reader import Recording
from sim.runtime.session import SessionError
from sim.runtime.snapshot import Mode

BACKEND = "replay"
_ONLY_SHOWS = "a recording is shown, which cannot be acted on; PUT /api/v1/backend with 'simulation' first"


class ReplaySession:
    """What a control loop steps while it shows a recording.

    Args:
        path: of the recording.

    Raises:
        RecordingFormatError: it is none, or of another version; a ValueError.
    """

    def __init__(self, path: Path) -> None:
        self._recording = Recording(path)
        self._latched = False
        self.time_s = 0.0
        self.own_deeds = {"reset": 0, "tare": 0}
        metadata = self._recording.metadata
        self.pipeline = SimpleNamespace(
            controller_names=(metadata["controller"],), estimator_names=self._recording.estimators, estop_latched=False
        )
        self.backend = SimpleNamespace(name=BACKEND, close=self._recording.close)

    @property
    def duration_s(self) -> float:
        """Of the recording."""
        return self._recording.duration_s

    @property
    def mode(self) -> Mode:
        """ESTOP while the e-stop is latched, though there is nothing to stop."""
        return Mode.ESTOP if self._latched else Mode.RUNNING

    def tick_setpoint(self, _setpoint: np.void, _age_s: float) -> None:
        """Go on by a tick, to the end."""
        self.time_s = min(self.time_s + TICK_S, self.duration_s)

    def seek(self, time_s: float) -> None:
        """Show another moment, s since the start.

        Raises:
            ValueError: the recording does not reach it.
        """
        if not 0.0 <= time_s <= self.duration_s:
            raise ValueError(f"the recording does not reach {time_s:g} s; 0 to {self.duration_s:.3f} s")
        self.time_s = time_s

    def fill(self, record: np.void) -> None:
        """Fill a SNAPSHOT record with what was then. Its time is that since the recording's start."""
        found = self._recording.snapshot(self.time_s)
        if found is None:
            found = self._recording.snapshot(self.duration_s)
        if found is not None:
            for name in record.dtype.names or ():
                record[name] = found[name]
        record["time_s"] = self.time_s
        record["backend"] = BACKEND
        record["mode"] = self.mode
        record["failure"] = b""
        record["past"], record["branch"] = False, 0
        record["drive_state"], record["drag_active"], record["task_in_charge"] = 0, False, False

    def track_errors(self, interval_s: float) -> None:
        """The errors of then are in the recording."""

    def estop(self) -> None:
        """Latched, for whoever presses it expects that."""
        self._latched = True

    def clear_estop(self) -> None:
        """See `estop`."""
        self._latched = False

    def refuse(self, *_: Any, **__: Any) -> Any:
        """
        Raises:
            SessionError: always.
        """
        raise SessionError(_ONLY_SHOWS)

    select_controller = select_estimator = tare = clear_tare = set_tool = identify_tool = refuse
    start_task = task_fields = abort_task = refuse
