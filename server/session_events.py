"""Edge events that act on the session, by name: what each one calls and what it answers."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from server.messages import Outcome
from sim.backends.hardware.backend import unavailable_because
from sim.backends.protocol import BackendError
from sim.backends.simulation.mujoco_backend import KEYFRAMES
from sim.runtime.hardware_session import HardwareSession
from sim.runtime.session import Session, SessionError
from sim.scenes import SCENE_NAMES

SLOW_EVENTS = frozenset({"reset", "set_scene", "select_controller", "set_mismatch"})
"""Known to take longer than a tick; the loop excuses them."""


class EventError(Exception):
    """An event that was not carried out."""

    def __init__(self, outcome: Outcome, message: str) -> None:
        super().__init__(message)
        self.outcome = outcome


def describe(session: Session) -> dict[str, Any]:
    """What can be selected, for pages and error messages."""
    reason = unavailable_because()
    return {
        "controllers": list(session.pipeline.controller_names),
        "estimators": list(session.pipeline.estimator_names),
        "scenes": list(SCENE_NAMES),
        "keyframes": list(KEYFRAMES),
        "backends": [
            {"name": "simulation", "available": True, "reason": None},
            {"name": "hardware", "available": reason is None, "reason": reason},
        ],
    }


class SessionEvents:
    """Carries out events on one session, between two ticks."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._handlers: Mapping[str, Callable[..., Any]] = {
            "reset": session.reset,
            "set_scene": session.set_scene,
            "select_controller": session.select_controller,
            "select_estimator": session.select_estimator,
            "set_mismatch": session.set_mismatch,
            "clear_estop": session.clear_estop,
            "add_wrench": session.add_wrench,
            "list_wrenches": self._list_wrenches,
            "remove_wrench": session.remove_wrench,
            "drive": self._drive,
        }

    def carry_out(self, name: str, arguments: dict[str, Any]) -> Any:
        """Call the session.

        Raises:
            EventError: refused or invalid; the message says why and what to do.
        """
        handler = self._handlers[name]
        try:
            return handler(**arguments)
        except (SessionError, BackendError) as error:
            raise EventError(Outcome.REFUSED, str(error)) from error
        except ValueError as error:
            raise EventError(Outcome.INVALID, str(error)) from error
        except KeyError as error:
            raise EventError(Outcome.MISSING, str(error.args[0])) from error

    def _drive(self, request: str) -> int:
        if not isinstance(self._session, HardwareSession):
            raise SessionError("the simulated robot has no drives to engage; PUT /api/v1/backend with 'hardware' first")
        return self._session.drive(request)

    def _list_wrenches(self) -> list[dict[str, Any]]:
        return [
            {"id": active.id, "remaining_s": active.remaining_s, **_plain(asdict(active.source))}  # pyright: ignore[reportArgumentType]
            for active in self._session.list_wrenches()
        ]


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
