"""Who commands. The e-stop is anyone's, whoever holds the lease."""

from fastapi import APIRouter, Response

from server.answers.lease import LeaseAnswer, LeaseTakenAnswer
from server.dependencies import TheOperator
from server.lease import LIFE_S
from server.responses import json_response, refusals
from server.schemas import LeaseRequest

router = APIRouter(prefix="/api/v1/lease", tags=["lease"])


@router.get("", response_model=LeaseAnswer)
async def get_lease(operator: TheOperator) -> Response:
    """Who commands, and whether that is the caller."""
    name, yours, expires_s = operator.leadership.seen()
    return json_response({"operator": name, "yours": yours, "expires_s": expires_s})


@router.post("", response_model=LeaseTakenAnswer, responses=refusals(409, 413, 422))
async def take_lease(body: LeaseRequest, operator: TheOperator) -> Response:
    """Take the lease, or renew one's own. 409 while another holds it and `take_over` is not set.

    Every command of its holder renews it; without any for some seconds it is lost, and the base stops.
    """
    token = operator.leadership.take(body.operator, take_over=body.take_over)
    return json_response({"token": token, "expires_s": LIFE_S})


@router.delete("", status_code=204, responses=refusals(409))
async def release_lease(operator: TheOperator) -> Response:
    """Give the lease back; the base stops. 409 while another holds it."""
    operator.leadership.release()
    return Response(status_code=204)
