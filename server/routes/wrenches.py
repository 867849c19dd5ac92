"""Exact wrenches on the simulated robot."""

from typing import Annotated

from fastapi import APIRouter, Path, Response

from server.answers.wrenches import WrenchAnswer, WrenchCreatedAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import WrenchRequest

router = APIRouter(prefix="/api/v1/wrenches", tags=["wrenches"])


@router.get("", response_model=list[WrenchAnswer], responses=refusals(503))
def list_wrenches(operator: TheOperator) -> Response:
    """What acts now, oldest first."""
    return json_response(operator.client.call("list_wrenches"))


@router.post("", status_code=201, response_model=WrenchCreatedAnswer, responses=refusals(409, 413, 422, 503))
def add_wrench(body: WrenchRequest, operator: TheOperator) -> Response:
    """Apply a wrench, in addition to those that act already; it expires by itself."""
    return json_response({"id": operator.add_wrench(**body.model_dump())}, 201)


@router.delete("/{wrench_id}", status_code=204, responses=refusals(404, 409, 422, 503))
def remove_wrench(wrench_id: Annotated[int, Path(ge=1, examples=[1])], operator: TheOperator) -> Response:
    """End a wrench now; 404 if it is not at work."""
    operator.remove_wrench(wrench_id)
    return Response(status_code=204)
