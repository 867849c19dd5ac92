"""Box dragging (paper Sec. III.D): press on a box with 20 N and drag it sideways by a sinusoidal force of 8 N."""

from dataclasses import dataclass, field, replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.timing import CONTROL_PERIOD_S
from sim.scenes.box import CENTER_X_M, TOP_HEIGHT_M
from sim.trials.trial import Trial, TrialSetup

PRESS_N, DRAG_N, DRAG_HZ = 20.0, 8.0, 0.2
APPROACH_S, PRESS_S, DRAG_PERIODS = 2.5, 2.0, 2
_POINTING_DOWN = np.array([np.cos(0.5), 0.0, np.sin(0.5), 0.0])


@dataclass(frozen=True, slots=True)
class DragTrace:
    """Forces of a drag at every control period, (n, 3) N, environment on hand, in heading.

    Attributes:
        time_s: (n,) since the drag began.
        asked, true: by the command; by the simulator.
        fed: estimated by the estimator that feeds the controller.
        own: estimated by the controller itself; None where it does not.
    """

    time_s: np.ndarray
    asked: np.ndarray
    true: np.ndarray
    fed: np.ndarray
    own: np.ndarray | None


@dataclass(frozen=True, slots=True)
class DragResult:
    """One box drag: RMSE of lateral and vertical force, N; extrema of the box, m; whether contact was kept; its forces."""

    error_y_n: float
    error_z_n: float
    box_low_m: float
    box_high_m: float
    kept: bool
    trace: DragTrace | None = field(default=None, repr=False, compare=False)


def lateral_force(time_s: float) -> float:
    """Force, N, asked for sideways. The first half period has half the amplitude: so the box swings evenly about its place."""
    amplitude = DRAG_N * (0.5 if time_s < 0.5 / DRAG_HZ else 1.0)
    return amplitude * float(np.sin(2.0 * np.pi * DRAG_HZ * time_s))


def drag_box(setup: TrialSetup, seed: int) -> DragResult:
    """Press on the box with 20 N and drag it by a lateral force of 8 N at 0.2 Hz."""
    trial = Trial(setup, seed, scene="box")
    above = replace(
        DEFAULT_COMMAND, position_m=np.array([CENTER_X_M, 0.0, TOP_HEIGHT_M + 0.05]), orientation_wxyz=_POINTING_DOWN
    )
    for _ in trial.run(above, APPROACH_S):
        pass
    touching = replace(above, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 3.0]))
    for _ in trial.run(touching, 1.0):
        pass
    pressing = replace(touching, force_n=np.array([0.0, 0.0, PRESS_N]))
    for _ in trial.run(pressing, PRESS_S):
        pass
    errors, places, contact, forces = [], [], [], []
    for step in range(round(DRAG_PERIODS / DRAG_HZ / CONTROL_PERIOD_S)):
        lateral = lateral_force(CONTROL_PERIOD_S * step)
        command = replace(pressing, mask=np.array([0.0, 1.0, 1.0]), force_n=np.array([0.0, lateral, PRESS_N]))
        for _ in trial.run(command, CONTROL_PERIOD_S):
            pass
        truth = trial.truth
        fed = trial.session.output.hand.force_estimated_n
        forces.append((command.force_n, truth.force_true_n, fed, trial.own_force_n))
        if step * CONTROL_PERIOD_S < 0.5:
            continue
        errors.append(truth.force_true_n[1:] - command.force_n[1:])
        places.append(float(truth.object_positions[0, 1]))
        contact.append(truth.force_true_n[2] > 0.5)
        if trial.fallen:
            break
    error_y, error_z = np.sqrt(np.mean(np.square(errors), axis=0))
    kept = bool(np.mean(contact) > 0.99) and not trial.fallen
    return DragResult(float(error_y), float(error_z), min(places), max(places), kept, _trace(forces))


def _trace(forces: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]]) -> DragTrace:
    asked, true, fed, own = zip(*forces, strict=True)
    estimated = None if own[0] is None else np.array(own)
    return DragTrace(CONTROL_PERIOD_S * np.arange(len(forces)), np.array(asked), np.array(true), np.array(fed), estimated)
