"""The operator's command."""

from fastapi import APIRouter, Response

from server.dependencies import TheOperator
from server.responses import answers, json_response
from server.schemas import CommandPatch
from server.state import command_json

router = APIRouter(prefix="/api/v1", tags=["command"])

_EXAMPLE = {
    "mask": [0, 0, 1],
    "force_n": [0.0, 0.0, 20.0],
    "position_m": [0.586, 0.0, 0.596],
    "orientation_wxyz": [0.955, 0.0, 0.296, 0.0],
    "base_velocity": [0.0, 0.0, 0.0],
    "guidance": False,
    "sequence": 4,
}


@router.get("/command", responses=answers(_EXAMPLE, refusable=False))
async def get_command(operator: TheOperator) -> Response:
    """The command as asked, within limits."""
    return json_response(command_json(*operator.command()))


@router.patch("/command", responses=answers(_EXAMPLE))
async def patch_command(body: CommandPatch, operator: TheOperator) -> Response:
    """Change some fields of the command. Answers the command as applied, after limits, with its sequence number."""
    return json_response(command_json(*operator.patch_command(**body.model_dump(exclude_unset=True))))
