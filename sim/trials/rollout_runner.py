"""Runs one planned rollout tick by tick: the robot, its pipeline, the force on its hand, the motion, and when it is rejected.

The controller is fed by the `adaptive` estimate whatever runs besides, so a rollout depends on no trained network.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import EstimatorsConfig
from control.joints import LEGS
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.timing import SLOT_COUNT, TICK_S
from control.types import Command, SensorFrame
from sim.backends.protocol import BackendError
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.scenes import SceneModel
from sim.trials.rollout_plans import RolloutPlan
from sim.trials.rollout_profiles import MotionConfig, RandomMotion, SampledForce, random_spring, sampled_force

ATTEMPTS = 8
DRIVER = "model_based"
"""Controller that drives every rollout, on the estimate of `adaptive`: data and tests do not depend on what is trained."""
MINIMUM_HEIGHT_M = 0.2
LIMIT_MARGIN_RAD = 0.01
LIMIT_SHARE = 0.01
SPRING_MOTION = MotionConfig(base_velocity_limit=(0.15, 0.05, 0.15), force_mode_share=0.4)
SPRING_INTERVAL_S = (1.5, 3.5)

Result = TypeVar("Result")


class RejectedError(RuntimeError):
    """The rollout is no fair sample; the message is the reason: "fall", "contact", "joint limit" or "diverged"."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick, before the world moves on: number, what was sensed, what the pipeline made of it."""

    index: int
    sensor: SensorFrame
    output: PipelineOutput

    @property
    def time_s(self) -> float:
        """Since the start."""
        return self.index * TICK_S


def rollout_pipeline() -> Pipeline:
    """The pipeline that drives every rollout."""
    return Pipeline(PipelineConfig(controller=DRIVER, estimator="adaptive", estimators=EstimatorsConfig(weights=None)))


def drive(
    backend: MujocoBackend, pipeline: Pipeline, command_at: Callable[[float], Command], duration_s: float
) -> Iterator[Tick]:
    """Step an opened backend on commands over time (s).

    Raises:
        RejectedError: the robot fell or the simulation diverged.
        FailureError: a controller or an estimator failed.
    """
    for index in range(round(duration_s / TICK_S)):
        sensor = backend.read()
        output = pipeline.step(sensor, command_at(index * TICK_S), 0.0)
        output.raise_failures()
        if output.safety.damping or backend.data.qpos[2] < MINIMUM_HEIGHT_M:
            raise RejectedError("fall")
        yield Tick(index, sensor, output)
        try:
            backend.write(output.joint_command)
        except BackendError as error:
            raise RejectedError("diverged") from error


def first_accepted(plan: RolloutPlan, run: Callable[[RolloutPlan, int], Result]) -> tuple[Result | None, int, tuple[str, ...]]:
    """`run(plan, seed)` with the plan's seed, and with the next one after a rejection, at most ATTEMPTS times.

    Returns:
        The result and its seed, None and the plan's where every attempt was rejected; the reasons of the rejected ones.
    """
    rejected: list[str] = []
    while len(rejected) < ATTEMPTS:
        seed = plan.seed + len(rejected)
        try:
            return run(plan, seed), seed, tuple(rejected)
        except RejectedError as reason:
            rejected.append(str(reason))
    return None, plan.seed, tuple(rejected)


def planned_force(plan: RolloutPlan, seed: int) -> np.ndarray:
    """Force (steps, 3) N in heading at 500 Hz that acts on the hand; zero for a spring, whose force follows the motion."""
    if plan.profile == "spring":
        return np.zeros((round(plan.duration_s / TICK_S), 3))
    force_seed = np.random.SeedSequence(seed).spawn(3)[0]
    return plan.force_scale * sampled_force(plan.profile, np.random.default_rng(force_seed), plan.duration_s, TICK_S)


class RolloutRunner:
    """One attempt at a plan.

    Attributes:
        backend, pipeline: of this attempt.
        random: for what else is drawn, apart from force, motion and sensor errors.
    """

    def __init__(
        self,
        plan: RolloutPlan,
        seed: int,
        scene: str | SceneModel = "free",
        command_at: Callable[[float], Command] | None = None,
    ) -> None:
        """Opens the backend; `scene` and `command_at` replace the flat floor and the plan's random motion."""
        self._plan = plan
        _, motion_seed, other_seed = np.random.SeedSequence(seed).spawn(3)
        self.random = np.random.default_rng(other_seed)
        self.backend = MujocoBackend(scene, plan.sensors, seed)
        self.backend.open()
        self.backend.set_mismatch(plan.mismatch)
        self.pipeline = rollout_pipeline()
        if command_at is None and not plan.still:
            motion = SPRING_MOTION if plan.profile == "spring" else MotionConfig()
            command_at = RandomMotion(motion, np.random.default_rng(motion_seed)).step
        self._command_at = command_at
        self._next_spring_s = 0.5
        if plan.profile != "spring":
            self.backend.wrenches.add(SampledForce(planned_force(plan, seed), TICK_S, point_m=np.array(plan.contact_offset_m)))
        self._wheels = [self.backend.model.geom(f"{leg}_wheel").id for leg in LEGS]

    def ticks(self) -> Iterator[Tick]:
        """Every tick of the rollout.

        Raises:
            RejectedError: the robot fell, touched something with another part than its wheels, leaned on a joint's stop for
                more than LIMIT_SHARE of the time, or the simulation diverged.
        """
        at_limit = checks = 0
        for tick in drive(self.backend, self.pipeline, self._act, self._plan.duration_s):
            if tick.index % SLOT_COUNT == 0:
                self._check_contacts()
                at_limit += self._at_joint_limit(tick.sensor.joint_position)
                checks += 1
            yield tick
        if at_limit > LIMIT_SHARE * checks:
            raise RejectedError("joint limit")

    def _act(self, time_s: float) -> Command:
        if self._plan.profile == "spring" and time_s >= self._next_spring_s:
            duration = float(self.random.uniform(*SPRING_INTERVAL_S))
            self._next_spring_s = time_s + duration + float(self.random.uniform(0.0, 1.5))
            hand = self.backend.truth().end_effector_position
            self.backend.wrenches.add(random_spring(self.random, hand, duration, np.array(self._plan.contact_offset_m)))
        return DEFAULT_COMMAND if self._command_at is None else self._command_at(time_s)

    def _check_contacts(self) -> None:
        pairs = self.backend.data.contact.geom
        if not len(pairs):
            return
        with_wheel = np.isin(pairs, self._wheels).sum(axis=1) == 1
        with_ground = self.backend.model.geom_bodyid[pairs].min(axis=1) == 0
        if not (with_wheel & with_ground).all():
            raise RejectedError("contact")

    def _at_joint_limit(self, position: np.ndarray) -> bool:
        model = self.pipeline.model
        low, high = model.position_lower + LIMIT_MARGIN_RAD, model.position_upper - LIMIT_MARGIN_RAD
        return bool(((position < low) | (position > high)).any())
