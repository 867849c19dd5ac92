"""The residual r of eq. (8) from each tick's sensors: the momentum observer fed with the model's terms.

The same observer, told no torque and no friction, finds N = M vdot + h, the whole inertial and gravity force of the nominal
model, with exactly the lag of r; told all but the friction, it finds the nominal friction. Adaptation needs both.
"""

import math

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.momentum_observer import ObserverGains, observe
from control.joints import JOINT_COUNT
from control.kernels.compiled import kernel

FRICTION_SMOOTHING_RPS = 0.01
"""Joint speed at which dry friction reaches tanh(1) of its value. It may lie below the noise of the velocity, which smooths
what the observer averages anyway."""

_RESIDUAL, _INERTIAL, _RESIDUAL_WITH_FRICTION = range(3)


@kernel("void(vector, f8[::1], f8[::1], f8[::1])")
def nominal_friction_torque(
    joint_velocity: np.ndarray, dry_friction: np.ndarray, damping: np.ndarray, friction: np.ndarray
) -> None:
    """Torque that nominal joint damping and dry friction take away: mu tanh(v / v_0) + d v.

    Args:
        joint_velocity: (22,) v, rad/s.
        dry_friction: (22,) mu, N m.
        damping: (22,) d, N m s/rad.
        friction: (22,) N m, the result.
    """
    for joint in range(len(friction)):
        velocity = joint_velocity[joint]
        friction[joint] = dry_friction[joint] * math.tanh(velocity / FRICTION_SMOOTHING_RPS) + damping[joint] * velocity


@kernel("void(f8[::1], f8[::1], vector, f8[::1], i8[::1], f8[:,::1])")
def momentum_inputs(
    drift_before: np.ndarray,
    drift: np.ndarray,
    torque: np.ndarray,
    friction: np.ndarray,
    joint_rows: np.ndarray,
    inputs: np.ndarray,
) -> None:
    """Known inputs u = S^T tau + Mdot v - h of eq. (5) over the tick that ends now.

    The torque acted over that tick; the model's terms are those at its start.

    Args:
        drift_before: (28,) Mdot v - h at the tick's start; becomes `drift`.
        drift: (28,) Mdot v - h now.
        torque: (22,) N m, measured.
        friction: (22,) N m, nominal, zero where it is not to be taken out of the residual.
        joint_rows: (22,) generalized row of each joint.
        inputs: (3, 28) the results: all told; told neither torque nor friction; told all but the friction.
    """
    for row in range(len(drift)):
        for k in range(len(inputs)):
            inputs[k, row] = drift_before[row]
        drift_before[row] = drift[row]
    for joint in range(len(joint_rows)):
        row = joint_rows[joint]
        inputs[_RESIDUAL, row] += torque[joint] - friction[joint]
        inputs[_RESIDUAL_WITH_FRICTION, row] += torque[joint]


@kernel(
    "b1(vector, vector, i8[::1], f8[::1], f8[::1], b1, f8[::1], f8[::1], f8[::1], b1, f8, f8, f8, f8, f8[::1],"
    " f8[:,::1], f8[:,:,::1])"
)
def _advance(
    joint_velocity: np.ndarray,
    torque: np.ndarray,
    joint_rows: np.ndarray,
    dry_friction: np.ndarray,
    damping: np.ndarray,
    with_friction: bool,
    momentum: np.ndarray,
    drift: np.ndarray,
    drift_before: np.ndarray,
    started: bool,
    period_s: float,
    momentum_gain: float,
    residual_gain: float,
    slope_gain: float,
    friction: np.ndarray,
    inputs: np.ndarray,
    state: np.ndarray,
) -> bool:
    """One tick of the observer, fed with the robot's terms; whether all residuals are finite.

    Args:
        joint_velocity, dry_friction, damping, friction: see `nominal_friction_torque`.
        torque, joint_rows, drift, drift_before, inputs: see `momentum_inputs`.
        with_friction: take nominal friction out of the residual.
        momentum, started, period_s, momentum_gain, residual_gain, slope_gain, state: see `observe`.
    """
    if with_friction:
        nominal_friction_torque(joint_velocity, dry_friction, damping, friction)
    if not started:
        drift_before[:] = drift
    momentum_inputs(drift_before, drift, torque, friction, joint_rows, inputs)
    return observe(momentum, inputs, started, period_s, momentum_gain, residual_gain, slope_gain, state)


class MomentumResidual:
    """Observes the generalized disturbance of the whole robot, and its inertial and gravity force.

    Several estimators may share one instance: the observer advances once per tick however many of them feed it. A tick that
    is not finite leaves no residual, and the observer starts over at the next one.

    Attributes:
        newest: the newest tick; None before the first.
        residual: (28,) r, generalized order; the next tick overwrites it.
        residuals: (3, 28) r; N = M vdot + h of the nominal model; r with the nominal friction left in. All lag alike; the next
            tick overwrites them.
        finite: whether all of them are finite; not so when the newest tick was not.
    """

    STATE = ("_state", "_drift", "_started", "finite", "newest", "_gains", "_implicit_gains")
    SCRATCH = ("_friction", "_momentum_inputs", "residual", "residuals")

    def __init__(self, gains: ObserverGains, period_s: float, with_friction: bool) -> None:
        """Args:
        gains: of the observer.
        period_s: tick length.
        with_friction: take nominal joint damping and dry friction out of the input, hence out of the residual.
        """
        self._period_s = period_s
        self._with_friction = with_friction
        size = 6 + JOINT_COUNT
        self._friction, self._drift = np.zeros(JOINT_COUNT), np.zeros(size)
        self._momentum_inputs = np.zeros((3, size))
        self._state = np.zeros((3, 3, size))
        self.residuals = self._state[1]
        self.residual = self.residuals[_RESIDUAL]
        self.gains = gains
        self.reset()

    @property
    def gains(self) -> ObserverGains:
        """Of the observer; may be changed at any time: its state carries over."""
        return self._gains

    @gains.setter
    def gains(self, gains: ObserverGains) -> None:
        self._gains, self._implicit_gains = gains, gains.implicit(self._period_s)

    def reset(self) -> None:
        """Forget the past; the next tick starts at rest equilibrium."""
        self._started = False
        self.finite = True
        self.newest: EstimatorInput | None = None

    def observe(self, inputs: EstimatorInput) -> bool:
        """Advance by one tick and say so; a tick already taken in is ignored."""
        if self.newest is not None and inputs.tick == self.newest.tick:
            return False
        model, sensor = inputs.model, inputs.sensor
        self._started = self.finite = _advance(
            sensor.joint_velocity,
            sensor.joint_torque,
            model.joint_rows,
            model.joint_friction,
            model.joint_damping,
            self._with_friction,
            model.momentum,
            model.momentum_drift,
            self._drift,
            self._started,
            self._period_s,
            *self._implicit_gains,
            self._friction,
            self._momentum_inputs,
            self._state,
        )
        self.newest = inputs
        return True

    @property
    def inputs(self) -> EstimatorInput:
        """The newest tick. Raises RuntimeError before the first."""
        if self.newest is None:
            raise RuntimeError("no tick observed since the last reset; call observe before estimate")
        return self.newest
