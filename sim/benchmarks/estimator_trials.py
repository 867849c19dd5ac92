"""Rollouts of the estimator benchmark: every force estimator on the same drive, judged by the simulator's truth.

The robot drives and moves its arm on random commands under the model-based controller, which is fed by `adaptive`; a known
force acts on its end effector. Sensors are noisy, the base velocity is estimated, joint and ground friction are drawn.
"""

from dataclasses import dataclass

import numpy as np

from control.force_estimators import EstimatorsConfig
from control.network_weights import WEIGHTS_DIRECTORY
from control.pipeline import CONTROL_DECIMATION, TICK_S, Pipeline, PipelineConfig
from control.types import ForceEstimate
from sim.backends.mujoco_backend import MujocoBackend
from sim.backends.protocol import BackendError
from sim.rollout_plans import RolloutPlan
from sim.rollout_profiles import MotionConfig, RandomMotion, SampledForce, rms_force, rms_slope, sampled_force
from sim.rollout_runner import LIMIT_MARGIN_RAD, LIMIT_SHARE, MINIMUM_HEIGHT_M, RejectedError

PROFILES = ("hold", "sine", "slow")

HOLD_SLOPE_NPS = 15.0
"""A hold force that changes faster, in the root mean square, is scaled down to this."""

SETTLE_S = 1.0
"""Not scored: observers start at rest."""

MOTION = MotionConfig(force_mode_share=0.0)


@dataclass(frozen=True, slots=True)
class Scores:
    """One estimator over one rollout, sampled at 50 Hz.

    Attributes:
        error: (n, 3) N, estimate minus truth, in heading.
        sigma: (n, 3) N, NaN where the estimator gives none.
    """

    error: np.ndarray
    sigma: np.ndarray

    @property
    def rmse_axes_n(self) -> np.ndarray:
        """(3,)."""
        return np.sqrt((self.error**2).mean(axis=0))

    @property
    def rmse_vector_n(self) -> float:
        """Root mean square length of the error."""
        return float(np.sqrt((self.error**2).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True)
class Trial:
    """One kept rollout.

    Attributes:
        scores: by estimator.
        rms_force_n, rms_slope_nps: of the true force.
        force_true: (n, 3) N at 50 Hz, in heading.
        force_estimated: (n, 3) N at 50 Hz by estimator, as far as they line up with `force_true`.
    """

    scores: dict[str, Scores]
    rms_force_n: float
    rms_slope_nps: float
    force_true: np.ndarray
    force_estimated: dict[str, np.ndarray]


def run_trial(plan: RolloutPlan) -> Trial:
    """Run one rollout.

    Raises:
        RejectedError: the robot fell, leaned on a joint's stop for more than 1 % of the time, or the simulation diverged.
    """
    force_seed, motion_seed = np.random.SeedSequence(plan.seed).spawn(2)
    force = sampled_force(plan.profile, np.random.default_rng(force_seed), plan.duration_s, TICK_S)
    if plan.profile == "hold":
        force *= min(1.0, HOLD_SLOPE_NPS / rms_slope(force, TICK_S))
    backend = MujocoBackend("free", plan.sensors, plan.seed)
    backend.open()
    backend.set_mismatch(plan.mismatch)
    backend.wrenches.add(SampledForce(force, TICK_S))
    pipeline = Pipeline(PipelineConfig(estimators=EstimatorsConfig(weights=WEIGHTS_DIRECTORY)))
    motion = RandomMotion(MOTION, np.random.default_rng(motion_seed))
    lower = pipeline.model.position_lower + LIMIT_MARGIN_RAD
    upper = pipeline.model.position_upper - LIMIT_MARGIN_RAD

    newest: dict[str, ForceEstimate] = {}
    samples: dict[str, list[np.ndarray]] = {name: [] for name in pipeline.estimator_names}
    at_stop = 0
    for tick in range(len(force)):
        frame, truth = backend.read(), backend.truth()
        output = pipeline.step(frame, motion.step(tick * TICK_S), 0.0)
        try:
            backend.write(output.joint_command)
        except BackendError as error:
            raise RejectedError("diverged") from error
        if output.safety.damping or truth.base_position[2] < MINIMUM_HEIGHT_M:
            raise RejectedError("fall")
        at_stop += bool(((frame.joint_position < lower) | (frame.joint_position > upper)).any())
        for name, estimate in output.estimates.items():
            # Each is scored at the ticks of its own 50 Hz turn; the selected one has a new estimate at every tick.
            is_turn = tick % CONTROL_DECIMATION == 0 if name == pipeline.estimator_name else estimate is not newest.get(name)
            newest[name] = estimate
            if is_turn and tick * TICK_S >= SETTLE_S:
                sigma = np.full(3, np.nan) if estimate.sigma_n is None else estimate.sigma_n
                samples[name].append(np.stack([estimate.force_in_heading, truth.end_effector_force, sigma]))
    if at_stop > LIMIT_SHARE * len(force):
        raise RejectedError("joint limit")
    arrays = {name: np.array(values) for name, values in samples.items()}
    return Trial(
        {name: Scores(values[:, 0] - values[:, 1], values[:, 2]) for name, values in arrays.items()},
        rms_force(force),
        rms_slope(force, TICK_S),
        arrays[pipeline.estimator_name][:, 1],
        {name: values[:, 0] for name, values in arrays.items()},
    )
