"""The latched e-stop. Anyone may press it."""

import asyncio

from fastapi import APIRouter, Response

from server.answers.safety import EstopAnswer
from server.control_client import CALL_TIMEOUT_S
from server.dependencies import TheOperator
from server.errors import ControlDeadError, ControlTimeoutError
from server.responses import json_response, refusals

ROBOT_ATTEMPTS = 20

router = APIRouter(prefix="/api/v1/estop", tags=["safety"])


@router.post("", response_model=EstopAnswer, responses=refusals(503))
async def estop(operator: TheOperator) -> Response:
    """Latch the e-stop. The answer carries the state that the backend reports; a robot stops without a control process too."""
    # Not in the thread pool, where slow calls could be ahead of it.
    try:
        async with asyncio.timeout(CALL_TIMEOUT_S):
            return json_response(await asyncio.wrap_future(operator.submit_estop()))
    except (TimeoutError, ControlDeadError, ControlTimeoutError) as error:
        # A robot's I/O process has been told too, and answers for it.
        for _ in range(ROBOT_ATTEMPTS):
            if operator.robot.stopped():
                return json_response({"latched": True, "mode": "fault"})
            await asyncio.sleep(0.01)
        if isinstance(error, TimeoutError):
            raise ControlTimeoutError("the control process did not confirm the e-stop; cut its power") from None
        raise


@router.post("/clear", response_model=EstopAnswer, responses=refusals(409, 503))
def clear_estop(operator: TheOperator) -> Response:
    """Clear the e-stop; the robot stands up from where it is, with the default command."""
    return json_response(operator.clear_estop())
