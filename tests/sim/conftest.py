"""A robot that stands: nominal posture, the paper's gains, and the torques that carry its weight as feed-forward."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from control.joints import DAMPING, JOINT_COUNT, JOINT_NAMES, LEGS, NOMINAL_POSITION, STIFFNESS
from control.types import JointCommand
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig


def gravity_torque(backend: MujocoBackend) -> np.ndarray:
    """Joint torques (22,) of static balance on the four wheels, with the least-norm contact forces."""
    model, data = backend.model, backend.data
    jacobian = np.zeros((3 * len(LEGS), model.nv))
    for row, (leg, point) in enumerate(zip(LEGS, backend.truth().wheel_contact_positions, strict=True)):
        mujoco.mj_jac(model, data, jacobian[3 * row : 3 * row + 3], None, point, model.body(f"{leg}_wheel").id)
    forces = np.linalg.lstsq(jacobian[:, :6].T, data.qfrc_bias[:6], rcond=None)[0]
    generalized = data.qfrc_bias - jacobian.T @ forces
    return generalized[[model.joint(name).dofadr[0] for name in JOINT_NAMES]]


@pytest.fixture
def standing() -> Callable[..., tuple[MujocoBackend, JointCommand]]:
    """Factory `standing(scene="free", sensors=ideal)` of an opened backend and the command that holds it up."""

    def make(scene: str = "free", sensors: SensorConfig | None = None) -> tuple[MujocoBackend, JointCommand]:
        backend = MujocoBackend(scene, SensorConfig.ideal() if sensors is None else sensors)
        backend.open()
        return backend, JointCommand(
            position=NOMINAL_POSITION,
            velocity=np.zeros(JOINT_COUNT),
            stiffness=STIFFNESS,
            damping=DAMPING,
            torque=gravity_torque(backend),
        )

    return make
