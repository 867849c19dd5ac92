"""Base and arm as one robot of 22 joints: newest sensor frame, commands, damping, health."""

import numpy as np

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, WHEEL_SLICE
from control.types import SensorFrame
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.unitree.driver import BaseDriver, BaseReading
from sim.backends.unitree.link import BaseLink
from sim.backends.unitree.motors import BASE_SLICE
from sim.backends.z1.driver import ArmReading, Z1Config, Z1Driver

_POKE_EVERY_S = 0.1
_INERTIAL = slice(0, 10)
SENSOR_COUNT = _INERTIAL.stop + 3 * JOINT_COUNT


def sensor_frame(time_s: float, sensors: np.ndarray) -> SensorFrame:
    """Views of `sensors`, (SENSOR_COUNT,): every field of a SensorFrame but its time, one after the other."""
    joints = sensors[_INERTIAL.stop :].reshape(3, JOINT_COUNT)
    return SensorFrame(time_s, sensors[0:4], sensors[4:7], sensors[7:10], joints[0], joints[1], joints[2])


class Robot:
    """Composes the two drivers. In a dry run it never sends.

    Attributes:
        base, arm: the drivers, for their counters.
        sensors: (SENSOR_COUNT,) numbers of the newest frame; joints: (3, 22) those of position, velocity and torque.
        frame: newest sensor frame, None until base and arm have been heard. Time is that of the base's reception.
    """

    def __init__(self, link: BaseLink, arm: Z1Config, limits: HardwareLimits, dry_run: bool, echo_tick: bool = False) -> None:
        """Raises BackendError when the arm's port is taken."""
        self.base = BaseDriver(link, echo_tick)
        self.arm = Z1Driver(arm)
        self.dry_run = dry_run
        self._damping = np.zeros((5, BASE_SLICE.stop))
        self._damping[3, LEG_SLICE], self._damping[3, WHEEL_SLICE] = limits.leg_damping, limits.wheel_damping
        self._poked_s = -np.inf
        self.sensors = np.full(SENSOR_COUNT, np.nan)
        self.joints = self.sensors[_INERTIAL.stop :].reshape(3, JOINT_COUNT)
        self.frame: SensorFrame | None = None

    @property
    def readings(self) -> tuple[BaseReading, ArmReading] | None:
        """Newest states of base and arm, None until both have been heard."""
        if self.base.reading is None or self.arm.reading is None:
            return None
        return self.base.reading, self.arm.reading

    def poll(self, now: float) -> bool:
        """Take in what has arrived; True when the base has a new state. `now` is monotonic seconds."""
        self.arm.poll(now)
        fresh = self.base.poll(now)
        base, arm = self.base.reading, self.arm.reading
        if fresh and base is not None and arm is not None:
            sensors = self.sensors = np.empty(SENSOR_COUNT)
            joints = self.joints = sensors[_INERTIAL.stop :].reshape(3, JOINT_COUNT)
            sensors[_INERTIAL] = base.inertial
            joints[:, BASE_SLICE] = base.joints
            joints[:, ARM_SLICE] = arm.joints
            self.frame = sensor_frame(now, sensors)
        return fresh

    def temperature(self) -> np.ndarray:
        """(22,) degrees Celsius, NaN where unknown."""
        values = np.full(JOINT_COUNT, np.nan)
        if self.base.reading is not None:
            values[BASE_SLICE] = self.base.reading.motors.temperature
        if self.arm.reading is not None:
            values[ARM_SLICE] = self.arm.reading.motors.temperature
        return values

    def write(self, now: float, targets: np.ndarray) -> None:
        """Send position, velocity, stiffness, damping and torque, (5, 22), arm first: the base's frame ends the tick."""
        if self.dry_run:
            return
        self.arm.write(now, targets[:, ARM_SLICE])
        self.base.write(targets[:, BASE_SLICE])

    def damp(self) -> None:
        """Damp everything: no stiffness, no feed-forward; independent of any measurement."""
        if self.dry_run:
            return
        self.arm.damp()
        self.base.write(self._damping)

    def observe(self, now: float) -> None:
        """Keep an arm that speaks only when spoken to speaking, with frames that ask for nothing."""
        silent = now - self.arm.received_s > _POKE_EVERY_S
        if not self.dry_run and silent and now - self._poked_s > _POKE_EVERY_S:
            self._poked_s = now
            self.arm.poke()

    def close(self) -> None:
        """Leave both networks."""
        self.arm.close()
        self.base.close()
