"""One task on trial: scene, friction, masses and the error of the site as a seed draws them, and the truth beside it.

The task sees estimates alone; everything here is scored at 500 Hz by the simulator's truth.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import EstimatorsConfig
from control.frames import rotation_z
from control.paths import WEIGHTS_DIRECTORY
from control.pipeline import PipelineConfig
from control.timing import SLOT_COUNT, TICK_S
from sim import scenes
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.tasks import TASKS
from sim.tasks.runner import Outcome
from sim.trials.touching import Touching

SETTLE_S = 1.5
LIMIT_S = 300.0
SITE_ERROR_M, SITE_ERROR_RAD = 0.02, np.radians(2.0)
SITE_CENTER_M = {"wipe": (0.62, 0.0), "valve": (0.71, 0.0), "door": (0.84, -0.2), "box": (0.55, 0.0)}
"""What the error turns the site around: its object."""
FALLEN_UP_COSINE = 0.75


@dataclass(frozen=True, slots=True)
class TaskPlan:
    """A trial.

    Attributes:
        task: its name.
        seed: of sensors, scene and site.
        rigid: nothing that the hand touches is padded.
        controller: of the pipeline.
        mass_scale: of the robot; the pipeline is not told.
        options: of the task.
        parameters: of the scene, instead of what the seed draws.
    """

    task: str
    seed: int
    rigid: bool = False
    controller: str = "policy"
    mass_scale: float = 1.0
    options: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)

    @property
    def scene(self) -> str:
        """In which it is played."""
        return TASKS[self.task].SCENE or "free"

    def site_error(self) -> tuple[float, float, float]:
        """x, y, yaw of the site's frame as believed, in that of the odometry."""
        center = SITE_CENTER_M.get(self.task)
        if center is None:
            return 0.0, 0.0, 0.0
        random = np.random.default_rng([self.seed, 17])
        shift, yaw = random.uniform(-SITE_ERROR_M, SITE_ERROR_M, 2), float(random.uniform(-SITE_ERROR_RAD, SITE_ERROR_RAD))
        turned = rotation_z(yaw)[:2, :2] @ center
        return float(center[0] + shift[0] - turned[0]), float(center[1] + shift[1] - turned[1]), yaw


@dataclass(slots=True)
class TaskTrace:
    """What happened, tick by tick while the task commanded; forces in heading, (n, 3) N, and the rest at 500 Hz too.

    Attributes:
        time_s: (n,).
        phase: (n,) names.
        phase_s: (n,) since the phase began.
        true, estimated, applied: environment on hand, and as the command was applied.
        hand_m: true, (n, 3) in world.
        target_m: (n, 2) in world, where a task says so.
        base: (n, 3) true x, y, yaw.
        readings: (n,) by name.
        touched: what else touched.
        outcome, reason, metrics: of the task.
        fell: the robot lies, or its drives damp.
        leads: of a person, (progress m, force N).
        seconds: how long the task took.
    """

    time_s: np.ndarray
    phase: np.ndarray
    phase_s: np.ndarray
    true: np.ndarray
    estimated: np.ndarray
    applied: np.ndarray
    hand_m: np.ndarray
    target_m: np.ndarray
    base: np.ndarray
    readings: dict[str, np.ndarray]
    touched: dict[str, float]
    outcome: Outcome
    reason: str
    metrics: dict[str, float]
    fell: bool
    leads: list[tuple[float, float]]
    seconds: float

    def during(self, *phases: str, after_s: float = 0.0) -> np.ndarray:
        """(n,) where one of the phases was at work for longer than `after_s`."""
        return np.isin(self.phase, phases) & (self.phase_s > after_s)


def play(plan: TaskPlan, weights: Path = WEIGHTS_DIRECTORY) -> TaskTrace:
    """Play a task to its end, or until the robot falls."""
    parameters = {**scenes.draw(plan.scene, plan.seed), **plan.parameters}
    # Estimators that are only shown would take most of the time.
    pipeline = PipelineConfig(
        controller=plan.controller, policies=weights, estimators=EstimatorsConfig(names=("adaptive", "hybrid"))
    )
    session = Simulation(SimulationConfig(plan.scene, plan.seed, parameters, plan.rigid, pipeline=pipeline))
    if plan.mass_scale != 1.0:
        session.set_mismatch(plan.mass_scale)
    for _ in range(round(SETTLE_S / TICK_S)):
        session.tick(DEFAULT_COMMAND).raise_failures()
    site = plan.site_error()
    options = dict(zip(("site_x_m", "site_y_m", "site_yaw_rad"), site, strict=True)) | plan.options
    runner = session.start_task(plan.task, options).runner
    touching = Touching(session.backend)
    turn, origin = rotation_z(site[2])[:2, :2], np.array(site[:2])
    rows: list[np.ndarray] = []
    phases: list[str] = []
    readings: list[list[float]] = []
    begun_s, begun_phase, started_s, fell = session.time_s, "", session.time_s, False
    while session.tasks.running and session.time_s - started_s < LIMIT_S and not fell:
        session.tick_task()
        output, truth = session.output, session.truth()
        if runner.phase != begun_phase:
            begun_s, begun_phase = session.time_s, runner.phase
        w, x, y, z = truth.base_orientation_wxyz
        target = getattr(runner.task, "target_m", None)
        phases.append(runner.phase)
        readings.append(list(session.readings().values()))
        rows.append(
            np.concatenate(
                [
                    [session.time_s, session.time_s - begun_s],
                    truth.force_true_n,
                    output.hand.force_estimated_n,
                    output.applied_command.force_n,
                    truth.end_effector_position,
                    np.full(2, np.nan) if target is None else turn @ target + origin,
                    [*truth.base_position[:2], np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))],
                ]
            )
        )
        if len(rows) % SLOT_COUNT == 0:
            touching.look(runner.phase)
            fell = bool(w * w - x * x - y * y + z * z < FALLEN_UP_COSINE or output.safety.damping)
    columns = np.split(np.array(rows), [1, 2, 5, 8, 11, 14, 16], axis=1)
    return TaskTrace(
        time_s=columns[0][:, 0],
        phase=np.array(phases),
        phase_s=columns[1][:, 0],
        true=columns[2],
        estimated=columns[3],
        applied=columns[4],
        hand_m=columns[5],
        target_m=columns[6],
        base=columns[7],
        readings=dict(zip(session.readings(), np.array(readings).T, strict=True)),
        touched=touching.seconds,
        outcome=runner.outcome,
        reason=runner.reason if not fell else f"{runner.phase}: the robot fell",
        metrics=runner.task.metrics(),
        fell=fell,
        leads=[(lead.progress_m, lead.force_n) for lead in session.person.leads] if session.person else [],
        seconds=session.time_s - started_s,
    )
