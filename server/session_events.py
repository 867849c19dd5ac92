"""Edge events that act on the session, by name: what each one calls and what it answers."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from server.messages import Outcome
from sim.backends.hardware.backend import unavailable_because
from sim.backends.protocol import Backend, BackendError
from sim.backends.simulation.applied_wrenches import ActiveWrench
from sim.backends.simulation.mujoco_backend import KEYFRAMES
from sim.runtime.robot_session import RobotSession
from sim.runtime.session import Session, SessionError
from sim.runtime.simulation import Simulation
from sim.scenes import SCENE_NAMES

SLOW_EVENTS = frozenset(
    {"reset", "set_scene", "set_parameters", "select_controller", "set_mismatch", "branch", "start_recording"}
)
"""Known to take longer than a tick; the loop excuses them."""

READING_EVENTS = frozenset({"list_wrenches", "get_task"})
"""Change nothing."""

_SIMULATION_ONLY = {
    "reset": "reset",
    "set_scene": "the scene",
    "set_parameters": "the scene",
    "set_mismatch": "mismatch",
    "add_wrench": "wrenches",
    "list_wrenches": "wrenches",
    "remove_wrench": "wrenches",
}
_NOT_OFFERED = {
    event: f"{what}: simulation only; PUT /api/v1/backend with 'simulation' first" for event, what in _SIMULATION_ONLY.items()
} | {"drive": "the simulated robot has no drives to engage; PUT /api/v1/backend with 'hardware' first"}
"""Why a session that does not offer an event refuses it, and what to do."""


class EventError(Exception):
    """An event that was not carried out."""

    def __init__(self, outcome: Outcome, message: str) -> None:
        super().__init__(message)
        self.outcome = outcome


def describe(session: Session[Backend]) -> dict[str, Any]:
    """What can be selected, for pages and error messages; no scenes and keyframes but in simulation."""
    reason = unavailable_because()
    simulated = isinstance(session, Simulation)
    return {
        "controllers": list(session.pipeline.controller_names),
        "estimators": list(session.pipeline.estimator_names),
        "scenes": list(SCENE_NAMES) if simulated else [],
        "keyframes": list(KEYFRAMES) if simulated else [],
        "backends": [
            {"name": "simulation", "available": True, "reason": None},
            {"name": "hardware", "available": reason is None, "reason": reason},
            {"name": "replay", "available": True, "reason": None},
        ],
    }


def offered_events(session: Session[Backend]) -> dict[str, Callable[..., Any]]:
    """The calls of a session by the names of their events: those of every session, and those that only its kind has."""
    events: dict[str, Callable[..., Any]] = {
        "select_controller": session.select_controller,
        "select_estimator": session.select_estimator,
        "tare": session.tare,
        "clear_tare": session.clear_tare,
        "set_tool": session.set_tool,
        "identify_tool": session.identify_tool,
        "estop": session.estop,
        "clear_estop": session.clear_estop,
        "start_task": lambda **task: session.start_task(**task).id,
        "get_task": session.task_fields,
        "abort_task": session.abort_task,
    }
    if isinstance(session, Simulation):
        events |= {
            "reset": session.reset,
            "set_scene": session.set_scene,
            "set_parameters": session.set_parameters,
            "set_mismatch": session.set_mismatch,
            "add_wrench": session.add_wrench,
            "list_wrenches": lambda: [_wrench_fields(active) for active in session.list_wrenches()],
            "remove_wrench": session.remove_wrench,
        }
    if isinstance(session, RobotSession):
        events["drive"] = session.drive
    return events


class SessionEvents:
    """Carries out events on one session, between two ticks.

    Attributes:
        offered: what each event calls, by its name.
    """

    def __init__(self, session: Session[Backend]) -> None:
        self.offered: Mapping[str, Callable[..., Any]] = offered_events(session)

    def carry_out(self, name: str, arguments: dict[str, Any]) -> Any:
        """Call the session.

        Raises:
            EventError: refused or invalid; the message says why and what to do.
        """
        if name not in self.offered:
            raise EventError(Outcome.REFUSED, _NOT_OFFERED[name])
        try:
            return self.offered[name](**arguments)
        except (SessionError, BackendError) as error:
            raise EventError(Outcome.REFUSED, str(error)) from error
        except ValueError as error:
            raise EventError(Outcome.INVALID, str(error)) from error
        except KeyError as error:
            raise EventError(Outcome.MISSING, str(error.args[0])) from error


def _wrench_fields(active: ActiveWrench) -> dict[str, Any]:
    fields = asdict(active.source)  # pyright: ignore[reportArgumentType]
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    return {"id": active.id, "remaining_s": active.remaining_s, **plain}
