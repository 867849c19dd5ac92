"""Runs one planned rollout through the real pipeline and records it at 50 Hz.

The controller is fed by the `adaptive` estimate, as on the robot; truth goes to the record only.
"""

from dataclasses import asdict, dataclass

import numpy as np

from control.command import DEFAULT_COMMAND
from control.force_estimator import EstimatorInput
from control.force_estimators import EstimatorsConfig
from control.force_signals import signals_at
from control.joints import LEGS
from control.learning.rollout_data import MEASURED, NOMINAL, NOMINAL_ESTIMATORS, PERIOD_S
from control.pipeline import TICK_S, Pipeline, PipelineConfig, PipelineOutput
from control.projecting_estimator import ProjectingEstimator
from sim.backends.mujoco_backend import MujocoBackend
from sim.backends.protocol import BackendError
from sim.rollout_plans import RolloutPlan
from sim.rollout_profiles import MotionConfig, RandomMotion, SampledForce, random_spring, rms_force, rms_slope, sampled_force

ATTEMPTS = 8
MINIMUM_HEIGHT_M = 0.2
LIMIT_MARGIN_RAD = 0.01
LIMIT_SHARE = 0.01
SPRING_MOTION = MotionConfig(base_velocity_limit=(0.15, 0.05, 0.15), force_mode_share=0.4)
SPRING_INTERVAL_S = (1.5, 3.5)


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


class RejectedError(RuntimeError):
    """The rollout is no fair sample; the message is the reason."""


def record_rollout(plan: RolloutPlan) -> Recording:
    """Run `plan`, again with the next seed after a rejection, at most ATTEMPTS times."""
    rejected: list[str] = []
    for attempt in range(ATTEMPTS):
        seed = plan.seed + attempt
        try:
            arrays = _Rollout(plan, seed).run()
        except RejectedError as reason:
            rejected.append(str(reason))
            continue
        force = arrays["force_true"]
        return Recording(plan, seed, tuple(rejected), arrays, rms_force(force), rms_slope(force, PERIOD_S))
    return Recording(plan, plan.seed, tuple(rejected), {}, float("nan"), float("nan"))


class _Rollout:
    """One attempt."""

    def __init__(self, plan: RolloutPlan, seed: int) -> None:
        self._plan = plan
        force_seed, motion_seed, other_seed = np.random.SeedSequence(seed).spawn(3)
        self._random = np.random.default_rng(other_seed)
        self._backend = MujocoBackend("free", plan.sensors, seed)
        self._backend.open()
        self._backend.set_mismatch(plan.mismatch)
        self._pipeline = Pipeline(PipelineConfig(estimators=EstimatorsConfig(weights=None)))
        self._nominal = {name: self._pipeline.estimators[name] for name in NOMINAL_ESTIMATORS}
        motion = SPRING_MOTION if plan.profile == "spring" else MotionConfig()
        self._motion = None if plan.still else RandomMotion(motion, np.random.default_rng(motion_seed))
        self._next_spring_s = 0.5
        if plan.profile != "spring":
            force = sampled_force(plan.profile, np.random.default_rng(force_seed), plan.duration_s, TICK_S)
            self._backend.wrenches.add(SampledForce(plan.force_scale * force, TICK_S))
        self._wheels = [self._backend.model.geom(f"{leg}_wheel").id for leg in LEGS]
        self._rows: dict[str, list[np.ndarray]] = {}

    def run(self) -> dict[str, np.ndarray]:
        """Arrays of the rollout. Raises RejectedError."""
        period = round(PERIOD_S / TICK_S)
        steps = round(self._plan.duration_s / PERIOD_S)
        # The network may run at any phase of the 50 Hz controller.
        phase = int(self._random.integers(period))
        at_limit = 0
        for tick in range(steps * period):
            time_s = tick * TICK_S
            if self._plan.profile == "spring" and time_s >= self._next_spring_s:
                self._add_spring(time_s)
            frame = self._backend.read()
            command = DEFAULT_COMMAND if self._motion is None else self._motion.step(time_s)
            output = self._pipeline.step(frame, command, 0.0)
            if tick % period == phase:
                self._record(EstimatorInput(self._pipeline.model, frame, output.base, output.applied_command.mask))
                self._check(output)
                at_limit += self._at_joint_limit(frame.joint_position)
            try:
                self._backend.write(output.joint_command)
            except BackendError as error:
                raise RejectedError("diverged") from error
        if at_limit > LIMIT_SHARE * steps:
            raise RejectedError("joint limit")
        return {name: np.array(rows, np.float32) for name, rows in self._rows.items()}

    def _record(self, inputs: EstimatorInput) -> None:
        row: dict[str, np.ndarray] = {}
        for name, estimator in self._nominal.items():
            assert isinstance(estimator, ProjectingEstimator)
            signals = signals_at(inputs, estimator, estimator.estimate())
            row |= {f"{name}.{quantity}": getattr(signals, f"nominal_{quantity}") for quantity in NOMINAL}
            row |= {quantity: getattr(signals, quantity) for quantity in MEASURED}
        truth = self._backend.truth()
        row["force_true"] = truth.end_effector_force
        row["wheel_forces_true"] = truth.wheel_forces.reshape(-1)
        row["linear_velocity_true"] = truth.rotation_heading_to_world.T @ truth.base_linear_velocity
        for name, value in row.items():
            self._rows.setdefault(name, []).append(value.astype(np.float32))

    def _check(self, output: PipelineOutput) -> None:
        data = self._backend.data
        if output.safety.damping or data.qpos[2] < MINIMUM_HEIGHT_M:
            raise RejectedError("fall")
        pairs = data.contact.geom
        on_ground = np.isin(pairs, self._wheels).sum(axis=1) == 1
        with_floor = self._backend.model.geom_bodyid[pairs].min(axis=1) == 0 if len(pairs) else on_ground
        if not (on_ground & with_floor).all():
            raise RejectedError("contact")

    def _at_joint_limit(self, position: np.ndarray) -> bool:
        model = self._pipeline.model
        low, high = model.position_lower + LIMIT_MARGIN_RAD, model.position_upper - LIMIT_MARGIN_RAD
        return bool(((position < low) | (position > high)).any())

    def _add_spring(self, time_s: float) -> None:
        duration = float(self._random.uniform(*SPRING_INTERVAL_S))
        self._next_spring_s = time_s + duration + float(self._random.uniform(0.0, 1.5))
        self._backend.wrenches.add(random_spring(self._random, self._backend.truth().end_effector_position, duration))


def manifest_entry(recording: Recording, file: str) -> dict[str, object]:
    """What the manifest says of a kept rollout."""
    return {
        **asdict(recording.plan),
        "file": file,
        "seed": recording.seed,
        "rejected": list(recording.rejected),
        "rms_force_n": round(recording.rms_force_n, 3),
        "rms_slope_nps": round(recording.rms_slope_nps, 3),
    }
