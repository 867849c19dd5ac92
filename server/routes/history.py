"""The last minute of a simulation: shown again, and gone on from with something changed."""

from fastapi import APIRouter, Response

from server.answers.history import BranchAnswer, HistoryAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import BranchRequest, SeekRequest

router = APIRouter(prefix="/api/v1/history", tags=["history"])


@router.get("", response_model=HistoryAnswer, responses=refusals(409, 503))
def get_history(operator: TheOperator) -> Response:
    """What is kept, and what of it is shown."""
    return json_response(operator.past.history())


@router.post("/seek", response_model=HistoryAnswer, responses=refusals(409, 413, 422, 503))
def seek_history(body: SeekRequest, operator: TheOperator) -> Response:
    """Show a moment of a paused simulation. To run or to step shows the newest moment again, and goes on from there."""
    return json_response(operator.past.seek(body.time_s))


@router.post("/branch", response_model=BranchAnswer, responses=refusals(409, 413, 422, 503))
def branch_history(operator: TheOperator, body: BranchRequest | None = None) -> Response:
    """Set a paused simulation back to a moment, by default the one that is shown, and change what is given; then it can run on.

    Unchanged it does to the bit what it did before. A latched e-stop stays latched.
    """
    return json_response(operator.past.branch(**(body or BranchRequest()).model_dump(exclude_unset=True)))
