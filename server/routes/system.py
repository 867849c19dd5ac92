"""Health, state and the control process."""

import time
from typing import Any

from fastapi import APIRouter, Response

from control.faults import FAULT_WORDS, Fault
from server.dependencies import TheBuild, TheOperator
from server.responses import answers, json_response
from server.schemas import RestartRequest
from server.state import loop_json, state_json

STALLED_AFTER_S = 1.0

router = APIRouter(prefix="/api/v1", tags=["system"])

_LOOP = {
    "rate_hz": 500.0,
    "real_time_factor": 1.0,
    "overruns": 0,
    "lateness_p99_ms": 0.1,
    "tick_median_us": 400.0,
    "rebases": 0,
    "held_s": 0.0,
    "realtime_scheduling": True,
    "speed": 1.0,
}
_HEALTH = {"status": "ok", "version": "0.1.0", "commit": "52b0cd8", "backend": "simulation", "uptime_s": 12.3, "loop": _LOOP}
_COMMAND = {
    "mask": [0, 0, 1],
    "force_n": [0.0, 0.0, 20.0],
    "position_m": [0.586, 0.0, 0.596],
    "orientation_wxyz": [0.955, 0.0, 0.296, 0.0],
    "base_velocity": [0.0, 0.0, 0.0],
    "guidance": False,
}
_STATE = {
    "time_s": 12.34,
    "wall_time_s": 1735689600.0,
    "sequence": 1234,
    "mode": "running",
    "faults": ["TIP_OVER_LIMIT"],
    "fault_words": {"TIP_OVER_LIMIT": FAULT_WORDS[Fault.TIP_OVER_LIMIT]},
    "message": None,
    "backend": "simulation",
    "drive": None,
    "scene": "free",
    "controller": "policy",
    "estimator": "adaptive",
    "command_sequence": 3,
    "command": _COMMAND,
    "applied_command": _COMMAND,
    "base": {
        "position_m": [0.0, 0.0, 0.357],
        "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
        "linear_velocity_mps": [0.0, 0.0, 0.0],
        "angular_velocity_rps": [0.0, 0.0, 0.0],
    },
    "joints": {"names": ["FL_hip", "..."], "position": [0.0], "velocity": [0.0], "torque": [0.0]},
    "end_effector": {
        "position_m": [0.586, 0.0, 0.596],
        "orientation_wxyz": [0.955, 0.0, 0.296, 0.0],
        "force_estimated_n": [0.1, -0.2, 19.8],
        "force_estimates_n": {"gmo_pi": [0.3, 0.1, 19.0], "gmo_cqp": [0.1, 0.0, 19.5], "adaptive": [0.1, -0.2, 19.8]},
        "force_true_n": [0.0, 0.0, 20.0],
        "force_sigma_n": None,
    },
    "contacts": [{"wheel": "FL", "in_contact": True, "force_estimated_n": [0.0, 0.0, 50.0], "force_true_n": None}],
    "mass_scale_estimated": 1.01,
    "mass_scale_true": 1.0,
    "loop": _LOOP,
}


@router.get("/health", responses=answers(_HEALTH, refusable=False) | {503: {"description": "No control process answers"}})
async def health(operator: TheOperator, build: TheBuild) -> Response:
    """Whether the control process lives; 200 also while paused."""
    client = operator.client
    snapshot = client.snapshot()
    if not client.alive:
        status = "dead"
    elif client.busy:
        status = "busy"
    else:
        status = "ok" if client.snapshot_age_s() < STALLED_AFTER_S else "stalled"
    body: dict[str, Any] = {
        "status": status,
        "version": build.version,
        "commit": build.commit,
        "backend": None if snapshot is None else snapshot["backend"].decode(),
        "uptime_s": round(time.monotonic() - operator.started_s, 3),
        "loop": None if snapshot is None else loop_json(snapshot),
    }
    if client.death is not None:
        body["reason"] = client.death
    return json_response(body, 200 if status in ("ok", "busy") else 503)


@router.get("/state", responses=answers(_STATE))
async def state(operator: TheOperator) -> Response:
    """One consistent snapshot. Of a dead control process it is the last one, with mode `fault`."""
    snapshot = operator.client.snapshot()
    if snapshot is None:
        return json_response({"detail": "no snapshot yet; the control process is starting, or died doing so"}, 503)
    return json_response(state_json(snapshot, alive=operator.client.alive))


@router.post("/control/restart", responses=answers({"status": "ok"}))
def restart(operator: TheOperator, body: RestartRequest | None = None) -> Response:
    """Start a fresh control process in a safe hold: paused, default command, e-stop kept."""
    operator.restart(force=body is not None and body.force)
    return json_response({"status": "ok"})
