"""Running, stepping and resetting the simulation, its scene, and how its robot differs from the model."""

import math

from fastapi import APIRouter, Response

from server.answers.simulation import MismatchAnswer, ResetAnswer, RunAnswer, SceneAnswer, StepAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import MismatchRequest, ResetRequest, RunRequest, SceneParametersRequest, SceneRequest, StepRequest
from sim.runtime.snapshot import named
from sim.scenes import SCENE_NAMES, parameters

router = APIRouter(prefix="/api/v1", tags=["simulation"])


@router.post("/run", response_model=RunAnswer, responses=refusals(409, 413, 422, 503))
def run(body: RunRequest, operator: TheOperator) -> Response:
    """Run or pause; without a speed, that stays."""
    speed = body.speed if "speed" in body.model_fields_set else None
    return json_response(operator.set_run(body.state, speed))


@router.post("/step", response_model=StepAnswer, responses=refusals(409, 413, 422, 503))
def step(body: StepRequest, operator: TheOperator) -> Response:
    """Advance a paused simulation by ticks of 2 ms; answers when they are done."""
    return json_response(operator.step(body.ticks))


@router.post("/reset", response_model=ResetAnswer, responses=refusals(409, 413, 422, 503))
def reset(operator: TheOperator, body: ResetRequest | None = None) -> Response:
    """Put the robot back, with the default command. A latched e-stop stays latched."""
    body = body or ResetRequest()
    seed = body.seed if "seed" in body.model_fields_set else None
    operator.reset(seed, body.keyframe)
    return json_response({"seed": seed, "keyframe": body.keyframe})


@router.get("/scene", response_model=SceneAnswer, responses=refusals(503))
def get_scene(operator: TheOperator) -> Response:
    """The scene, and those that can be chosen."""
    return json_response(_scene(operator))


@router.put("/scene", response_model=SceneAnswer, responses=refusals(409, 413, 422, 503))
def put_scene(body: SceneRequest, operator: TheOperator) -> Response:
    """Load a scene with the robot at its start and the default command."""
    operator.set_scene(
        body.name, body.parameters, seed=body.seed if "seed" in body.model_fields_set else None, rigid=body.rigid
    )
    return json_response(_scene(operator))


@router.patch("/scene", response_model=SceneAnswer, responses=refusals(409, 413, 422, 503))
def patch_scene(body: SceneParametersRequest, operator: TheOperator) -> Response:
    """Change parameters of the scene while it runs; what moves, moves on."""
    operator.set_parameters(body.parameters)
    return json_response(_scene(operator))


@router.get("/mismatch", response_model=MismatchAnswer, responses=refusals(503))
def get_mismatch(operator: TheOperator) -> Response:
    """Scales of the simulated robot's masses over nominal."""
    return json_response(_mismatch(operator))


@router.put("/mismatch", response_model=MismatchAnswer, responses=refusals(409, 413, 422, 503))
def put_mismatch(body: MismatchRequest, operator: TheOperator) -> Response:
    """Scale the simulated robot's masses and load its hand while it runs; the estimator is not told."""
    operator.set_mismatch(**body.model_dump())
    return json_response(_mismatch(operator))


def _scene(operator: TheOperator) -> SceneAnswer:
    snapshot = operator.client.require_snapshot()
    name = snapshot["scene"].decode()
    values = named(snapshot, "parameter")
    known = parameters(name) if name in SCENE_NAMES else ()
    return {
        "name": name,
        "available": operator.available()["scenes"],
        "parameters": [
            {"name": p.name, "value": values[p.name], "default": p.default, "minimum": p.minimum, "maximum": p.maximum}
            for p in known
            if p.name in values
        ],
    }


def _mismatch(operator: TheOperator) -> MismatchAnswer:
    selection = operator.selection
    true = float(operator.client.require_snapshot()["mass_scale_true"])
    if math.isnan(true):
        # A robot weighs what it weighs.
        return {"mass_scale": None, "per_link": {}, "payload_kg": None, "payload_center_m": None, "mass_scale_true": None}
    return {
        "mass_scale": selection.mass_scale,
        "per_link": dict(selection.per_link or {}),
        "payload_kg": selection.payload_kg,
        "payload_center_m": list(selection.payload_center_m),
        "mass_scale_true": true,
    }
