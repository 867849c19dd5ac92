"""A pale robot that shows the other future of a simulation that was set back."""

import numpy as np
import viser

from web import theme
from web.other_future import OtherFuture
from web.scene import BodyTree

OPACITY = 0.3


class Ghost:
    """Drawn where the robot was in the other future at the time that is shown; made when it is first needed."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._tree = BodyTree.from_mjcf()
        self._root: viser.FrameHandle | None = None
        self._nodes: list[viser.FrameHandle] = []

    def update(self, time_s: float, future: OtherFuture) -> None:
        """Show it at a simulated time, where there is another future."""
        seen = future.at(time_s)
        if seen is None:
            if self._root is not None and self._root.visible:
                self._root.visible = False
            return
        if self._root is None:
            self._root = self._make()
        self._nodes[0].position, self._nodes[0].wxyz = seen.base_position, seen.base_orientation_wxyz
        for index, wxyz in enumerate(self._tree.orientations(seen.joint_position)):
            if self._tree.joints[index] >= 0:
                self._nodes[index].wxyz = wxyz
        self._root.visible = True

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return self._root is not None and self._root.visible

    def _make(self) -> viser.FrameHandle:
        from web.meshes import body_mesh  # half a second, for which a start has no time

        scene, tree = self._server.scene, self._tree
        root = scene.add_frame("/ghost", show_axes=False)
        for name, path, position, wxyz in zip(tree.names, tree.paths, tree.positions, tree.rest_wxyz, strict=True):
            self._nodes.append(scene.add_frame(f"/ghost{path}", show_axes=False, position=position, wxyz=wxyz))
            mesh = body_mesh(name)
            if mesh is not None:
                scene.add_mesh_simple(
                    f"/ghost{path}/mesh",
                    np.asarray(mesh.vertices),
                    np.asarray(mesh.faces),
                    color=theme.TARGET,
                    opacity=OPACITY,
                )
        return root
