"""Records one planned rollout at 50 Hz, see sim.trials.rollout_runner; truth goes to the record only."""

from dataclasses import dataclass

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.networks.force_signals import signals_at
from control.estimation.projecting_estimator import ProjectingEstimator
from control.learning.rollout_data import MEASURED, NOMINAL, NOMINAL_ESTIMATORS
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT
from sim.trials.rollout_plans import RolloutPlan
from sim.trials.rollout_profiles import rms_force, rms_slope
from sim.trials.rollout_runner import RolloutRunner, Tick, first_accepted


@dataclass(frozen=True, slots=True)
class Recording:
    """Outcome of a plan.

    Attributes:
        plan: as asked.
        seed: of the attempt that was kept.
        rejected: reason of each attempt that was not: "fall", "contact", "joint limit" or "diverged".
        arrays: see control.learning.rollout_data; empty when every attempt was rejected.
        rms_force_n, rms_slope_nps: of the true force.
    """

    plan: RolloutPlan
    seed: int
    rejected: tuple[str, ...]
    arrays: dict[str, np.ndarray]
    rms_force_n: float
    rms_slope_nps: float


def record_rollout(plan: RolloutPlan) -> Recording:
    """Run `plan`, again with the next seed after a rejection, at most ATTEMPTS times."""
    arrays, seed, rejected = first_accepted(plan, _record)
    if arrays is None:
        return Recording(plan, plan.seed, rejected, {}, float("nan"), float("nan"))
    force = arrays["force_true_n"]
    return Recording(plan, seed, rejected, arrays, rms_force(force), rms_slope(force, CONTROL_PERIOD_S))


def _record(plan: RolloutPlan, seed: int) -> dict[str, np.ndarray]:
    """Arrays of one attempt. Raises RejectedError."""
    runner = RolloutRunner(plan, seed)
    # The network may run at any phase of the 50 Hz controller.
    phase = int(runner.random.integers(SLOT_COUNT))
    rows: dict[str, list[np.ndarray]] = {}
    for tick in runner.ticks():
        if tick.index % SLOT_COUNT == phase:
            for name, value in _row(runner, tick).items():
                rows.setdefault(name, []).append(value.astype(np.float32))
    return {name: np.array(values, np.float32) for name, values in rows.items()}


def _row(runner: RolloutRunner, tick: Tick) -> dict[str, np.ndarray]:
    """What is recorded of one tick."""
    output = tick.output
    inputs = EstimatorInput(tick.index, runner.pipeline.model, tick.sensor, output.base, output.applied_command.mask)
    row: dict[str, np.ndarray] = {}
    for name in NOMINAL_ESTIMATORS:
        estimator = runner.pipeline.estimators[name]
        assert isinstance(estimator, ProjectingEstimator)
        signals = signals_at(inputs, estimator, estimator.estimate())[0]
        row |= {f"{name}.{quantity}": signals[f"nominal_{quantity}"] for quantity in NOMINAL}
        row |= {quantity: signals[quantity] for quantity in MEASURED}
    truth = runner.backend.truth()
    row["force_true_n"] = truth.force_true_n
    row["wheel_forces_true"] = truth.wheel_forces.reshape(-1)
    row["linear_velocity_true"] = truth.rotation_heading_to_world.T @ truth.base_linear_velocity
    return row


def manifest_entry(recording: Recording, file: str) -> dict[str, object]:
    """What the manifest says of a kept rollout."""
    return {
        **recording.plan.as_dict(),
        "file": file,
        "seed": recording.seed,
        "rejected": list(recording.rejected),
        "rms_force_n": round(recording.rms_force_n, 3),
        "rms_slope_nps": round(recording.rms_slope_nps, 3),
    }
