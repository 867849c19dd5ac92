"""The world and the robot in Viser: floor, light, and one node per robot body nested like the kinematic tree.

Nesting keeps a frame small: the base moves, and below it only the hinges' orientations change.
"""

import logging
from pathlib import Path

import numpy as np
import viser

from control.paths import ROBOT_MJCF
from sim.recording.body_tree import BodyTree
from web import theme

VISUALS = Path(ROBOT_MJCF).parent / "visual"
"""One GLB per body, `<body>.glb`, in the body's frame."""

_log = logging.getLogger(__name__)


class Scene:
    """Floor, light and robot. `nodes` holds the robot's bodies by name."""

    def __init__(self, server: viser.ViserServer, visuals: Path = VISUALS) -> None:
        scene = server.scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_environment_map("studio", environment_intensity=0.3)
        # Viser's own lights are so bright that they wash the force colours out.
        scene.configure_default_lights(enabled=False)
        # Without shadows: on a floor as dark as this one they can hardly be seen, and take half of a frame drawn in software.
        scene.add_light_directional("/light/key", intensity=1.5, cast_shadow=False, position=(1.2, -0.8, 2.4))
        scene.add_light_hemisphere("/light/sky", sky_color=(225, 235, 255), ground_color=(70, 75, 85), intensity=0.6)
        scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=0.25,
            section_size=1.0,
            cell_color=theme.GRID_CELL,
            section_color=theme.GRID_SECTION,
            plane_color=theme.FLOOR,
            plane_opacity=1.0,
            shadow_opacity=0.0,
            fade_distance=14.0,
        )
        self._tree = BodyTree.from_mjcf()
        self.nodes = {name: self._add_body(scene, visuals, index) for index, name in enumerate(self._tree.names)}
        self._hinges = [(index, node) for index, node in enumerate(self.nodes.values()) if self._tree.joints[index] >= 0]

    def _add_body(self, scene: viser.SceneApi, visuals: Path, index: int) -> viser.GlbHandle | viser.FrameHandle:
        tree = self._tree
        path, position, wxyz = tree.paths[index], tree.positions[index], tree.rest_wxyz[index]
        glb = visuals / f"{tree.names[index]}.glb"
        if not glb.is_file():
            _log.warning("no mesh for robot body %s: %s is missing; run python -m web.robot_visuals", tree.names[index], glb)
            return scene.add_frame(path, show_axes=False, position=position, wxyz=wxyz)
        return scene.add_glb(path, glb.read_bytes(), position=position, wxyz=wxyz)

    def update(self, snapshot: np.void) -> None:
        """Pose the robot as in a SNAPSHOT record."""
        base = self.nodes[self._tree.names[0]]
        base.position = snapshot["base_position"]
        base.wxyz = snapshot["base_orientation_wxyz"]
        orientations = self._tree.orientations(snapshot["joint_position"])
        for index, node in self._hinges:
            node.wxyz = orientations[index]
