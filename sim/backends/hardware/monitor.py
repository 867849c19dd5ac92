"""Watches the robot's health at every tick: reasons to warn, to sit down, to damp. Holds durations, decides nothing."""

import math
from dataclasses import dataclass

import numpy as np

from control.frames import rotation_from_quaternion
from control.joints import JOINT_COUNT, TORQUE_LIMIT
from control.types import SensorFrame
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import Trip
from sim.backends.unitree.driver import BaseReading
from sim.backends.unitree.motors import BASE_SLICE
from sim.backends.z1.driver import ArmReading

_FOREIGN_CHECK_S = 0.1


@dataclass(frozen=True, slots=True)
class Health:
    """One tick's findings: reasons to damp at once, to sit down, to warn."""

    damp: Trip
    sit: Trip
    warn: Trip


class HealthMonitor:
    """Checks one robot against its limits."""

    def __init__(self, limits: HardwareLimits, position_lower: np.ndarray, position_upper: np.ndarray) -> None:
        self.limits = limits
        self._lower = position_lower - limits.overtravel_rad
        self._upper = position_upper + limits.overtravel_rad
        self._velocity_limit = limits.velocity_limit()
        self._torque_trip = limits.torque_fraction * TORQUE_LIMIT
        self._moved_s = self._checked_s = 0.0
        self.foreign_writers = 0
        self.reset(0, 0, 0.0)

    def reset(self, foreign_frames: int, foreign_writers: int, now: float) -> None:
        """Forget durations; foreign commands and writers seen so far are not news."""
        self._foreign_frames = foreign_frames
        self._foreign_baseline = foreign_writers
        self._foreign_check_s = now
        self._loaded_since = np.full(JOINT_COUNT, np.inf)
        self._fast_since = np.full(JOINT_COUNT, np.inf)
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
        readings, frame = robot.readings, robot.frame
        if readings is None or frame is None:
            self._moved_s = now
            return Health(damp, sit, warn)
        # A robot that stands still falls once it is damped; NaN is not slow; a state that has gone old may hide a fall.
        if active or damp & Trip.STALE_STATE or not (np.abs(frame.joint_velocity[BASE_SLICE]) < limits.rest_velocity_rps).all():
            self._moved_s = now
        base, arm = readings
        damp |= self._body(now, frame, active)
        up = rotation_from_quaternion(base.orientation_wxyz)[2, 2]
        if not up >= math.cos(limits.tilt_damp_rad):
            damp |= Trip.TILT
        elif up < math.cos(limits.tilt_warn_rad):
            warn |= Trip.TILT
        damp, sit, warn = self._supplies(base, arm, damp, sit, warn)
        if active and not base.active.all():
            damp |= Trip.MOTOR
        if arm.error.any() or arm.disconnected.any():
            damp |= Trip.ARM
        if base.remote_stop:
            damp |= Trip.REMOTE_STOP
        return Health(damp, sit, warn)

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
        hottest = max(base.temperature.max(), arm.temperature.max())
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

    def _body(self, now: float, frame: SensorFrame, active: bool) -> Trip:
        q, dq, torque = frame.joint_position, frame.joint_velocity, frame.joint_torque
        sums = q.sum() + dq.sum() + torque.sum() + frame.orientation_wxyz.sum()
        if not math.isfinite(sums + frame.angular_velocity.sum() + frame.linear_acceleration.sum()):
            return Trip.NOT_FINITE
        trips = Trip.NONE
        if (q < self._lower).any() or (q > self._upper).any():
            trips |= Trip.JOINT_LIMIT
        if not active:
            self._loaded_since[:] = self._fast_since[:] = np.inf
            self._still_since[:] = now
            return trips
        limits = self.limits
        if _lasts(np.abs(torque) > self._torque_trip, self._loaded_since, now, limits.torque_s):
            trips |= Trip.TORQUE
        if _lasts(np.abs(dq) > self._velocity_limit, self._fast_since, now, limits.velocity_s):
            trips |= Trip.JOINT_VELOCITY
        moved = q != self._still_position
        self._still_position = q
        self._still_since[moved] = now
        self._still_low = np.where(moved, torque, np.minimum(self._still_low, torque))
        self._still_high = np.where(moved, torque, np.maximum(self._still_high, torque))
        pushed = self._still_high - self._still_low > limits.stuck_torque_nm
        if (pushed & (now - self._still_since > limits.stuck_s)).any():
            trips |= Trip.STUCK_ENCODER
        return trips


def _lasts(holds: np.ndarray, since: np.ndarray, now: float, duration_s: float) -> bool:
    """Whether any element of `holds` has been true for `duration_s`; `since` keeps when each became so."""
    if not holds.any():
        since[:] = np.inf
        return False
    since[:] = np.where(holds, np.minimum(since, now), np.inf)
    return bool((now - since >= duration_s).any())
