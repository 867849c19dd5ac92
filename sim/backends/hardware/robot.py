"""Base and arm as one robot of 22 joints: newest sensor frame, commands, damping, health."""

import numpy as np

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, WHEEL_SLICE
from control.types import JointCommand, SensorFrame
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.unitree.driver import BaseDriver, BaseReading
from sim.backends.unitree.link import BaseLink
from sim.backends.unitree.motors import BASE_SLICE
from sim.backends.z1.driver import ArmReading, Z1Config, Z1Driver

_POKE_EVERY_S = 0.1


class Robot:
    """Composes the two drivers. In a dry run it never sends.

    Attributes:
        base, arm: the drivers, for their counters.
    """

    def __init__(self, link: BaseLink, arm: Z1Config, limits: HardwareLimits, dry_run: bool, echo_tick: bool = False) -> None:
        """Raises BackendError when the arm's port is taken."""
        self.base = BaseDriver(link, echo_tick)
        self.arm = Z1Driver(arm)
        self.dry_run = dry_run
        self._damping = np.zeros(BASE_SLICE.stop)
        self._damping[LEG_SLICE], self._damping[WHEEL_SLICE] = limits.leg_damping, limits.wheel_damping
        self._zero = np.zeros(BASE_SLICE.stop)
        self._poked_s = -np.inf
        self._frame: SensorFrame | None = None

    @property
    def readings(self) -> tuple[BaseReading, ArmReading] | None:
        """Newest states of base and arm, None until both have been heard."""
        if self.base.reading is None or self.arm.reading is None:
            return None
        return self.base.reading, self.arm.reading

    @property
    def frame(self) -> SensorFrame | None:
        """Newest sensor frame, None until base and arm have been heard. Time is that of the base's reception."""
        return self._frame

    def poll(self, now: float) -> bool:
        """Take in what has arrived; True when the base has a new state. `now` is monotonic seconds."""
        self.arm.poll(now)
        fresh = self.base.poll(now)
        readings = self.readings
        if fresh and readings is not None:
            base, arm = readings
            self._frame = SensorFrame(
                time_s=now,
                orientation_wxyz=base.orientation_wxyz,
                angular_velocity=base.angular_velocity,
                linear_acceleration=base.linear_acceleration,
                joint_position=np.concatenate((base.position, arm.position)),
                joint_velocity=np.concatenate((base.velocity, arm.velocity)),
                joint_torque=np.concatenate((base.torque, arm.torque)),
            )
        return fresh

    def temperature(self) -> np.ndarray:
        """(22,) degrees Celsius, NaN where unknown."""
        values = np.full(JOINT_COUNT, np.nan)
        if self.base.reading is not None:
            values[BASE_SLICE] = self.base.reading.temperature
        if self.arm.reading is not None:
            values[ARM_SLICE] = self.arm.reading.temperature
        return values

    def write(self, now: float, command: JointCommand) -> None:
        """Send one command, arm first: the base's frame ends the tick."""
        if self.dry_run:
            return
        parts = (command.position, command.velocity, command.stiffness, command.damping, command.torque)
        self.arm.write(now, *(part[ARM_SLICE] for part in parts))
        self.base.write(*(part[BASE_SLICE] for part in parts))

    def damp(self) -> None:
        """Damp everything: no stiffness, no feed-forward; independent of any measurement."""
        if self.dry_run:
            return
        self.arm.damp()
        self.base.write(self._zero, self._zero, self._zero, self._damping, self._zero)

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
