"""What the pipeline drives, and which controller and estimator it uses."""

from fastapi import APIRouter, Response

from server.answers.selection import BackendAnswer, ControllerAnswer, EstimatorAnswer
from server.dependencies import TheOperator
from server.operator import Operator
from server.responses import json_response, refusals
from server.schemas import BackendRequest, ControllerRequest, EstimatorRequest
from server.state import estimator_errors

router = APIRouter(prefix="/api/v1", tags=["selection"])


@router.get("/backend", response_model=BackendAnswer, responses=refusals(503))
def get_backend(operator: TheOperator) -> Response:
    """The backend, and which are available or why not."""
    return json_response(_backend(operator))


@router.put("/backend", response_model=BackendAnswer, responses=refusals(409, 413, 422, 503))
def put_backend(body: BackendRequest, operator: TheOperator) -> Response:
    """Choose the backend: a fresh control process, with the default command. An engaged robot must sit or damp first."""
    operator.set_backend(body.name, **body.options.model_dump(exclude_unset=True))
    return json_response(_backend(operator))


@router.get("/controller", response_model=ControllerAnswer, responses=refusals(503))
def get_controller(operator: TheOperator) -> Response:
    """The controller, and those that can be chosen."""
    return json_response(_controller(operator))


@router.put("/controller", response_model=ControllerAnswer, responses=refusals(409, 413, 422, 503))
def put_controller(body: ControllerRequest, operator: TheOperator) -> Response:
    """Choose the controller."""
    operator.select_controller(body.name)
    return json_response(_controller(operator))


@router.get("/estimator", response_model=EstimatorAnswer, responses=refusals(503))
def get_estimator(operator: TheOperator) -> Response:
    """The estimator that feeds the controller, and all with their live errors where truth exists."""
    return json_response(_estimator(operator))


@router.put("/estimator", response_model=EstimatorAnswer, responses=refusals(409, 413, 422, 503))
def put_estimator(body: EstimatorRequest, operator: TheOperator) -> Response:
    """Choose the estimator, optionally with new gains of its momentum observer."""
    gains = (body.gains.k1, body.gains.k2) if "gains" in body.model_fields_set else None
    operator.select_estimator(body.name, gains)
    return json_response(_estimator(operator))


def _backend(operator: Operator) -> BackendAnswer:
    backend = operator.robot.choice
    return {"name": backend.name, "options": backend.options(), "available": operator.available()["backends"]}


def _controller(operator: Operator) -> ControllerAnswer:
    snapshot = operator.client.require_snapshot()
    return {"name": snapshot["controller"].decode(), "available": operator.available()["controllers"]}


def _estimator(operator: Operator) -> EstimatorAnswer:
    snapshot = operator.client.require_snapshot()
    errors = estimator_errors(snapshot)
    gains = operator.selection.gains
    return {
        "name": snapshot["estimator"].decode(),
        "gains": None if gains is None else {"k1": gains[0], "k2": gains[1]},
        "available": [{"name": name, "error_rms_n": errors.get(name)} for name in operator.available()["estimators"]],
    }
