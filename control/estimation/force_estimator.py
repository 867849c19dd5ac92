"""What every force estimator is: fed at 500 Hz, asked for an estimate whenever one is wanted."""

import math
from dataclasses import field
from typing import Protocol

import numpy as np

from control.robot_model import RobotModel
from control.types import BaseState, ForceEstimate, SensorFrame
from control.values import value


@value
class EstimatorInput:
    """One 500 Hz tick, the same for every estimator.

    Attributes:
        tick: number of the tick, one more than the last one's; an estimator takes in each number once.
        model: updated at this tick's configuration and velocity.
        sensor: this tick's frame.
        base: this tick's base state.
        mask: (3,) applied 0 position, 1 force, per heading axis.
    """

    tick: int
    model: RobotModel
    sensor: SensorFrame
    base: BaseState
    mask: np.ndarray = field(default_factory=lambda: np.zeros(3))


class UnsoundEstimateError(ValueError):
    """What an estimator returned is no estimate of a force; the message says what it is."""


class ForceEstimator(Protocol):
    """Estimates the force of the environment on the end effector from proprioception."""

    def reset(self) -> None:
        """Forget the past; the next tick starts at rest equilibrium."""

    def observe(self, inputs: EstimatorInput) -> None:
        """Take in one tick; must be called at every tick, in order."""

    def estimate(self) -> ForceEstimate:
        """Estimate at the newest tick.

        Raises:
            RuntimeError: nothing has been observed since the last reset.
        """
        ...

    def set_gains(self, k1: float, k2: float) -> None:
        """Change the observer gains K1 (1/s) and K2 (1/s^2).

        Raises:
            ValueError: a gain is not positive and finite.
        """


def require_sound(estimate: ForceEstimate) -> ForceEstimate:
    """`estimate`, if its force is three finite numbers.

    Raises:
        UnsoundEstimateError: it is not.
    """
    force = estimate.force_estimated_n
    if force.shape != (3,) or not math.isfinite(sum(force.tolist())):
        raise UnsoundEstimateError(f"force_estimated_n must be three finite numbers, not {force}")
    return estimate
