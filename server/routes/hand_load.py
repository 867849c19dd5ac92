"""What the hand carries and reads without contact: tare, and the tool."""

from fastapi import APIRouter, Response

from server.answers.hand_load import TareAnswer, ToolAnswer
from server.dependencies import TheOperator
from server.operator import Operator
from server.responses import json_response, refusals
from server.schemas import ToolRequest

router = APIRouter(prefix="/api/v1/estimator", tags=["selection"])


@router.post("/tare", response_model=TareAnswer, responses=refusals(409, 413, 503))
def tare(operator: TheOperator) -> Response:
    """Make what the free hand reads its zero: on position control, at rest, less than 15 N. A reset forgets it."""
    operator.tare()
    return json_response(_tare(operator))


@router.delete("/tare", response_model=TareAnswer, responses=refusals(409, 503))
def clear_tare(operator: TheOperator) -> Response:
    """Take nothing from the estimates any more."""
    operator.clear_tare()
    return json_response(_tare(operator))


@router.get("/tool", response_model=ToolAnswer, responses=refusals(503))
def get_tool(operator: TheOperator) -> Response:
    """What the hand carries, and how far the motion is that finds it."""
    return json_response(_tool(operator))


@router.put("/tool", response_model=ToolAnswer, responses=refusals(409, 413, 422, 503))
def put_tool(body: ToolRequest, operator: TheOperator) -> Response:
    """Tell what the hand carries: the robot carries it from now on, and the estimate tells contact force alone."""
    operator.set_tool(body.mass_kg, body.center_of_mass_m)
    return json_response(_tool(operator))


@router.post("/tool/identify", response_model=ToolAnswer, responses=refusals(409, 413, 503))
def identify_tool(operator: TheOperator) -> Response:
    """Turn the free hand through six postures, in some 11 s, and find what it carries; any other command ends that."""
    operator.identify_tool()
    return json_response(_tool(operator))


def _tool(operator: Operator) -> ToolAnswer:
    record = operator.client.require_snapshot()
    progress = float(record["tool_progress"])
    return {
        "mass_kg": float(record["tool_mass"]),
        "center_of_mass_m": record["tool_center_of_mass"].tolist(),
        "identifying": None if progress != progress else progress,
        "message": record["tool_message"].decode() or None,
    }


def _tare(operator: Operator) -> TareAnswer:
    return {"offset_n": operator.client.require_snapshot()["tare_n"].tolist()}
