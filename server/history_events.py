"""Edge events about the past of a simulation, by name: look at a moment, and go on from one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from server.messages import Outcome
from server.session_events import EventError
from sim.runtime.history import History, HistoryTimeError
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation

BRANCH = "branch"
SEEK = "seek"
HISTORY_EVENTS = frozenset({"history", SEEK, BRANCH})

_ROBOT = "history: simulation only; a robot cannot be set back"
_RUNNING = 'the simulation is running; POST /api/v1/run {"state": "paused"} first'


class HistoryEvents:
    """Carries them out on one session, between two ticks.

    Args:
        session: what is set back.
        history: of it; None where it has none.
        meanwhile: see History.go_back.
    """

    def __init__(self, session: Any, history: History | None, meanwhile: Callable[[], None]) -> None:
        self._session = session
        self._history = history
        self._meanwhile = meanwhile

    def carry_out(self, name: str, arguments: Mapping[str, Any], *, running: bool) -> dict[str, Any]:
        """Answers the fields of server.answers.history.

        Raises:
            EventError: refused or invalid; the message says why and what to do.
        """
        if self._history is None:
            raise EventError(Outcome.REFUSED, _ROBOT)
        if running and name != "history":
            raise EventError(Outcome.REFUSED, _RUNNING)
        try:
            if name == SEEK:
                self._history.show(**arguments)
            elif name == BRANCH:
                return self._branch(self._history, **arguments)
        except SessionError as error:
            raise EventError(Outcome.REFUSED, str(error)) from error
        except HistoryTimeError as error:
            raise EventError(Outcome.INVALID, str(error)) from error
        return _described(self._history)

    def _branch(
        self,
        history: History,
        time_s: float | None = None,
        controller: str | None = None,
        estimator: str | None = None,
        gains: tuple[float, float] | None = None,
        mass_scale: float | None = None,
    ) -> dict[str, Any]:
        session: Simulation = self._session
        history.go_back(time_s, self._meanwhile)
        if controller is not None:
            self._do(session.select_controller, name=controller)
        if estimator is not None or gains is not None:
            k1, k2 = gains or (None, None)
            self._do(session.select_estimator, name=estimator or session.pipeline.estimator_name, k1=k1, k2=k2)
        mismatch = session.backend.mismatch
        if mass_scale is not None:
            mismatch = replace(mismatch, mass_scale=mass_scale)
            rest = {"payload_kg": mismatch.payload_kg, "payload_center_m": mismatch.payload_center_m}
            self._do(session.set_mismatch, mass_scale=mass_scale, per_link=dict(mismatch.per_link), **rest)
        return {
            **_described(history),
            "gains": session.gains,
            "mass_scale": mismatch.mass_scale,
            "per_link": dict(mismatch.per_link),
            "payload_kg": mismatch.payload_kg,
            "payload_center_m": list(mismatch.payload_center_m),
        }

    def _do(self, call: Any, **arguments: Any) -> None:
        call(**arguments)
        assert self._history is not None
        self._history.happened(call, arguments)


def _described(history: History) -> dict[str, Any]:
    return {
        "start_s": history.start_s,
        "end_s": history.end_s,
        "time_s": history.shown_s,
        "past": history.shown is not None,
        "branch": history.branch,
        "trouble": history.trouble,
    }
