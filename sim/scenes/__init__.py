"""The scenes by name. Each module adds its objects to the robot and floor of sim.scenes.scene."""

from sim.scenes import board, box, door, free, valve
from sim.scenes.scene import Primitive, SceneModel, assemble

__all__ = ["SCENE_NAMES", "Primitive", "SceneModel", "build"]

_SCENES = {"free": free, "box": box, "board": board, "valve": valve, "door": door}

SCENE_NAMES = tuple(_SCENES)


def build(name: str) -> SceneModel:
    """A fresh scene.

    Raises:
        ValueError: no scene has this name (the message lists them).
    """
    if name not in _SCENES:
        raise ValueError(f"no scene {name!r}; the scenes are {', '.join(SCENE_NAMES)}")
    return assemble(name, _SCENES[name].DESCRIPTION, _SCENES[name].add_objects)
