"""What sensors without any error would read of a simulated robot at the end of a tick."""

import mujoco
import numpy as np

from control.frames import rotation_from_quaternion
from control.joints import JOINT_NAMES
from control.kernels.compiled import kernel
from control.kernels.small_algebra import rotate, rotate_back
from control.robot_model import GRAVITY_MPS2
from sim.backends.simulation.sensors import SAMPLE_SIZE


class IdealSensors:
    """Reads the state of one world, once per tick."""

    STATE = ("_imu_velocity",)
    SCRATCH = ("_qpos", "_qvel", "_newest")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        # MuJoCo makes a new view at every access.
        self._qpos, self._qvel = data.qpos, data.qvel
        joints = [model.joint(joint) for joint in JOINT_NAMES]
        self._positions = np.array([joint.qposadr[0] for joint in joints], dtype=int)
        self._dofs = np.array([joint.dofadr[0] for joint in joints], dtype=int)
        self._lever = model.site("imu").pos.copy()
        self._period_s = model.opt.timestep
        self._newest = np.empty(SAMPLE_SIZE)
        self.reset()

    def reset(self) -> None:
        """Start over from a robot at rest."""
        self._imu_velocity = np.zeros(3)

    def read(self, joint_torque: np.ndarray) -> np.ndarray:
        """Sample (SAMPLE_SIZE,) of this tick, which the next one overwrites. `joint_torque`: (22,) N m, see Drives.torques."""
        _sample(
            self._qpos,
            self._qvel,
            joint_torque,
            self._positions,
            self._dofs,
            self._lever,
            self._period_s,
            self._imu_velocity,
            self._newest,
        )
        return self._newest


@kernel("void(f8[::1], f8[::1], f8[::1], i8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1])")
def _sample(
    qpos: np.ndarray,
    qvel: np.ndarray,
    joint_torque: np.ndarray,
    positions: np.ndarray,
    dofs: np.ndarray,
    lever: np.ndarray,
    period_s: float,
    imu_velocity: np.ndarray,
    sample: np.ndarray,
) -> None:
    """Encoders, and the IMU on the base: v_imu = v + R (w x l), and a = R^T ((v_imu - v_imu before) / T + g e_z).

    The acceleration is the mean over the tick, so that it integrates to the change of velocity under implicit integration too.

    Args:
        qpos, qvel: of MuJoCo; the base is the first body, v in world and w in base.
        joint_torque: (22,) N m.
        positions, dofs: (22,) where each joint's angle and velocity lie.
        lever: (3,) m, l, in base.
        period_s: T.
        imu_velocity: (3,) m/s, in world, at the end of the last tick; changed to that of this one.
        sample: (SAMPLE_SIZE,) the result.
    """
    count = len(positions)
    for joint in range(count):
        sample[joint] = qpos[positions[joint]]
        sample[count + joint] = qvel[dofs[joint]]
        sample[2 * count + joint] = joint_torque[joint]
    rates, orientation = qvel[3:6], qpos[3:7]
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
    acceleration = rotate_back(rotation, change)
    for i in range(3):
        sample[3 * count + i] = rates[i]
        sample[3 * count + 3 + i] = acceleration[i]
    sample[3 * count + 6 :] = orientation
