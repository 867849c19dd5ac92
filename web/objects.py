"""The objects of a scene (box, board, valve, door), drawn from the scene's primitive geoms."""

import mujoco
import numpy as np
import viser

from sim.runtime.snapshot import named
from sim.scenes import SCENE_NAMES, Primitive, SceneModel, build

_ROOT = "/objects"


class SceneObjects:
    """Draws the scene that the snapshot names, and moves its movable bodies."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene_api = server.scene
        self._shown: tuple[str, dict[str, float]] | None = None
        self._movable: list[viser.FrameHandle] = []
        self.bodies: dict[str, viser.FrameHandle] = {}

    def update(self, snapshot: np.void) -> None:
        """Show the objects of a SNAPSHOT record."""
        name, parameters = snapshot["scene"].decode(), named(snapshot, "parameter")
        if (name, parameters) != self._shown:
            self._shown = name, parameters
            self._clear()
            if name in SCENE_NAMES:  # what is around a real robot is unknown
                self._load(build(name, parameters))
        for index, body in enumerate(self._movable[: snapshot["object_count"]]):
            body.position = snapshot["object_position"][index]
            body.wxyz = snapshot["object_orientation_wxyz"][index]

    def _clear(self) -> None:
        self._scene_api.remove_by_name(_ROOT)
        self._movable, self.bodies = [], {}

    def _load(self, scene: SceneModel) -> None:
        self._scene_api.add_frame(_ROOT, show_axes=False)
        data = mujoco.MjData(scene.model)
        mujoco.mj_kinematics(scene.model, data)
        for body in dict.fromkeys(primitive.body for primitive in scene.primitives):
            pose = data.body(body)
            self.bodies[body] = self._scene_api.add_frame(
                f"{_ROOT}/{body}", show_axes=False, position=pose.xpos, wxyz=pose.xquat
            )
        for index, primitive in enumerate(scene.primitives):
            # The floor is the grid of web.scene.
            if primitive.kind != "plane":
                self._add(f"{_ROOT}/{primitive.body}/{index}", primitive)
        self._movable = [self.bodies[body] for body in scene.movable_bodies]

    def _add(self, path: str, primitive: Primitive) -> None:
        from web.meshes import primitive_mesh  # half a second, for which a start has no time

        mesh = primitive_mesh(primitive)
        color = tuple(round(255 * channel) for channel in primitive.rgba[:3])
        opacity = None if primitive.rgba[3] >= 1.0 else float(primitive.rgba[3])
        self._scene_api.add_mesh_simple(
            path,
            np.asarray(mesh.vertices),
            np.asarray(mesh.faces),
            color=color,
            opacity=opacity,
            flat_shading=primitive.kind == "box",
            position=primitive.position,
            wxyz=primitive.orientation_wxyz,
        )
