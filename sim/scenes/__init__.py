"""The scenes by name. Each module adds its objects to the robot and floor of sim.scenes.scene."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from sim.scenes import board, box, door, free, valve, workshop
from sim.scenes.scene import Parameter, Primitive, Reading, SceneModel, assemble, pad

__all__ = ["SCENE_NAMES", "Parameter", "Primitive", "Reading", "SceneModel", "build", "draw", "parameters"]

_SCENES = {"free": free, "box": box, "board": board, "valve": valve, "door": door, "workshop": workshop}

SCENE_NAMES = tuple(_SCENES)


def build(name: str, values: Mapping[str, float] | None = None, *, rigid: bool = False) -> SceneModel:
    """A fresh scene.

    Args:
        name: of SCENE_NAMES.
        values: of its parameters, those that shall not have their defaults.
        rigid: leave out the padding of what the hand touches.

    Raises:
        ValueError: no scene has this name, or it has no such parameter or not with this value (the message says which).
    """
    known = parameters(name)
    scene, chosen = _SCENES[name], {parameter.name: parameter.default for parameter in known}
    for key, value in (values or {}).items():
        parameter = next((p for p in known if p.name == key), None)
        if parameter is None:
            raise ValueError(f"scene {name!r} has no parameter {key!r}; it has {', '.join(chosen) or 'none'}")
        if not parameter.minimum <= value <= parameter.maximum:
            raise ValueError(f"{key} is {value}; the range is {parameter.minimum:g} to {parameter.maximum:g}")
        chosen[key] = float(value)

    def add_objects(spec):
        movable_bodies = scene.add_objects(spec, chosen)
        if not rigid:
            pad(spec, scene.PADDED)
        return movable_bodies

    model = assemble(name, scene.DESCRIPTION, add_objects)
    return replace(model, readings=scene.readings(), values=MappingProxyType(chosen), rigid=rigid)


def parameters(name: str) -> tuple[Parameter, ...]:
    """What of a scene can be changed while it runs.

    Raises:
        ValueError: no scene has this name (the message lists them).
    """
    if name not in _SCENES:
        raise ValueError(f"no scene {name!r}; the scenes are {', '.join(SCENE_NAMES)}")
    return _SCENES[name].PARAMETERS


def draw(name: str, seed: int) -> dict[str, float]:
    """Values of a scene's parameters as a seed draws them, evenly.

    Raises:
        ValueError: no scene has this name.
    """
    random = np.random.default_rng([seed, 16])
    return {parameter.name: float(random.uniform(*parameter.drawn)) for parameter in parameters(name)}
