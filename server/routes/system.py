"""Health, state and the control process."""

import time

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter, Response

from server.answers.state import StateAnswer
from server.answers.system import HealthAnswer, ReadyAnswer, RestartAnswer
from server.dependencies import TheBuild, TheOperator
from server.readiness import unready_because
from server.responses import json_response, refusals
from server.schemas import RestartRequest
from server.silence import silence_of
from server.state import failure, faults, loop_json, state_json

router = APIRouter(prefix="/api/v1", tags=["system"])

_restarting = CapacityLimiter(2)
"""Threads of its own: calls that wait for a control process that hangs must not delay its end. The second one refuses."""


@router.get(
    "/health",
    response_model=HealthAnswer,
    responses={503: {"model": HealthAnswer, "description": "It is `stalled`, `dead` or `failed`"}},
)
async def get_health(operator: TheOperator, build: TheBuild) -> Response:
    """Whether the control process lives and its backend steps; 200 also while paused."""
    client = operator.client
    snapshot = client.snapshot()
    reason = client.death
    if not client.alive:
        status = "dead"
    elif client.busy:
        status = "busy"
    elif client.stalled:
        status = "stalled"
    else:
        reason = None if snapshot is None else failure(snapshot)
        status = "ok" if reason is None else "failed"
    body: HealthAnswer = {
        "status": status,
        "version": build.version,
        "commit": build.commit,
        "backend": None if snapshot is None else snapshot["backend"].decode(),
        "uptime_s": round(time.monotonic() - operator.started_s, 3),
        "faults": [] if snapshot is None else faults(snapshot),
        "loop": None if snapshot is None else loop_json(snapshot),
    }
    if reason is not None:
        body["reason"] = reason
    return json_response(body, 200 if status in ("ok", "busy") else 503)


@router.get(
    "/ready",
    response_model=ReadyAnswer,
    responses={503: {"model": ReadyAnswer, "description": "It is not ready; `reason` says why"}},
)
async def get_ready(operator: TheOperator) -> Response:
    """Whether commands would act now. Not while the control process starts or a scene loads, when `health` is well."""
    reason = unready_because(operator.client)
    return json_response({"ready": reason is None, "reason": reason}, 200 if reason is None else 503)


@router.get("/state", response_model=StateAnswer, responses=refusals(503))
async def get_state(operator: TheOperator) -> Response:
    """One consistent snapshot. Of a control process that is dead or hangs it is the last one, with mode `fault`.

    `stale_s` tells for how long nothing newer has come, s; 0 while all is well.
    """
    snapshot = operator.client.require_snapshot()
    return json_response(state_json(snapshot, silence=silence_of(operator.client)))


@router.post("/control/restart", response_model=RestartAnswer, responses=refusals(409, 413, 422, 503))
async def restart_control(operator: TheOperator, body: RestartRequest | None = None) -> Response:
    """Start a fresh control process in a safe hold: paused, default command, e-stop kept."""
    force = body is not None and body.force
    await to_thread.run_sync(lambda: operator.restart(force=force), limiter=_restarting)
    return json_response({"status": "ok"})
