"""Health, state and the control process."""

import time

from fastapi import APIRouter, Response

from server.answers.state import StateAnswer
from server.answers.system import HealthAnswer, RestartAnswer
from server.dependencies import TheBuild, TheOperator
from server.responses import json_response, refusals
from server.schemas import RestartRequest
from server.state import loop_json, state_json

STALLED_AFTER_S = 1.0

router = APIRouter(prefix="/api/v1", tags=["system"])


@router.get(
    "/health",
    response_model=HealthAnswer,
    responses={503: {"model": HealthAnswer, "description": "It is `stalled` or `dead`"}},
)
async def get_health(operator: TheOperator, build: TheBuild) -> Response:
    """Whether the control process lives; 200 also while paused."""
    client = operator.client
    snapshot = client.snapshot()
    if not client.alive:
        status = "dead"
    elif client.busy:
        status = "busy"
    else:
        status = "ok" if client.snapshot_age_s() < STALLED_AFTER_S else "stalled"
    body: HealthAnswer = {
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


@router.get("/state", response_model=StateAnswer, responses=refusals(503))
async def get_state(operator: TheOperator) -> Response:
    """One consistent snapshot. Of a dead control process it is the last one, with mode `fault`."""
    snapshot = operator.client.require_snapshot()
    return json_response(state_json(snapshot, alive=operator.client.alive))


@router.post("/control/restart", response_model=RestartAnswer, responses=refusals(409, 422, 503))
def restart_control(operator: TheOperator, body: RestartRequest | None = None) -> Response:
    """Start a fresh control process in a safe hold: paused, default command, e-stop kept."""
    operator.restart(force=body is not None and body.force)
    return json_response({"status": "ok"})
