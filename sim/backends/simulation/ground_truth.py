"""Reads ground truth out of a simulated world: poses, and the forces on the wheels and the end effector.

The force sensors of the model make MuJoCo sum the external forces per body (cfrc_ext: applied wrenches and contacts), so
that truth at 500 Hz costs no loop over contacts, except to take out what the robot does to itself.
"""

import mujoco
import numpy as np

from control.frames import rotation_heading_to_world
from control.joints import END_EFFECTOR_FRAME, LEGS
from control.kernels.compiled import kernel
from control.wheel_geometry import lowest_points
from sim.backends.protocol import GroundTruth

_CONTACT_THRESHOLD_N = 1e-6


class GroundTruthReader:
    """Ground truth of one world."""

    STATE = ()
    SCRATCH = ("_data", "_geom_axis_y", "_contact_force")

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, robot_bodies: tuple[str, ...], movable_bodies: tuple[str, ...]
    ) -> None:
        self._model = model
        self._data = data
        self._base = model.body("base").id
        self._end_effector_site = model.site(END_EFFECTOR_FRAME).id
        self._wheel_geoms = np.array([model.geom(f"{leg}_wheel").id for leg in LEGS])
        self._receivers = np.array([model.body(f"{leg}_wheel").id for leg in LEGS] + [model.body(END_EFFECTOR_FRAME).id])
        self._geom_axis_y = data.geom_xmat[:, 1::3]
        self._objects = np.array([model.body(name).id for name in movable_bodies], dtype=int)
        robot = [model.body(name).id for name in robot_bodies]
        self._is_robot = np.isin(model.geom_bodyid, robot)
        self._contact_force = np.zeros(6)

    def read(self) -> GroundTruth:
        """Truth at the end of the last tick; forces are those of that tick. Kinematics of the data must be current."""
        data = self._data
        heading = rotation_heading_to_world(data.xmat[self._base].reshape(3, 3))
        forces = data.cfrc_ext[self._receivers, 3:]
        self._remove_self_contact(forces)
        wheel_forces = forces[:-1] - data.xfrc_applied[self._receivers[:-1], :3]
        return GroundTruth(
            base_position=data.qpos[:3].copy(),
            base_orientation_wxyz=data.qpos[3:7].copy(),
            base_linear_velocity=data.qvel[:3].copy(),
            base_angular_velocity=data.qvel[3:6].copy(),
            end_effector_position=data.site_xpos[self._end_effector_site].copy(),
            force_true_n=forces[-1] @ heading,
            wheel_forces=wheel_forces @ heading,
            wheel_contact_positions=self.lowest_wheel_points(),
            wheel_in_contact=wheel_forces[:, 2] > _CONTACT_THRESHOLD_N,
            object_positions=data.xpos[self._objects],
            object_orientations_wxyz=data.xquat[self._objects],
        )

    def lowest_wheel_points(self) -> np.ndarray:
        """Lowest points (4, 3) m, in world, of the wheels, with or without contact."""
        return lowest_points(self._data.geom_xpos[self._wheel_geoms], self._geom_axis_y[self._wheel_geoms])

    def touches_itself(self) -> bool:
        """Whether two bodies of the robot press on each other."""
        contact = self._data.contact
        return bool((self._is_robot[contact.geom].all(1) & (contact.dist < 0.0)).any())

    def _remove_self_contact(self, forces: np.ndarray) -> None:
        """Take contacts of the robot with itself out of `forces` (5, 3) in world: they are not the environment's."""
        contact = self._data.contact
        geom = contact.geom
        if not touches_itself(geom, self._is_robot):
            return
        for index in np.flatnonzero(self._is_robot[geom].all(1)):
            mujoco.mj_contactForce(self._model, self._data, index, self._contact_force)
            # Force on the second geom; the rows of the frame are the contact's axes in world.
            force = self._contact_force[:3] @ contact.frame[index].reshape(3, 3)
            bodies = self._model.geom_bodyid[geom[index]]
            forces -= (self._receivers == bodies[1])[:, None] * force
            forces += (self._receivers == bodies[0])[:, None] * force


@kernel("b1(Array(i4, 2, 'A', readonly=True), b1[::1])")
def touches_itself(geoms: np.ndarray, is_robot: np.ndarray) -> bool:
    """Whether both geoms of any contact, of geoms (n, 2), are of the robot (geoms,)."""
    touches = False
    for contact in range(len(geoms)):
        touches |= bool(is_robot[geoms[contact, 0]] and is_robot[geoms[contact, 1]])
    return touches
