"""What sensors without any error would read of a simulated robot at the end of a tick."""

import mujoco
import numpy as np

from control.compiled import kernel
from control.frames import rotation_from_quaternion
from control.joints import JOINT_COUNT, JOINT_NAMES
from control.robot_model import GRAVITY_MPS2
from control.small_algebra import rotate, rotate_back
from control.types import SensorFrame


class IdealSensors:
    """Reads the state of one world, once per tick."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._data = data
        # MuJoCo makes a new view at every access.
        self._qpos, self._qvel = data.qpos, data.qvel
        joints = [model.joint(joint) for joint in JOINT_NAMES]
        self._positions = np.array([joint.qposadr[0] for joint in joints], dtype=int)
        self._dofs = np.array([joint.dofadr[0] for joint in joints], dtype=int)
        self._lever = model.site("imu").pos.copy()
        self._period_s = model.opt.timestep
        self.reset()

    def reset(self) -> None:
        """Start over from a robot at rest."""
        self._imu_velocity = np.zeros(3)

    def read(self, joint_torque: np.ndarray) -> SensorFrame:
        """The sample of this tick. `joint_torque`: (22,) N m, see Drives.torques."""
        position, velocity = np.empty(JOINT_COUNT), np.empty(JOINT_COUNT)
        orientation, rates, acceleration = np.empty(4), np.empty(3), np.empty(3)
        _sample(
            self._qpos,
            self._qvel,
            self._positions,
            self._dofs,
            self._lever,
            self._period_s,
            self._imu_velocity,
            position,
            velocity,
            orientation,
            rates,
            acceleration,
        )
        return SensorFrame(self._data.time, orientation, rates, acceleration, position, velocity, joint_torque)


@kernel(
    "void(f8[::1], f8[::1], i8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])",
)
def _sample(
    qpos: np.ndarray,
    qvel: np.ndarray,
    positions: np.ndarray,
    dofs: np.ndarray,
    lever: np.ndarray,
    period_s: float,
    imu_velocity: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    orientation: np.ndarray,
    rates: np.ndarray,
    acceleration: np.ndarray,
) -> None:
    """Encoders, and the IMU on the base: v_imu = v + R (w x l), and a = R^T ((v_imu - v_imu before) / T + g e_z).

    The acceleration is the mean over the tick, so that it integrates to the change of velocity under implicit integration too.

    Args:
        qpos, qvel: of MuJoCo; the base is the first body, v in world and w in base.
        positions, dofs: (22,) where each joint's angle and velocity lie.
        lever: (3,) m, l, in base.
        period_s: T.
        imu_velocity: (3,) m/s, in world, at the end of the last tick; changed to that of this one.
        position, velocity: (22,) rad and rad/s, results, like the following.
        orientation: (4,) base to world.
        rates: (3,) rad/s, in base.
        acceleration: (3,) m/s^2, specific force in base axes.
    """
    for joint in range(len(positions)):
        position[joint], velocity[joint] = qpos[positions[joint]], qvel[dofs[joint]]
    orientation[:] = qpos[3:7]
    rates[:] = qvel[3:6]
    rotation = rotation_from_quaternion(orientation)
    around = np.array(
        [
            rates[1] * lever[2] - rates[2] * lever[1],
            rates[2] * lever[0] - rates[0] * lever[2],
            rates[0] * lever[1] - rates[1] * lever[0],
        ]
    )
    from_lever = rotate(rotation, around)
    change = np.empty(3)
    for i in range(3):
        new = qvel[i] + from_lever[i]
        change[i] = (new - imu_velocity[i]) / period_s
        imu_velocity[i] = new
    change[2] += GRAVITY_MPS2
    acceleration[0], acceleration[1], acceleration[2] = rotate_back(rotation, change)
