"""What the estimators were not made for: a step of force, lifted wheels, a slope, wrong torque constants, late torques."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.joints import LEGS
from control.timing import CONTROL_PERIOD_S, TICK_S
from control.types import Command
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.benchmarks.estimator_panel import EstimatorPanel
from sim.benchmarks.estimator_scores import Scores
from sim.benchmarks.estimator_trials import draw_plan, watch
from sim.scenes import SceneModel, assemble
from sim.trials.rollout_plans import RolloutPlan
from sim.trials.rollout_profiles import SampledForce
from sim.trials.rollout_runner import RolloutRunner, first_accepted

TORQUE_SCALE_STD = 0.05
TORQUE_DELAY_TICKS = 5
SLOPE_RAD = np.deg2rad(10.0)
SLOPE_START_M = 0.8
BUMP_HEIGHT_M, BUMP_RADIUS_M = 0.10, 0.2
WHEELBASE_M = 0.34
LIFTED_M = 0.003
STEP_N = 20.0
STEP_S = 2.0
STEP_DIRECTIONS = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
RECOVERED_N = 0.1 * STEP_N
DURATION_S = 12.0
STEP_DURATION_S = STEP_S + 2.5


def slope(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds an uphill road that starts ahead of the robot."""
    half_length, half_thickness = 4.0, 0.05
    along, up = np.array([np.cos(SLOPE_RAD), 0.0, np.sin(SLOPE_RAD)]), np.array([-np.sin(SLOPE_RAD), 0.0, np.cos(SLOPE_RAD)])
    spec.worldbody.add_geom(
        name="slope",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half_length, 2.0, half_thickness],
        pos=np.array([SLOPE_START_M, 0.0, 0.0]) + half_length * along - half_thickness * up,
        quat=[np.cos(0.5 * SLOPE_RAD), 0.0, -np.sin(0.5 * SLOPE_RAD), 0.0],
    )
    return ()


def bumps(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds bumps to the left and, a wheelbase before, to the right: two wheels climb crosswise, the others lose the ground."""
    for number in range(4):
        for side, x in (("left", 0.8 + number), ("right", 0.8 + number - WHEELBASE_M)):
            spec.worldbody.add_geom(
                name=f"bump_{side}_{number}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[BUMP_RADIUS_M, 0.5, 0.0],
                pos=[x, 0.52 if side == "left" else -0.52, BUMP_HEIGHT_M - BUMP_RADIUS_M],
                quat=[np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0],
            )
    return ()


def on_slope(backend: MujocoBackend) -> bool:
    """Whether all wheels are on the slope."""
    return bool(backend.truth().wheel_contact_positions[:, 0].min() > SLOPE_START_M)


def is_wheel_lifted(backend: MujocoBackend) -> bool:
    """Whether a wheel hangs clear of everything; single ticks without contact force, between rigid bodies, do not count."""
    model, data = backend.model, backend.data
    ground = np.flatnonzero(model.geom_bodyid == 0)
    return any(
        min(mujoco.mj_geomDistance(model, data, model.geom(f"{leg}_wheel").id, geom, 1.0, None) for geom in ground) > LIFTED_M
        for leg in LEGS
    )


def is_pushed(backend: MujocoBackend) -> bool:
    """Whether a force acts on the hand."""
    return bool(backend.truth().force_true_n.any())


def forward(_: float) -> Command:
    """Drive straight on."""
    return replace(DEFAULT_COMMAND, base_velocity=np.array([0.25, 0.0, 0.0]))


@dataclass(frozen=True, slots=True)
class Case:
    """One disturbance of a rollout on the `hold` force.

    Attributes:
        name: for the table.
        change: of a rollout plan.
        add_objects: to the flat floor, None for nothing.
        command_at: over time, None for the random motion of the rollouts.
        is_scored: where the disturbance is there.
        is_step: a force of STEP_N acts from STEP_S on.
    """

    name: str
    change: Callable[[RolloutPlan], RolloutPlan] = lambda plan: plan
    add_objects: Callable[[mujoco.MjSpec], tuple[str, ...]] | None = None
    command_at: Callable[[float], Command] | None = None
    is_scored: Callable[[MujocoBackend], bool] = lambda backend: True
    is_step: bool = False

    def scene(self) -> str | SceneModel:
        """A fresh world."""
        return "free" if self.add_objects is None else assemble(self.name, self.name, self.add_objects)


CASES = (
    Case("nominal"),
    Case("torque constants off by 5 %", change=lambda plan: replace(plan, torque_scale_std=TORQUE_SCALE_STD)),
    Case("torques 10 ms late", change=lambda plan: replace(plan, torque_delay_ticks=TORQUE_DELAY_TICKS)),
    Case(
        "on a 10 degree slope",
        add_objects=slope,
        command_at=forward,
        is_scored=on_slope,
    ),
    Case("a wheel lifted", add_objects=bumps, command_at=forward, is_scored=is_wheel_lifted),
    Case(
        "20 N step",
        change=lambda plan: replace(plan, force_scale=0.0, still=True),
        is_scored=is_pushed,
        is_step=True,
    ),
)


@dataclass(frozen=True, slots=True)
class RobustnessPlan:
    """One trial: number in CASES, number of the trial, seed of the test set."""

    case: int
    number: int
    seed: int
    duration_s: float = DURATION_S


@dataclass(frozen=True, slots=True)
class RobustnessTrial:
    """One plan, played.

    Attributes:
        plan: as asked.
        rejected: reasons of the attempts that were drawn again.
        scores: by estimator, where the disturbance was there; empty where it never was, or all attempts were rejected.
        recovery_s: of a step, by estimator; None where it did not recover. Empty in other cases.
    """

    plan: RobustnessPlan
    rejected: tuple[str, ...]
    scores: dict[str, Scores]
    recovery_s: dict[str, float | None]


def run_robustness_trial(plan: RobustnessPlan) -> RobustnessTrial:
    """Play one trial; a rejected attempt is drawn again."""
    case = CASES[plan.case]
    duration_s = STEP_DURATION_S if case.is_step else plan.duration_s
    rollout = case.change(draw_plan(plan.seed, plan.number, "hold", 1.0, (), duration_s))

    def attempt(rollout: RolloutPlan, seed: int) -> EstimatorPanel:
        runner = RolloutRunner(rollout, seed, case.scene(), case.command_at)
        if case.is_step:
            runner.backend.wrenches.add(step_force(plan.number, duration_s))
        return watch(runner, rollout, is_scored=case.is_scored)

    panel, _, rejected = first_accepted(rollout, attempt)
    scores = {} if panel is None else panel.scores()
    recovery = {name: recovery_time(score.error) for name, score in scores.items()} if case.is_step else {}
    return RobustnessTrial(plan, rejected, scores, recovery)


def step_force(number: int, duration_s: float) -> SampledForce:
    """STEP_N in one of STEP_DIRECTIONS from STEP_S on."""
    samples = np.zeros((round(duration_s / TICK_S), 3))
    samples[round(STEP_S / TICK_S) :] = STEP_N * np.array(STEP_DIRECTIONS[number % len(STEP_DIRECTIONS)])
    return SampledForce(samples, TICK_S)


def recovery_time(error: np.ndarray) -> float | None:
    """Time, s, from which on an error stays below RECOVERED_N; None where it does not.

    Args:
        error: (n, 3) N, sampled at 50 Hz from the step on.
    """
    off = np.flatnonzero(np.sqrt((error**2).sum(axis=1)) > RECOVERED_N)
    steps = off[-1] + 1 if len(off) else 0
    return None if steps == len(error) else float(steps * CONTROL_PERIOD_S)
