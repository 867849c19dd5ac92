"""Reads ground truth out of a simulated world: poses, and the forces on the wheels and the end effector.

The force sensors of the model make MuJoCo sum the external forces per body (cfrc_ext: applied wrenches and contacts), so
that truth at 500 Hz costs no loop over contacts, except to take out what the robot does to itself.
"""

import mujoco
import numpy as np

from control.frames import rotation_heading_to_world
from control.joints import END_EFFECTOR_FRAME, LEGS
from control.kernels.compiled import kernel
from control.kernels.small_algebra import rotate_back
from control.wheel_geometry import lowest_point_from_center, lowest_points
from sim.backends.protocol import GroundTruth

_CONTACT_THRESHOLD_N = 1e-6
_NUMBERS = 43
_NO_FORCES = np.zeros((len(LEGS) + 1, 3))


class GroundTruthReader:
    """Ground truth of one world."""

    STATE = ()
    SCRATCH = (
        "_data",
        "_contact_force",
        "_qpos",
        "_qvel",
        "_body_rotations",
        "_site_positions",
        "_external",
        "_applied",
        "_geom_positions",
        "_geom_axis_y",
        "_object_positions",
        "_object_orientations",
    )

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, robot_bodies: tuple[str, ...], movable_bodies: tuple[str, ...]
    ) -> None:
        self._model = model
        self._data = data
        self._base = model.body("base").id
        self._end_effector_site = model.site(END_EFFECTOR_FRAME).id
        self._wheel_geoms = np.array([model.geom(f"{leg}_wheel").id for leg in LEGS])
        self._receivers = np.array([model.body(f"{leg}_wheel").id for leg in LEGS] + [model.body(END_EFFECTOR_FRAME).id])
        self._objects = np.array([model.body(name).id for name in movable_bodies], dtype=int)
        robot = [model.body(name).id for name in robot_bodies]
        self._is_robot = np.isin(model.geom_bodyid, robot)
        self._contact_force = np.zeros(6)
        # MuJoCo makes a new view at every access.
        self._qpos, self._qvel = data.qpos, data.qvel
        self._body_rotations, self._site_positions = data.xmat, data.site_xpos
        self._external, self._applied = data.cfrc_ext, data.xfrc_applied
        self._geom_positions, self._geom_axis_y = data.geom_xpos, data.geom_xmat[:, 1::3]
        self._object_positions, self._object_orientations = data.xpos, data.xquat

    def read(self) -> GroundTruth:
        """Truth at the end of the last tick; forces are those of that tick. Kinematics of the data must be current."""
        numbers, in_contact = np.empty(_NUMBERS), np.empty(len(LEGS), bool)
        _gather(
            self._qpos,
            self._qvel,
            self._body_rotations[self._base],
            self._site_positions[self._end_effector_site],
            self._external,
            self._self_contact(),
            self._applied,
            self._receivers,
            self._geom_positions,
            self._geom_axis_y,
            self._wheel_geoms,
            numbers,
            in_contact,
        )
        return GroundTruth(
            base_position=numbers[0:3],
            base_orientation_wxyz=numbers[3:7],
            base_linear_velocity=numbers[7:10],
            base_angular_velocity=numbers[10:13],
            end_effector_position=numbers[13:16],
            force_true_n=numbers[16:19],
            wheel_forces=numbers[19:31].reshape(len(LEGS), 3),
            wheel_contact_positions=numbers[31:43].reshape(len(LEGS), 3),
            wheel_in_contact=in_contact,
            object_positions=self._object_positions[self._objects],
            object_orientations_wxyz=self._object_orientations[self._objects],
        )

    def lowest_wheel_points(self) -> np.ndarray:
        """Lowest points (4, 3) m, in world, of the wheels, with or without contact."""
        return lowest_points(self._data.geom_xpos[self._wheel_geoms], self._geom_axis_y[self._wheel_geoms])

    def touches_itself(self) -> bool:
        """Whether two bodies of the robot press on each other."""
        contact = self._data.contact
        return bool((self._is_robot[contact.geom].all(1) & (contact.dist < 0.0)).any())

    def _self_contact(self) -> np.ndarray:
        """Forces (5, 3), N, in world, of contacts of the robot with itself on each receiver: they are not the environment's."""
        contact = self._data.contact
        geom = contact.geom
        if not touches_itself(geom, self._is_robot):
            return _NO_FORCES
        forces = np.zeros((len(self._receivers), 3))
        for index in np.flatnonzero(self._is_robot[geom].all(1)):
            mujoco.mj_contactForce(self._model, self._data, index, self._contact_force)
            # Force on the second geom; the rows of the frame are the contact's axes in world.
            force = self._contact_force[:3] @ contact.frame[index].reshape(3, 3)
            bodies = self._model.geom_bodyid[geom[index]]
            forces += (self._receivers == bodies[1])[:, None] * force
            forces -= (self._receivers == bodies[0])[:, None] * force
        return forces


@kernel(
    "void(f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], i8[::1], f8[:,::1], matrix, i8[::1],"
    " f8[::1], b1[::1])"
)
def _gather(
    qpos: np.ndarray,
    qvel: np.ndarray,
    base_rotation: np.ndarray,
    hand: np.ndarray,
    external: np.ndarray,
    self_contact: np.ndarray,
    applied: np.ndarray,
    receivers: np.ndarray,
    geom_positions: np.ndarray,
    geom_axes: np.ndarray,
    wheel_geoms: np.ndarray,
    numbers: np.ndarray,
    in_contact: np.ndarray,
) -> None:
    """Gather the numbers of a GroundTruth from MuJoCo's.

    Args:
        qpos, qvel: the base is the first body.
        base_rotation: (9,) base to world.
        hand: (3,) m, in world.
        external: (bodies, 6) moment, then force on each body in world, of contacts and applied wrenches.
        self_contact: (5, 3) N, of it that the robot does to itself.
        applied: (bodies, 6) force, then moment of applied wrenches.
        receivers: (5,) bodies: wheels, then the hand.
        geom_positions, geom_axes: (geoms, 3) m and y axes, in world.
        wheel_geoms: (4,) which of them are wheels.
        numbers: (_NUMBERS,) the results, one after the other.
        in_contact: (4,) whether each wheel is pressed on.
    """
    heading = rotation_heading_to_world(base_rotation.reshape((3, 3)))
    last, force = len(receivers) - 1, np.empty(3)
    numbers[0:7], numbers[7:13], numbers[13:16] = qpos[:7], qvel[:6], hand
    for index in range(len(receivers)):
        for i in range(3):
            force[i] = external[receivers[index], 3 + i] - self_contact[index, i]
            if index < last:
                force[i] -= applied[receivers[index], i]
        at = 16 if index == last else 19 + 3 * index
        numbers[at], numbers[at + 1], numbers[at + 2] = rotate_back(heading, force)
        if index < last:
            in_contact[index] = force[2] > _CONTACT_THRESHOLD_N
            center, at = geom_positions[wheel_geoms[index]], 31 + 3 * index
            x, y, z = lowest_point_from_center(geom_axes[wheel_geoms[index]])
            numbers[at], numbers[at + 1], numbers[at + 2] = center[0] + x, center[1] + y, center[2] + z


@kernel("b1(Array(i4, 2, 'A', readonly=True), b1[::1])")
def touches_itself(geoms: np.ndarray, is_robot: np.ndarray) -> bool:
    """Whether both geoms of any contact, of geoms (n, 2), are of the robot (geoms,)."""
    touches = False
    for contact in range(len(geoms)):
        touches |= bool(is_robot[geoms[contact, 0]] and is_robot[geoms[contact, 1]])
    return touches
