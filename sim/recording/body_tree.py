"""The robot's bodies and how they hang together, for whatever draws it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.joints import JOINT_NAMES
from control.paths import ROBOT_MJCF


@dataclass(frozen=True, slots=True)
class BodyTree:
    """Kinematic tree of the robot in file order, parents first.

    Attributes:
        names: body names; the first is the floating base.
        paths: scene path of each body.
        positions: (n, 3) m, origin in the parent body.
        rest_wxyz: (n, 4) orientation in the parent body at joint angle zero.
        turned_wxyz: (n, 4) `rest * (0, axis)`: a hinge at angle q has orientation cos(q/2) rest + sin(q/2) turned.
        joints: (n,) index in control.joints order of the hinge that moves the body, -1 for none.
    """

    names: tuple[str, ...]
    paths: tuple[str, ...]
    positions: np.ndarray
    rest_wxyz: np.ndarray
    turned_wxyz: np.ndarray
    joints: np.ndarray

    @classmethod
    def from_mjcf(cls, path: Path | str = ROBOT_MJCF) -> "BodyTree":
        """Read the tree of a robot whose joints are one free joint and hinges."""
        # The recorder, which is given a tree, has no use for these and no room.
        import mujoco

        from control.frames import quaternion_multiply

        model = mujoco.MjModel.from_xml_path(str(path))
        names = tuple(model.body(i).name for i in range(1, model.nbody))
        paths: list[str] = []
        joints = np.full(len(names), -1)
        turned = np.zeros((len(names), 4))
        for index, body in enumerate(range(1, model.nbody)):
            parent = model.body_parentid[body]
            paths.append(f"{paths[parent - 1] if parent else ''}/{names[index]}")
            joint = model.body_jntadr[body]
            if joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                joints[index] = JOINT_NAMES.index(model.joint(joint).name)
                turned[index] = quaternion_multiply(model.body_quat[body], np.array([0.0, *model.jnt_axis[joint]]))
        return cls(names, tuple(paths), model.body_pos[1:].copy(), model.body_quat[1:].copy(), turned, joints)

    @property
    def parents(self) -> tuple[str | None, ...]:
        """Name of each body's parent, None of the base."""
        chains = (path.split("/")[1:] for path in self.paths)
        return tuple(chain[-2] if len(chain) > 1 else None for chain in chains)

    def orientations(self, joint_position: np.ndarray) -> np.ndarray:
        """(..., n, 4) wxyz of every body in its parent for joint angles (..., 22), rad. The base keeps its rest orientation."""
        half = np.where(self.joints >= 0, joint_position[..., self.joints], 0.0)[..., None] / 2.0
        return np.cos(half) * self.rest_wxyz + np.sin(half) * self.turned_wxyz
