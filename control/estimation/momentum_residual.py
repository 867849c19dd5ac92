"""The residual r of eq. (9) from each tick's sensors: the momentum observer fed with the model's terms.

The same observer, told no torque and no friction, finds N = M vdot + h, the whole inertial and gravity force of the nominal
model, with exactly the lag of r; told all but the friction, it finds the nominal friction. Adaptation needs both.
"""

import math

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.momentum_observer import MomentumObserver, ObserverGains

FRICTION_SMOOTHING_RPS = 0.01
"""Joint speed at which dry friction reaches tanh(1) of its value. It may lie below the noise of the velocity, which smooths
what the observer averages anyway."""

_RESIDUAL, _INERTIAL, _RESIDUAL_WITH_FRICTION = range(3)


class MomentumResidual:
    """Observes the generalized disturbance of the whole robot, and its inertial and gravity force.

    Several estimators may share one instance: the observer advances once per tick however many of them feed it. A tick that
    is not finite leaves no residual, and the observer starts over at the next one.
    """

    def __init__(self, gains: ObserverGains, period_s: float, with_friction: bool) -> None:
        """Args:
        gains: of the observer.
        period_s: tick length.
        with_friction: take nominal joint damping and dry friction out of the input, hence out of the residual.
        """
        self._observer = MomentumObserver(gains, period_s)
        self._with_friction = with_friction
        self.reset()

    @property
    def gains(self) -> ObserverGains:
        """Of the observer; may be changed at any time."""
        return self._observer.gains

    @gains.setter
    def gains(self, gains: ObserverGains) -> None:
        self._observer.gains = gains

    def reset(self) -> None:
        """Forget the past; the next tick starts at rest equilibrium."""
        self._observer.reset()
        self._drift: np.ndarray | None = None
        self._inputs: EstimatorInput | None = None

    def observe(self, inputs: EstimatorInput) -> bool:
        """Advance by one tick and say so; a tick already taken in is ignored."""
        if self._inputs is not None and inputs.tick == self._inputs.tick:
            return False
        model = inputs.model
        torque = inputs.sensor.joint_torque
        if self._with_friction:
            torque = torque - nominal_friction_torque(inputs)
        # The torque acted over the tick that ends now; the model's terms are those at its start.
        drift = model.momentum_drift if self._drift is None else self._drift
        momentum_inputs = np.array((drift, drift, drift))
        momentum_inputs[_RESIDUAL, model.joint_rows] += torque
        momentum_inputs[_RESIDUAL_WITH_FRICTION, model.joint_rows] += inputs.sensor.joint_torque
        self._drift = model.momentum_drift.copy()
        self._estimates = self._observer.step(model.momentum, momentum_inputs)
        if not math.isfinite(self._estimates.sum()):
            self._observer.reset()
            self._drift = None
        self._inputs = inputs
        return True

    @property
    def inputs(self) -> EstimatorInput:
        """The newest tick. Raises RuntimeError before the first."""
        if self._inputs is None:
            raise RuntimeError("no tick observed since the last reset; call observe before estimate")
        return self._inputs

    @property
    def residual(self) -> np.ndarray:
        """(28,) r, generalized order; not finite when the newest tick was not. After the first tick only."""
        return self._estimates[_RESIDUAL]

    @property
    def inertial_force(self) -> np.ndarray:
        """(28,) N = M vdot + h of the nominal model, lagging like r. After the first tick only."""
        return self._estimates[_INERTIAL]

    @property
    def friction_force(self) -> np.ndarray:
        """(28,) nominal joint friction that was taken out of r, lagging like r; zero without. After the first tick only."""
        return self._estimates[_RESIDUAL] - self._estimates[_RESIDUAL_WITH_FRICTION]


def nominal_friction_torque(inputs: EstimatorInput) -> np.ndarray:
    """Torque (22,) N m that nominal joint damping and dry friction take away at this tick."""
    velocity = inputs.sensor.joint_velocity
    friction = np.tanh(velocity / FRICTION_SMOOTHING_RPS)
    friction *= inputs.model.joint_friction
    friction += inputs.model.joint_damping * velocity
    return friction
