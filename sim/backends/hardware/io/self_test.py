"""What must hold for two seconds before the motors are engaged."""

import math

import numpy as np

from control.frames import rotation_from_quaternion
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import Trip, describe


class SelfTest:
    """Watches states that arrive; `failures` tells what is wrong once it is `done`."""

    def __init__(self, limits: HardwareLimits, robot: Robot, now: float) -> None:
        self._limits = limits
        self._robot = robot
        self._end_s = now + limits.self_test_s
        self._start_s = now
        self._last_s = now
        self._periods: list[float] = []
        self._received = robot.base.received
        self._bad = robot.base.bad_samples + robot.arm.bad_frames
        self._foreign = robot.base.link.foreign_frames()
        self._lost = None if robot.base.reading is None else robot.base.reading.motors.lost.astype(np.int64)
        self._unhealthy = Trip.NONE
        self._joints = 0
        self.done = False
        self.failures: tuple[str, ...] = ()

    def progress(self, now: float) -> float:
        """0 to 1."""
        return min(1.0, (now - self._start_s) / self._limits.self_test_s)

    def step(self, now: float, fresh: bool, unhealthy: Trip, joints: int) -> None:
        """One tick: whether a new state came, and what the monitor found, of which joints (`joint_bits`)."""
        if fresh:
            self._periods.append(now - self._last_s)
            self._last_s = now
        self._unhealthy |= unhealthy
        self._joints |= joints
        if now >= self._end_s:
            self.done = True
            self.failures = tuple(self._judge())

    def _judge(self) -> list[str]:
        limits, robot = self._limits, self._robot
        failures = describe(self._unhealthy, self._joints)
        readings = robot.readings
        if readings is None or len(self._periods) < 10:
            return [*failures, "base and arm must both send states; check cable, power and z1_ctrl"]
        base, _ = readings
        slow = float(np.quantile(self._periods, 0.999))
        if slow > limits.self_test_period_s:
            failures.append(
                f"99.9 % of the periods between states are below {1e3 * slow:.1f} ms; "
                f"they must be below {1e3 * limits.self_test_period_s:.0f} ms (real-time scheduling, less load, another cable)"
            )
        bad = robot.base.bad_samples + robot.arm.bad_frames - self._bad
        if bad:
            failures.append(f"{bad} messages were unsound (CRC, length); none may be")
        if not base.motors.active:
            failures.append("a motor of the base is not in servo mode")
        if self._lost is not None:
            allowed = limits.self_test_lost_fraction * len(self._periods)
            if ((base.motors.lost.astype(np.int64) - self._lost) > allowed).any():
                failures.append("a motor of the base loses packets")
        tilt = math.acos(np.clip(rotation_from_quaternion(base.inertial[:4])[2, 2], -1.0, 1.0))
        if not tilt < limits.self_test_tilt_rad:
            failures.append(f"the base is tilted by {tilt:.2f} rad; lay the robot flat (below {limits.self_test_tilt_rad} rad)")
        if base.battery_percent < limits.battery_engage_percent:
            failures.append(f"battery at {base.battery_percent} %; charge it to {limits.battery_engage_percent} %")
        if robot.base.link.foreign_frames() > self._foreign:
            failures.append("another program publishes on rt/lowcmd; end it")
        return failures
