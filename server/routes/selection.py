"""What the pipeline drives, and which controller and estimator it uses."""

from typing import Any

from fastapi import APIRouter, Response

from server.dependencies import TheOperator
from server.operator import Operator
from server.responses import answers, json_response
from server.schemas import BackendRequest, ControllerRequest, EstimatorRequest
from server.state import estimator_errors

router = APIRouter(prefix="/api/v1", tags=["selection"])

_BACKEND = {
    "name": "simulation",
    "options": {},
    "available": [
        {"name": "simulation", "available": True, "reason": None},
        {"name": "hardware", "available": False, "reason": "the hardware backend needs cyclonedds 11.0.1: pip ..."},
    ],
}
_CONTROLLER = {"name": "policy", "available": ["model_based", "policy", "policy_paper"]}
_ESTIMATOR = {
    "name": "adaptive",
    "gains": None,
    "available": [{"name": "gmo_pi", "error_rms_n": 6.1}, {"name": "gmo_cqp", "error_rms_n": 3.2}],
}


@router.get("/backend", responses=answers(_BACKEND))
def get_backend(operator: TheOperator) -> Response:
    """The backend, and which are available or why not."""
    return json_response(_backend(operator))


@router.put("/backend", responses=answers(_BACKEND))
def put_backend(body: BackendRequest, operator: TheOperator) -> Response:
    """Choose the backend: a fresh control process, with the default command. An engaged robot must sit or damp first."""
    operator.set_backend(body.name, **body.options.model_dump(exclude_unset=True))
    return json_response(_backend(operator))


@router.get("/controller", responses=answers(_CONTROLLER))
def get_controller(operator: TheOperator) -> Response:
    """The controller, and those that can be chosen."""
    return json_response(_controller(operator))


@router.put("/controller", responses=answers(_CONTROLLER))
def put_controller(body: ControllerRequest, operator: TheOperator) -> Response:
    """Choose the controller."""
    operator.select_controller(body.name)
    return json_response(_controller(operator))


@router.get("/estimator", responses=answers(_ESTIMATOR))
def get_estimator(operator: TheOperator) -> Response:
    """The estimator that feeds the controller, and all with their live errors where truth exists."""
    return json_response(_estimator(operator))


@router.put("/estimator", responses=answers(_ESTIMATOR))
def put_estimator(body: EstimatorRequest, operator: TheOperator) -> Response:
    """Choose the estimator, optionally with new gains of its momentum observer."""
    gains = (body.gains.k1, body.gains.k2) if "gains" in body.model_fields_set else None
    operator.select_estimator(body.name, gains)
    return json_response(_estimator(operator))


def _backend(operator: Operator) -> dict[str, Any]:
    backend = operator.robot.choice
    return {"name": backend.name, "options": backend.options(), "available": operator.available()["backends"]}


def _controller(operator: Operator) -> dict[str, Any]:
    snapshot = operator.client.require_snapshot()
    return {"name": snapshot["controller"].decode(), "available": operator.available()["controllers"]}


def _estimator(operator: Operator) -> dict[str, Any]:
    snapshot = operator.client.require_snapshot()
    errors = estimator_errors(snapshot)
    gains = operator.selection.gains
    return {
        "name": snapshot["estimator"].decode(),
        "gains": None if gains is None else {"k1": gains[0], "k2": gains[1]},
        "available": [{"name": name, "error_rms_n": errors.get(name)} for name in operator.available()["estimators"]],
    }
