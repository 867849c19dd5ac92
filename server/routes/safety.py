"""The latched e-stop. Anyone may press it."""

import asyncio
import time

from fastapi import APIRouter, Response

from server.answers.safety import EstopAnswer, EstopCheckAnswer
from server.control_client import CALL_TIMEOUT_S
from server.dependencies import TheOperator
from server.errors import ControlTimeoutError
from server.operator import Operator
from server.responses import json_response, refusals
from sim.runtime.snapshot import Mode

POLL_S = 0.001
ROBOT_AFTER_S = 0.2
"""Without an answer of the control process for this long, that of a robot's I/O process counts."""

router = APIRouter(prefix="/api/v1/estop", tags=["safety"])


@router.post("", response_model=EstopAnswer, responses=refusals(503))
async def estop(operator: TheOperator) -> Response:
    """Latch the e-stop. The answer carries the mode that it led to, whoever clears it right afterwards.

    It needs no control process: a robot's I/O process damps, and the next control process starts with the e-stop latched.
    """
    number = operator.estop()
    client, asked_s = operator.client, time.monotonic()
    client.estops.hold_until_taken(number)
    while not client.estops.taken(number):
        waited_s = time.monotonic() - asked_s
        if waited_s > ROBOT_AFTER_S and operator.robot.stopped():
            return _damped()
        if not client.alive and operator.robot.choice.hardware is None:
            return _damped()  # with its process, the simulation has stopped too
        if waited_s > (CALL_TIMEOUT_S if client.alive else 2.0 * ROBOT_AFTER_S):
            raise ControlTimeoutError(_unconfirmed(operator))
        await asyncio.sleep(POLL_S)
    mode = client.estops.mode
    return json_response({"latched": mode is Mode.ESTOP, "mode": mode.name.lower()})


@router.post("/check", response_model=EstopCheckAnswer)
async def check_estop() -> Response:
    """Whether this caller may press the e-stop: refused like it, and nothing changes. A page asks before it says "live"."""
    return json_response({"may_stop": True})


@router.post("/clear", response_model=EstopAnswer, responses=refusals(409, 503))
def clear_estop(operator: TheOperator) -> Response:
    """Clear the e-stop; the robot stands up from where it is, with the default command."""
    return json_response(operator.clear_estop())


def _damped() -> Response:
    return json_response({"latched": True, "mode": "fault"})


def _unconfirmed(operator: Operator) -> str:
    if operator.robot.choice.hardware is not None:
        return "nothing confirmed the e-stop: use the robot's own stop"
    return "the control process did not confirm the e-stop; it acts once that goes on, or after POST /api/v1/control/restart"
