"""What the robot's encoders and thermometers say: the body's truth, except where a fault falsifies it."""

import numpy as np

from control.joints import JOINT_COUNT, JOINT_NAMES
from control.timing import TICK_S
from sim.emulator.faults import Faults
from sim.emulator.physics import RobotBody


class JointReadings:
    """The readings of one board."""

    def __init__(self, body: RobotBody, faults: Faults) -> None:
        self._body = body
        self._faults = faults
        self._stuck: dict[str, float] = {}
        self._heat = np.zeros(JOINT_COUNT)

    def take(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position in rad, velocity in rad/s, temperature in degrees Celsius, (22,) each. Once per state that is sent."""
        faults, frame = self._faults, self._body.frame
        position, velocity = frame.joint_position.copy(), frame.joint_velocity.copy()
        if faults.stuck_encoder:
            joint = JOINT_NAMES.index(faults.stuck_encoder)
            position[joint] = self._stuck.setdefault(faults.stuck_encoder, float(position[joint]))
            velocity[joint] = 0.0
        else:
            self._stuck.clear()
        if faults.nan:
            position[JOINT_NAMES.index(faults.nan)] = np.nan
        if faults.overheat:
            self._heat[JOINT_NAMES.index(faults.overheat)] += TICK_S * faults.overheat_rate
        else:
            self._heat[:] = 0.0
        return position, velocity, self._body.temperature + self._heat
