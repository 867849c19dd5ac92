"""Checks parameters of a scene before the control process is asked."""

from collections.abc import Mapping

from server.errors import InvalidFieldError, RefusedError
from server.fields import in_words
from sim.scenes import SCENE_NAMES, parameters


def require_parameters(scene: str, values: Mapping[str, float]) -> None:
    """
    Raises:
        InvalidFieldError: a scene has no such parameter, or not with this value.
        RefusedError: nothing is known of what stands around the robot.
    """
    if scene not in SCENE_NAMES:
        raise RefusedError("the scene: simulation only; PUT /api/v1/backend with 'simulation' first")
    known = {parameter.name: parameter for parameter in parameters(scene)}
    for key, value in values.items():
        if key not in known:
            raise InvalidFieldError(f"parameters.{key}", "is unknown", ", ".join(known) or "none")
        limits = known[key].minimum, known[key].maximum
        if not limits[0] <= value <= limits[1]:
            raise InvalidFieldError(f"parameters.{key}", "is outside the allowed range", in_words(limits))
