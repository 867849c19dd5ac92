"""What the robot does by itself: valve, board, door, box, guidance."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Response

from server.answers.tasks import TaskAnswer, TaskCreatedAnswer, TaskKind
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import TaskRequest

router = APIRouter(prefix="/api/v1/tasks", tags=["tasks"])

Key = Annotated[int | Literal["current"], Path(examples=["current"], description="of the task; `current`: begun last")]


@router.get("", response_model=list[TaskKind])
def list_tasks(operator: TheOperator) -> Response:
    """The tasks that there are, each with its options."""
    return json_response(operator.tasks.kinds())


@router.post("", status_code=201, response_model=TaskCreatedAnswer, responses=refusals(409, 413, 422, 503))
def start_task(body: TaskRequest, operator: TheOperator) -> Response:
    """Begin a task. It commands until it ends and then holds; any command of an operator takes over."""
    return json_response({"id": operator.tasks.start(body.name, body.options)}, 201)


@router.get("/{task_id}", response_model=TaskAnswer, responses=refusals(404, 422, 503))
def get_task(task_id: Key, operator: TheOperator) -> Response:
    """How far a task has come, and what came of it."""
    return json_response(operator.tasks.get(None if task_id == "current" else task_id))


@router.delete("/{task_id}", response_model=TaskAnswer, responses=refusals(404, 409, 422, 503))
def abort_task(task_id: Key, operator: TheOperator) -> Response:
    """Abort the task at work: the hand backs off along the contact's normal and holds. 404 where it is not at work."""
    return json_response(operator.tasks.abort(None if task_id == "current" else task_id))
