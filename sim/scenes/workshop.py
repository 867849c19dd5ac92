"""A workshop with valve, board and door around the robot: several tasks in a row (the paper's future work)."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import mujoco
import numpy as np

from sim.scenes import board, door, valve
from sim.scenes.scene import Parameter, Reading

DESCRIPTION = "A workshop: valve ahead, board to the left, door behind"


@dataclass(frozen=True, slots=True)
class Place:
    """Where the frame of a scene lies in the workshop: m, m, rad."""

    x_m: float
    y_m: float
    yaw_rad: float


PLACES: Mapping[str, Place] = {
    "valve": Place(0.0, 0.0, 0.0),
    "board": Place(-0.35, 0.15, 0.5 * np.pi),
    "door": Place(-0.75, 0.0, np.pi),
}
HUB_M = (-0.35, 0.0)
"""From here the robot can turn to all of them."""
_SCENES: Mapping[str, ModuleType] = {"valve": valve, "board": board, "door": door}
_CHANGEABLE = ("friction_nm", "wave_m", "spring_scale")
PARAMETERS: tuple[Parameter, ...] = tuple(
    parameter for scene in _SCENES.values() for parameter in scene.PARAMETERS if parameter.name in _CHANGEABLE
)
PADDED: tuple[str, ...] = tuple(name for scene in _SCENES.values() for name in scene.PADDED)


def readings() -> tuple[Reading, ...]:
    """Those of all that stands in it."""
    return tuple(reading for scene in _SCENES.values() for reading in scene.readings())


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Adds what the scenes add, each in its place."""
    movable: tuple[str, ...] = ()
    for name, scene in _SCENES.items():
        before = {element.name for element in (*spec.worldbody.geoms, *spec.worldbody.bodies)}
        own = {parameter.name: values.get(parameter.name, parameter.default) for parameter in scene.PARAMETERS}
        movable += scene.add_objects(spec, own)
        place, half = PLACES[name], 0.5 * PLACES[name].yaw_rad
        frame = spec.worldbody.add_frame(pos=[place.x_m, place.y_m, 0.0], quat=[np.cos(half), 0.0, 0.0, np.sin(half)])
        for element in (*spec.worldbody.geoms, *spec.worldbody.bodies):
            if element.name not in before:
                element.set_frame(frame)
    return movable
