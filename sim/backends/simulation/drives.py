"""The drives of the simulated robot: a JointCommand with any gains goes through MuJoCo's implicit integration.

The actuators of the model become generic affine ones, of gain 1 and bias [0, -stiffness, -damping]; their control is
stiffness q_d + damping dq_d + feed-forward torque.
"""

import mujoco
import numpy as np

from control.joints import JOINT_COUNT, JOINT_NAMES
from control.kernels.compiled import kernel
from control.types import JointCommand


class Drives:
    """The drives of one world. `act` before a tick, `torques` after it."""

    STATE = ()
    SCRATCH = ("_bias", "_control", "_velocity", "_force", "_velocity_before", "_torques")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Makes the actuators of `model` affine."""
        drives = self._actuators = np.array([model.actuator(joint).id for joint in JOINT_NAMES])
        model.actuator_gaintype[drives] = mujoco.mjtGain.mjGAIN_FIXED
        model.actuator_biastype[drives] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_gainprm[drives] = 0.0
        model.actuator_gainprm[drives, 0] = 1.0
        model.actuator_biasprm[drives] = 0.0
        model.actuator_ctrllimited[drives] = 0
        self._dofs = np.array([model.joint(joint).dofadr[0] for joint in JOINT_NAMES], dtype=int)
        self._limit = model.actuator_forcerange[drives, 1].copy()
        self._velocity_before, self._torques = np.zeros(JOINT_COUNT), np.zeros(JOINT_COUNT)
        # MuJoCo makes a new view at every access.
        self._bias, self._control, self._velocity = model.actuator_biasprm, data.ctrl, data.qvel
        self._force = data.actuator_force

    def release(self) -> None:
        """Drive no joint until the next command."""
        self._bias[self._actuators] = 0.0

    def act(self, command: JointCommand) -> None:
        """Drive the joints with `command` from now on."""
        _drive(
            command.position,
            command.velocity,
            command.stiffness,
            command.damping,
            command.torque,
            self._actuators,
            self._dofs,
            self._velocity,
            self._bias,
            self._control,
            self._velocity_before,
        )

    def torques(self, command: JointCommand) -> np.ndarray:
        """(22,) N m that the drives have given over the tick with `command`; the next tick's overwrite them."""
        _given_torques(
            self._force,
            self._velocity,
            command.damping,
            self._actuators,
            self._dofs,
            self._limit,
            self._velocity_before,
            self._torques,
        )
        return self._torques


@kernel("void(vector, vector, vector, vector, vector, i8[::1], i8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def _drive(
    position: np.ndarray,
    velocity: np.ndarray,
    stiffness: np.ndarray,
    damping: np.ndarray,
    torque: np.ndarray,
    actuators: np.ndarray,
    dofs: np.ndarray,
    qvel: np.ndarray,
    bias: np.ndarray,
    control: np.ndarray,
    velocity_before: np.ndarray,
) -> None:
    """u = K_p q_d + K_d dq_d + tau, with the bias -K_p q - K_d dq left to MuJoCo.

    Args:
        position, velocity, stiffness, damping, torque: (22,) of the command.
        actuators, dofs: (22,) number of each joint's actuator and degree of freedom.
        qvel: of MuJoCo.
        bias, control: of MuJoCo's actuators, the results.
        velocity_before: (22,) rad/s, becomes the present joint velocities.
    """
    for joint in range(len(actuators)):
        actuator = actuators[joint]
        bias[actuator, 1] = -stiffness[joint]
        bias[actuator, 2] = -damping[joint]
        control[actuator] = stiffness[joint] * position[joint] + damping[joint] * velocity[joint] + torque[joint]
        velocity_before[joint] = qvel[dofs[joint]]


@kernel("void(f8[::1], f8[::1], vector, i8[::1], i8[::1], f8[::1], f8[::1], f8[::1])")
def _given_torques(
    force: np.ndarray,
    qvel: np.ndarray,
    damping: np.ndarray,
    actuators: np.ndarray,
    dofs: np.ndarray,
    limit: np.ndarray,
    velocity_before: np.ndarray,
    torques: np.ndarray,
) -> None:
    """tau = f - K_d (dq - dq_before): implicit damping acts on the velocity at the end of the tick.

    Not so in a drive that is clipped at its limit, where tau = f.

    Args:
        force: N m, of MuJoCo's actuators.
        qvel: of MuJoCo.
        damping: (22,) K_d.
        actuators, dofs: (22,) number of each joint's actuator and degree of freedom.
        limit: (22,) N m.
        velocity_before: (22,) rad/s, at the start of the tick.
        torques: (22,) the results.
    """
    for joint in range(len(torques)):
        torque = force[actuators[joint]]
        if abs(torque) < limit[joint]:
            torque -= damping[joint] * (qvel[dofs[joint]] - velocity_before[joint])
        torques[joint] = torque
