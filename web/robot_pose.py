"""Where the robot's bodies are in the world, and which of them a ray meets."""

import threading

import mujoco
import numpy as np

from control.joints import JOINT_NAMES
from control.paths import ROBOT_MJCF


class RobotPose:
    """Kinematics of the robot as drawn. Every method may be called from any thread.

    Attributes:
        bodies: names of the robot's bodies, parents first.
    """

    def __init__(self) -> None:
        self._model = model = mujoco.MjModel.from_xml_path(str(ROBOT_MJCF))
        self._data = mujoco.MjData(model)
        self.bodies = tuple(model.body(i).name for i in range(1, model.nbody))
        self._addresses = np.array([model.joint(name).qposadr[0] for name in JOINT_NAMES])
        self._lock = threading.Lock()

    def update(self, snapshot: np.void) -> None:
        """Move the bodies to where a SNAPSHOT record has them."""
        with self._lock:
            self._data.qpos[:3] = snapshot["base_position"]
            self._data.qpos[3:7] = snapshot["base_orientation_wxyz"]
            self._data.qpos[self._addresses] = snapshot["joint_position"]
            mujoco.mj_kinematics(self._model, self._data)

    def pose(self, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) m in world, and rotation (3, 3) to world, of a body of `bodies`."""
        with self._lock:
            placed = self._data.body(body)
            return placed.xpos.copy(), placed.xmat.reshape(3, 3).copy()

    def hit(self, origin: np.ndarray, direction: np.ndarray) -> tuple[str, np.ndarray] | None:
        """The body whose collision shape a ray in world meets first, and where (3,) m in its frame; None beside the robot."""
        geom = np.full((1, 1), -1, np.int32)
        with self._lock:
            distance = mujoco.mj_ray(self._model, self._data, origin, direction, None, 1, -1, geom)
            if distance < 0:
                return None
            body = self._model.body(self._model.geom_bodyid[geom[0, 0]]).name
        position, rotation = self.pose(body)
        return body, rotation.T @ (origin + distance * direction - position)
