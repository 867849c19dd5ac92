"""Exceptions of controllers and estimators: contained, told once in the log, and named until the culprit works again."""

import logging
from dataclasses import dataclass

from control.faults import Fault
from control.timing import TICK_S

RECOVERED_AFTER_S = 1.0
"""Without an exception for this long a controller or an estimator counts as sound again; an exception now and then is shown
all the time and does not flood the log."""

_log = logging.getLogger(__name__)


class FailureError(RuntimeError):
    """A controller or an estimator failed; the message names it and its exception."""


@dataclass(slots=True)
class _Failure:
    STATE = ("reason", "tick")

    reason: str
    tick: int


class Failures:
    """Who has failed, and why. A culprit is a Fault that says what it is, and its name."""

    STATE = ("_failed",)

    def __init__(self) -> None:
        self._failed: dict[tuple[Fault, str], _Failure] = {}

    def note(self, fault: Fault, name: str, error: Exception, tick: int) -> None:
        """Take in an exception; it is logged with its traceback where the culprit was sound before.

        Args:
            fault: CONTROLLER_ERROR or ESTIMATOR_ERROR.
            name: of the culprit.
            error: what it raised, with its traceback.
            tick: number of this tick.
        """
        failure = self._failed.get((fault, name))
        if failure is None:
            _log.error("%s of %r: %s", fault.name, name, error, exc_info=error)
            self._failed[fault, name] = _Failure(f"{name}, {type(error).__name__}: {error}", tick)
        else:
            failure.tick = tick

    def forgive(self, fault: Fault, name: str) -> None:
        """Forget one culprit: it is given a fresh start, or no longer used."""
        self._failed.pop((fault, name), None)

    def clear(self) -> None:
        """Forget all."""
        self._failed.clear()

    def at(self, tick: int) -> dict[Fault, str]:
        """What each kind of culprit raised, for those that failed within RECOVERED_AFTER_S of a tick; the others are sound."""
        if not self._failed:
            return {}
        self._failed = {key: each for key, each in self._failed.items() if (tick - each.tick) * TICK_S < RECOVERED_AFTER_S}
        reasons: dict[Fault, list[str]] = {}
        for (fault, _), failure in self._failed.items():
            reasons.setdefault(fault, []).append(failure.reason)
        return {fault: "; ".join(each) for fault, each in reasons.items()}
