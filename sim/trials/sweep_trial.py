"""What a sweep tries unless told otherwise: random commands against springs, on the full stack with one setup."""

from pathlib import Path

import numpy as np

from control.paths import WEIGHTS_DIRECTORY
from sim.trials.random_commands import random_commands, rms, settled_position_cm
from sim.trials.trial import SHIPPED_ESTIMATOR, TrialSetup, controller_setups


def sweep_trial(
    controller: str = "policy",
    estimator: str = SHIPPED_ESTIMATOR,
    gains: str = "",
    mass_scale: float = 1.0,
    push_n: float = 0.0,
    seed: int = 1000,
    minutes: float = 0.5,
    weights: str = str(WEIGHTS_DIRECTORY),
) -> dict[str, float]:
    """Errors over a time of random commands, from the simulator's truth.

    Args:
        controller: `model_based`, or a policy of `weights`.
        estimator: that feeds the controller.
        gains: of its momentum observer as "K1:K2", empty for the shipped ones.
        mass_scale: of the simulated robot; the pipeline is not told.
        push_n: pushes at the hand of up to this size.
        seed: of everything random.
        minutes: of the robot's time.
        weights: folder with the policies.

    Raises:
        ValueError: a name or gains that do not exist.
    """
    setups = controller_setups(Path(weights))
    if controller not in setups:
        raise ValueError(f"unknown controller {controller!r}; available: {', '.join(setups)}")
    k1, _, k2 = gains.partition(":")
    setup = TrialSetup(
        controller=controller,
        make=setups[controller].make,
        estimator=estimator,
        gains=(float(k1), float(k2)) if gains else None,
        mass_scale=mass_scale,
        push_n=push_n,
    )
    errors = random_commands(setup, seed, minutes)
    force = [part for parts in errors.force.values() for part in parts]
    return {
        "rmse_force_n": rms(np.array(force)),
        "rmse_estimate_n": rms(np.array(errors.estimate)),
        "settled_position_cm": settled_position_cm(errors),
        "rmse_velocity_mps": rms(np.array(errors.forward)),
        "rmse_yaw_rps": rms(np.array(errors.yaw)),
        "falls": errors.falls,
        "robot_minutes": errors.robot_minutes,
    }
