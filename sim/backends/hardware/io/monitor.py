"""Watches the robot's health at every tick: reasons to warn, to sit down, to damp. Holds durations, decides nothing."""

import math
from typing import NamedTuple

import numpy as np

from control.joints import JOINT_COUNT, TORQUE_LIMIT
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import Trip, joint_bits
from sim.backends.unitree.driver import BaseReading
from sim.backends.unitree.motors import BASE_SLICE
from sim.backends.z1.driver import ArmReading

_FOREIGN_CHECK_S = 0.1


class Health(NamedTuple):
    """One tick's findings: reasons to damp at once, to sit down, to warn, and the joints whose they are (`joint_bits`)."""

    damp: Trip
    sit: Trip
    warn: Trip
    joints: int = 0


class HealthMonitor:
    """Checks one robot against its limits."""

    def __init__(self, limits: HardwareLimits, position_lower: np.ndarray, position_upper: np.ndarray) -> None:
        self.limits = limits
        velocity, torque = limits.velocity_limit(), limits.torque_fraction * TORQUE_LIMIT
        self._lower = np.stack((position_lower - limits.overtravel_rad, -velocity, -torque))
        self._upper = np.stack((position_upper + limits.overtravel_rad, velocity, torque))
        self._durations_s = np.array([[limits.velocity_s], [limits.torque_s]])
        self._moved_s = self._checked_s = 0.0
        self.foreign_writers = 0
        self.reset(0, 0, 0.0)

    def reset(self, foreign_frames: int, foreign_writers: int, now: float) -> None:
        """Forget durations; foreign commands and writers seen so far are not news."""
        self._foreign_frames = foreign_frames
        self._foreign_baseline = foreign_writers
        self._foreign_check_s = now
        self._beyond_since = np.full((2, JOINT_COUNT), np.inf)
        self._still_since = np.full(JOINT_COUNT, now)
        self._still_position = np.full(JOINT_COUNT, np.nan)
        self._still_low = np.zeros(JOINT_COUNT)
        self._still_high = np.zeros(JOINT_COUNT)

    def check(self, now: float, robot: Robot, active: bool) -> Health:
        """`active`: the motors carry stiffness, so encoders, torque and speed mean something."""
        limits = self.limits
        self._checked_s = now
        damp, sit, warn = self._foreign(now, robot), Trip.NONE, Trip.NONE
        for age, trip in ((now - robot.base.received_s, Trip.STALE_STATE), (now - robot.arm.received_s, Trip.STALE_ARM)):
            if age > limits.state_damp_s:
                damp |= trip
            elif age > limits.state_warn_s:
                warn |= trip
        base, arm = robot.base.reading, robot.arm.reading
        if base is None or arm is None or robot.frame is None:
            self._moved_s = now
            return Health(damp, sit, warn)
        # A robot that stands still falls once it is damped; NaN is not slow; a state that has gone old may hide a fall.
        if active or damp & Trip.STALE_STATE or not (np.abs(robot.joints[1, BASE_SLICE]) < limits.rest_velocity_rps).all():
            self._moved_s = now
        body, joints = self._body(now, robot, active)
        damp |= body
        _, x, y, _ = base.inertial[:4].tolist()
        up = 1.0 - 2.0 * (x * x + y * y)  # the base's z axis along the world's
        if not up >= math.cos(limits.tilt_damp_rad):
            damp |= Trip.TILT
        elif up < math.cos(limits.tilt_warn_rad):
            warn |= Trip.TILT
        damp, sit, warn = self._supplies(base, arm, damp, sit, warn)
        if Trip.TEMPERATURE in damp | sit:
            joints |= joint_bits(robot.temperature() >= limits.temperature_sit_c)
        if active and not base.motors.active:
            damp |= Trip.MOTOR
        if arm.motors.faulty:
            damp |= Trip.ARM
        if base.remote_stop:
            damp |= Trip.REMOTE_STOP
        return Health(damp, sit, warn, joints)

    @property
    def at_rest(self) -> bool:
        """Whether legs and wheels, without stiffness, have been slow for `rest_s`; a passive arm may still sink."""
        return self._checked_s - self._moved_s > self.limits.rest_s

    def _foreign(self, now: float, robot: Robot) -> Trip:
        frames = robot.base.link.foreign_frames()
        if now >= self._foreign_check_s:
            self._foreign_check_s = now + _FOREIGN_CHECK_S
            self.foreign_writers = robot.base.link.foreign_writers()
        if frames > self._foreign_frames or self.foreign_writers > self._foreign_baseline:
            return Trip.FOREIGN_WRITER
        return Trip.NONE

    def _supplies(self, base: BaseReading, arm: ArmReading, damp: Trip, sit: Trip, warn: Trip) -> tuple[Trip, Trip, Trip]:
        limits = self.limits
        hottest = max(base.motors.hottest, arm.motors.hottest)
        if hottest >= limits.temperature_damp_c:
            damp |= Trip.TEMPERATURE
        elif hottest >= limits.temperature_sit_c:
            sit |= Trip.TEMPERATURE
        elif hottest >= limits.temperature_warn_c:
            warn |= Trip.TEMPERATURE
        if base.battery_percent < limits.battery_sit_percent:
            sit |= Trip.BATTERY
        elif base.battery_percent < limits.battery_warn_percent:
            warn |= Trip.BATTERY
        return damp, sit, warn

    def _body(self, now: float, robot: Robot, active: bool) -> tuple[Trip, int]:
        if not math.isfinite(np.add.reduce(robot.sensors)):
            return Trip.NOT_FINITE, joint_bits(~np.isfinite(np.add.reduce(robot.joints)))
        trips, culprits, joints = Trip.NONE, 0, robot.joints
        beyond = (joints < self._lower) | (joints > self._upper)
        some = np.count_nonzero(beyond) > 0
        if some and beyond[0].any():
            trips, culprits = trips | Trip.JOINT_LIMIT, joint_bits(beyond[0])
        if not (some and active):
            self._beyond_since[:] = np.inf
        else:
            self._beyond_since = np.where(beyond[1:], np.minimum(self._beyond_since, now), np.inf)
            lasting = now - self._beyond_since >= self._durations_s
            for trip, late in zip((Trip.JOINT_VELOCITY, Trip.TORQUE), lasting, strict=True):
                if late.any():
                    trips, culprits = trips | trip, culprits | joint_bits(late)
        if not active:
            self._still_since[:] = now
        elif stuck := self._stuck(now, joints[0], joints[2]):
            trips, culprits = trips | Trip.STUCK_ENCODER, culprits | stuck
        return trips, culprits

    def _stuck(self, now: float, position: np.ndarray, torque: np.ndarray) -> int:
        """The joints whose encoder stays while the torque of their motor changes."""
        moved = position != self._still_position
        self._still_position = position
        if np.count_nonzero(moved) == JOINT_COUNT:
            self._still_since[:] = now
            self._still_low = self._still_high = torque
            return 0
        self._still_since[moved] = now
        self._still_low = np.where(moved, torque, np.minimum(self._still_low, torque))
        self._still_high = np.where(moved, torque, np.maximum(self._still_high, torque))
        pushed = self._still_high - self._still_low > self.limits.stuck_torque_nm
        if not np.count_nonzero(pushed):
            return 0
        return joint_bits(pushed & (now - self._still_since > self.limits.stuck_s))
