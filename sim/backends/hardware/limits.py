"""Every threshold that damps, sits or refuses, in one place. Values and their sources: notes on public deployment code."""

from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, WHEEL_SLICE
from control.safety import SafetyConfig

_GATE = SafetyConfig()
"""The I/O process does not rely on the gate, which is another process's; what both guard they guard at the same thresholds."""


@dataclass(frozen=True, slots=True)
class HardwareLimits:
    """Thresholds of the I/O process. Torque limits are control.joints.TORQUE_LIMIT, position limits the model's.

    | what | warn | act |
    |---|---|---|
    | age of the robot's state | state_warn_s | damp at state_damp_s |
    | age of the policy's command | held from command_hold_s | damp at command_damp_s |
    | control process silent while the I/O process itself moves the robot | | damp at control_damp_s |
    | console's web process silent | (control.safety stops the base after setpoint_timeout_s) | damp at operator_damp_s |
    | tilt of the base | tilt_warn_rad | damp at tilt_damp_rad |
    | motor temperature | temperature_warn_c | sit at temperature_sit_c, damp at temperature_damp_c |
    | battery | battery_warn_percent | refuse below battery_engage_percent, sit at battery_sit_percent |
    | measured torque | | damp above torque_fraction of the limit for torque_s |
    | predicted torque | | clipped to the limit before it is sent |
    | joint beyond its end | | damp at overtravel_rad |
    | joint too fast | | damp above the velocity for velocity_s |
    | encoder unchanged for stuck_s while its torque changes by stuck_torque_nm | | damp |
    | NaN, infinity, absurd value, wrong shape in a command | | rejected, damp, latch |
    | another writer of commands | | damp, latch |
    | an error of the I/O process itself | | damp, latch |
    | the robot's clock starts anew after a silence: its own program owns the motors again | | nothing more is sent, latch |

    Attributes:
        position_margin_rad: over this distance before a joint limit the torque towards it fades to zero.
        leg_damping, wheel_damping: N m s/rad while damping, stiffness zero; the arm goes PASSIVE.
        release_timeout_s: for the robot's motion program to let go of the motors.
        self_test_s: states are watched for this long before the motors are engaged.
        self_test_period_s: 99.9 % of the periods between states must be below.
        self_test_tilt_rad: the robot must lie flatter than this.
        self_test_lost_fraction: packets a motor may lose during the test.
        rest_velocity_rps, rest_s: legs and wheels without stiffness and slower than this for this long are at rest: a latched
            fault may be cleared, and the I/O process may end.
        orphan_s: nobody controls and the robot is at rest, or has been silent for as long: the I/O process ends after this.
    """

    state_warn_s: float = 0.01
    state_damp_s: float = 0.05
    command_hold_s: float = _GATE.hold_timeout_s
    command_damp_s: float = _GATE.damp_timeout_s
    control_damp_s: float = 0.5
    operator_damp_s: float = 1.0
    tilt_warn_rad: float = _GATE.tilt_warn_rad
    tilt_damp_rad: float = _GATE.tilt_damp_rad
    temperature_warn_c: float = 65.0
    temperature_sit_c: float = 70.0
    temperature_damp_c: float = 80.0
    battery_warn_percent: int = 25
    battery_engage_percent: int = 20
    battery_sit_percent: int = 15
    torque_fraction: float = 0.9
    torque_s: float = 0.3
    position_margin_rad: float = _GATE.position_margin_rad
    overtravel_rad: float = 0.15
    leg_velocity_rps: float = _GATE.leg_velocity_rps
    wheel_velocity_rps: float = _GATE.wheel_velocity_rps
    arm_velocity_rps: float = 3.1
    velocity_s: float = 0.05
    stuck_s: float = 0.5
    stuck_torque_nm: float = 3.0
    leg_damping: float = _GATE.leg_damping
    wheel_damping: float = _GATE.wheel_damping
    release_timeout_s: float = 10.0
    self_test_s: float = 2.0
    self_test_period_s: float = 0.01
    self_test_tilt_rad: float = 0.3
    self_test_lost_fraction: float = 0.01
    rest_velocity_rps: float = 0.5
    rest_s: float = 0.5
    orphan_s: float = 60.0

    def velocity_limit(self) -> np.ndarray:
        """(22,) rad/s."""
        limit = np.empty(JOINT_COUNT)
        limit[LEG_SLICE], limit[WHEEL_SLICE], limit[ARM_SLICE] = (
            self.leg_velocity_rps,
            self.wheel_velocity_rps,
            self.arm_velocity_rps,
        )
        return limit
