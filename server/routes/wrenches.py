"""Exact wrenches on the simulated robot."""

from typing import Annotated

from fastapi import APIRouter, Path, Response

from server.dependencies import TheOperator
from server.responses import answers, json_response
from server.schemas import WrenchRequest

router = APIRouter(prefix="/api/v1/wrenches", tags=["wrenches"])

_WRENCH = {
    "id": 1,
    "remaining_s": 1.5,
    "force_n": [0.0, 0.0, -20.0],
    "duration_s": 2.0,
    "torque_nm": [0.0, 0.0, 0.0],
    "point_m": [0.0, 0.0, 0.0],
    "body": "end_effector",
    "frame": "heading",
    "ramp_s": 0.2,
}


@router.get("", responses=answers([_WRENCH]))
def list_wrenches(operator: TheOperator) -> Response:
    """What acts now, oldest first."""
    return json_response(operator.client.call("list_wrenches"))


@router.post("", status_code=201, responses=answers({"id": 1}, status=201))
def add_wrench(body: WrenchRequest, operator: TheOperator) -> Response:
    """Apply a wrench, in addition to those that act already; it expires by itself."""
    return json_response({"id": operator.client.call("add_wrench", **body.model_dump())}, 201)


@router.delete("/{wrench_id}", status_code=204, responses=answers(None, status=204))
def remove_wrench(wrench_id: Annotated[int, Path(ge=1, examples=[1])], operator: TheOperator) -> Response:
    """End a wrench now; 404 if it is not at work."""
    operator.client.call("remove_wrench", key=wrench_id)
    return Response(status_code=204)
