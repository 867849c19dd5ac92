"""A recording as a backend: `PUT /api/v1/backend` shows it, and these calls move about in it."""

from fastapi import APIRouter, Response

from server.answers.replay import ReplayAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import ReplayRequest

router = APIRouter(prefix="/api/v1/replay", tags=["recordings"])


@router.get("", response_model=ReplayAnswer, responses=refusals(409, 503))
def get_replay(operator: TheOperator) -> Response:
    """Where the recording that is shown stands."""
    return json_response(operator.past.replay())


@router.patch("", response_model=ReplayAnswer, responses=refusals(409, 413, 422, 503))
def patch_replay(body: ReplayRequest, operator: TheOperator) -> Response:
    """Show another moment, play or pause, at another speed."""
    return json_response(operator.past.change_replay(**body.model_dump(exclude_unset=True)))
