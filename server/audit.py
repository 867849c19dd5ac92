"""Who asked for what and when, one line per command in the log `forcelens.audit`.

A pull at the hand or a slider sends sixty commands a second: of alike ones that follow each other within a second, the first
and the last are written.
"""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

ALIKE_S = 1.0

_log = logging.getLogger("forcelens.audit")


@dataclass(slots=True)
class _Series:
    since_s: float
    more: int = 0
    last: str = ""


class Audit:
    """Any thread may call.

    Args:
        clock: monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._series: dict[tuple[str, str, str], _Series] = {}

    def note(self, who: str, call: str, arguments: Mapping[str, Any], refusal: str = "") -> None:
        """Write a line, now or once what is like it has ended.

        Args:
            who: operator or caller.
            call: what was asked for.
            arguments: of it, by name.
            refusal: why it was refused, empty if it was not.
        """
        said = " ".join(f"{name}={value!r}" for name, value in arguments.items())
        key = (who, call, refusal)
        with self._lock:
            series = self._series.get(key)
            if series is None:
                self._series[key] = _Series(self._clock())
            else:
                series.more, series.last = series.more + 1, said
        if series is None:
            _write(key, said)

    def settle(self) -> None:
        """Write the last of each series that is over; call it often."""
        oldest = self._clock() - ALIKE_S
        with self._lock:
            over = [key for key, series in self._series.items() if series.since_s <= oldest]
            ended = [(key, self._series.pop(key)) for key in over]
        for key, series in ended:
            if series.more:
                _write(key, series.last, series.more)


def _write(key: tuple[str, str, str], said: str, more: int = 0) -> None:
    who, call, refusal = key
    parts = [f"{who}: {call}", said, f"(the last of {more} more)" if more else "", f"refused: {refusal}" if refusal else ""]
    level = logging.WARNING if refusal else logging.INFO
    _log.log(level, "%s", " ".join(filter(None, parts)), extra={"operator": who, "call": call})
