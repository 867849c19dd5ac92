"""Rollouts of the estimator benchmark: every force estimator on the same drive, judged by the simulator's truth.

The robot drives and moves its arm on random commands under the model-based controller; a known force acts on its end
effector. Sensors are noisy, the base velocity is estimated, joint and ground friction are drawn.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from control.estimation.momentum_observer import ObserverGains
from control.estimation.registry import EstimatorsConfig
from control.timing import SLOT_COUNT, TICK_S
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.benchmarks.estimator_ablations import Ablation
from sim.benchmarks.estimator_panel import EstimatorPanel
from sim.benchmarks.estimator_scores import Scores, lag_only_error
from sim.trials.rollout_plans import EVALUATION_FORCE_SCALES, PER_LINK_RANGE, RolloutPlan
from sim.trials.rollout_profiles import rms_force, rms_slope
from sim.trials.rollout_runner import ATTEMPTS, RolloutRunner, first_accepted, planned_force

SETTLE_S = 1.0
"""Not scored: observers start at rest."""


@dataclass(frozen=True, slots=True)
class RolloutTrial:
    """One plan, played.

    Attributes:
        plan: as asked.
        rejected: reasons of the attempts that were drawn again.
        scores: by estimator; empty where every attempt was rejected.
        force_true_n: (n, 3) N in heading at 50 Hz from SETTLE_S on.
        rms_force_n, rms_slope_nps: of the planned force.
        lag_only_n: vector RMSE of lag alone, by model-based estimator.
    """

    plan: RolloutPlan
    rejected: tuple[str, ...]
    scores: dict[str, Scores]
    force_true_n: np.ndarray
    rms_force_n: float
    rms_slope_nps: float
    lag_only_n: dict[str, float]


def draw_plan(seed: int, number: int, profile: str, mass_scale: float, links: Sequence[str], duration_s: float) -> RolloutPlan:
    """Rollout `number` of a test set; the same number draws the same force, motion and frictions at every mass scale.

    Args:
        seed: of the test set.
        number: 0 and up.
        profile: of EVALUATION_FORCE_SCALES.
        mass_scale: of every link.
        links: bodies whose mass is scaled at random besides; none for a uniform mismatch.
        duration_s: of the rollout.
    """
    own_seed = seed * 100_000 + number * ATTEMPTS
    random = np.random.default_rng(own_seed)
    joint_friction, ground_friction = random.uniform(0.5, 1.5), random.uniform(0.75, 1.25)
    return RolloutPlan(
        index=number,
        split="test",
        seed=own_seed,
        profile=profile,
        mass_scale=mass_scale,
        per_link=dict(zip(links, random.uniform(*PER_LINK_RANGE, len(links)).tolist(), strict=True)),
        joint_friction_scale=joint_friction,
        ground_friction_scale=ground_friction,
        force_scale=EVALUATION_FORCE_SCALES[profile],
        duration_s=duration_s,
    )


def run_trial(plan: RolloutPlan, ablations: Sequence[Ablation] = ()) -> RolloutTrial:
    """Play `plan`; a rejected attempt is drawn again, see sim.trials.rollout_runner."""

    def attempt(plan: RolloutPlan, seed: int) -> EstimatorPanel:
        return watch(RolloutRunner(plan, seed), plan, ablations)

    panel, seed, rejected = first_accepted(plan, attempt)
    force = planned_force(plan, seed)
    start = round(SETTLE_S / TICK_S)
    lags = {name: lag_only_error(force, gains, TICK_S)[start:] for name, gains in _gains().items()}
    return RolloutTrial(
        plan,
        rejected,
        {} if panel is None else panel.scores(),
        np.zeros((0, 3)) if panel is None else np.array(panel.force_true_n),
        rms_force(force),
        rms_slope(force, TICK_S),
        {name: rms_force(error) for name, error in lags.items()},
    )


def watch(
    runner: RolloutRunner,
    plan: RolloutPlan,
    ablations: Sequence[Ablation] = (),
    is_scored: Callable[[MujocoBackend], bool] = lambda backend: True,
) -> EstimatorPanel:
    """Run to the end with every estimator watching; scored from SETTLE_S on, where `is_scored`.

    Raises:
        RejectedError: see sim.trials.rollout_runner.
    """
    panel = EstimatorPanel(runner.pipeline.model, plan.delay_ticks, ablations)
    for tick in runner.ticks():
        truth = runner.backend.truth()
        panel.observe(tick.sensor, tick.output.base, tick.output.applied_command.mask, truth)
        if tick.index % SLOT_COUNT == 0:
            panel.sample(truth, tick.time_s >= SETTLE_S and is_scored(runner.backend))
    return panel


def _gains() -> dict[str, ObserverGains]:
    config = EstimatorsConfig()
    paper, fast = config.gmo_gains, config.adaptive.gains
    return {"gmo_pi": paper, "gmo_cqp": paper, "hybrid_paper": paper, "adaptive": fast, "hybrid": fast}
