"""The operator's command."""

from fastapi import APIRouter, Response

from server.answers.command import CommandAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import CommandPatch
from server.state import command_json

router = APIRouter(prefix="/api/v1", tags=["command"])


@router.get("/command", response_model=CommandAnswer)
async def get_command(operator: TheOperator) -> Response:
    """The command as asked, within limits. What acts of it is `applied_command` of the state."""
    return json_response(command_json(*operator.command()))


@router.patch("/command", response_model=CommandAnswer, responses=refusals(409, 413, 422, 503))
async def patch_command(body: CommandPatch, operator: TheOperator) -> Response:
    """Ask for a change of some fields of the command. Answers the command as asked, within limits.

    `applied_command` of the state follows it: after guidance, limits, the tip-over limit and rate limits.
    """
    return json_response(command_json(*operator.patch_command(**body.model_dump(exclude_unset=True))))
