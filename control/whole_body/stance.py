"""Where the wheels stand under the trunk: they follow the centre of pressure, so a pulled robot leans against the pull."""

from dataclasses import dataclass

import numpy as np

from control.joints import LEG_SLICE, LEGS, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S

_STEP_RAD = 1e-4


@dataclass(frozen=True, slots=True)
class StanceConfig:
    """Attributes:
    gain: 1/s, of the distance between the centre of pressure and the middle of the wheels, beyond the dead band.
    dead_band_m: distance that is left alone; the wheels stand 0.17 m from their middle.
    return_gain: 1/s, at which the wheels go back to their nominal place.
    limit_m: farthest shift of the wheels from their nominal place, per axis.
    speed_mps: fastest shift.
    """

    gain: float = 2.0
    dead_band_m: float = 0.025
    return_gain: float = 0.2
    limit_m: float = 0.06
    speed_mps: float = 0.1


class Stance:
    """Leg posture whose wheels stand shifted in the plane by an integral of the centre of pressure.

    Attributes:
        shift_velocity: (2,) m/s, heading frame, of the wheels under the trunk at the last step.
    """

    def __init__(self, config: StanceConfig, model: RobotModel) -> None:
        """Takes the legs' kinematics at the nominal posture from `model`, which is left in that posture."""
        self.config = config
        self._leg_rad_per_m = np.linalg.inv(_contact_jacobians(model))
        self.reset()

    def reset(self) -> None:
        """Back to the nominal stance."""
        self._shift = np.zeros(2)
        self.shift_velocity = np.zeros(2)

    def step(self, vertical_forces: np.ndarray, contacts_in_heading: np.ndarray) -> np.ndarray:
        """Leg posture (12,), rad.

        Args:
            vertical_forces: (4,) N, that the balance asks of the wheels.
            contacts_in_heading: (4, 3) m, from the base origin.
        """
        config = self.config
        planar = contacts_in_heading[:, :2]
        pressure = vertical_forces @ planar / max(float(vertical_forces.sum()), 1.0)
        offset = pressure - planar.mean(axis=0)
        excess = offset - np.clip(offset, -config.dead_band_m, config.dead_band_m)
        velocity = config.gain * excess - config.return_gain * self._shift
        velocity = np.clip(velocity, -config.speed_mps, config.speed_mps)
        last = self._shift
        self._shift = np.clip(last + velocity * CONTROL_PERIOD_S, -config.limit_m, config.limit_m)
        self.shift_velocity = (self._shift - last) / CONTROL_PERIOD_S
        return NOMINAL_POSITION[LEG_SLICE] + (self._leg_rad_per_m[:, :, :2] @ self._shift).reshape(12)


def _contact_jacobians(model: RobotModel) -> np.ndarray:
    """(4, 3, 3) m/rad: motion of each wheel's lowest point with its leg's hip, thigh and calf, by central differences."""
    jacobians = np.empty((len(LEGS), 3, 3))
    posture = NOMINAL_POSITION.copy()
    for leg in range(len(LEGS)):
        for joint in range(3):
            ends = []
            for step in (_STEP_RAD, -_STEP_RAD):
                posture[3 * leg + joint] += step
                model.update_configuration(np.eye(3), posture)
                ends.append(model.wheel_contact_positions[leg].copy())
                posture[3 * leg + joint] -= step
            jacobians[leg, :, joint] = (ends[0] - ends[1]) / (2.0 * _STEP_RAD)
    return jacobians
