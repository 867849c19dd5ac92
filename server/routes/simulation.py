"""Running, stepping and resetting the simulation, its scene, and how its robot differs from the model."""

import math

from fastapi import APIRouter, Response

from server.dependencies import TheOperator
from server.responses import answers, json_response
from server.schemas import MismatchRequest, ResetRequest, RunRequest, SceneRequest, StepRequest

router = APIRouter(prefix="/api/v1", tags=["simulation"])

_SCENE = {"name": "free", "available": ["free", "box", "board", "valve", "door"]}
_MISMATCH = {"mass_scale": 1.2, "per_link": {}, "mass_scale_true": 1.2}


@router.post("/run", responses=answers({"state": "running", "speed": 1.0}))
def run(body: RunRequest, operator: TheOperator) -> Response:
    """Run or pause; without a speed, it stays."""
    speed = body.speed if "speed" in body.model_fields_set else None
    return json_response(operator.set_run(body.state, speed))


@router.post("/step", responses=answers({"time_s": 1.02}))
def step(body: StepRequest, operator: TheOperator) -> Response:
    """Advance a paused simulation by ticks of 2 ms; answers when they are done."""
    return json_response(operator.step(body.ticks))


@router.post("/reset", responses=answers({"seed": 7, "keyframe": "stand"}))
def reset(operator: TheOperator, body: ResetRequest | None = None) -> Response:
    """Put the robot back, with the default command. A latched e-stop stays latched."""
    body = body or ResetRequest()
    seed = body.seed if "seed" in body.model_fields_set else None
    operator.reset(seed, body.keyframe)
    return json_response({"seed": seed, "keyframe": body.keyframe})


@router.get("/scene", responses=answers(_SCENE))
def get_scene(operator: TheOperator) -> Response:
    """The scene, and those that can be chosen."""
    return json_response(_scene(operator))


@router.put("/scene", responses=answers(_SCENE))
def put_scene(body: SceneRequest, operator: TheOperator) -> Response:
    """Load a scene with the robot at its start and the default command."""
    operator.set_scene(body.name)
    return json_response(_scene(operator))


@router.get("/mismatch", responses=answers(_MISMATCH))
def get_mismatch(operator: TheOperator) -> Response:
    """Scales of the simulated robot's masses over nominal."""
    return json_response(_mismatch(operator))


@router.put("/mismatch", responses=answers(_MISMATCH))
def put_mismatch(body: MismatchRequest, operator: TheOperator) -> Response:
    """Scale the simulated robot's masses while it runs; the estimator is not told."""
    operator.set_mismatch(body.mass_scale, body.per_link)
    return json_response(_mismatch(operator))


def _scene(operator: TheOperator) -> dict[str, object]:
    return {"name": operator.client.require_snapshot()["scene"].decode(), "available": operator.available()["scenes"]}


def _mismatch(operator: TheOperator) -> dict[str, object]:
    selection = operator.selection
    true = float(operator.client.require_snapshot()["mass_scale_true"])
    if math.isnan(true):
        return {"mass_scale": None, "per_link": {}, "mass_scale_true": None}  # a robot weighs what it weighs
    return {"mass_scale": selection.mass_scale, "per_link": dict(selection.per_link or {}), "mass_scale_true": true}
