"""One trial of the contact benchmark: every force estimator against the simulated contact force on the tool."""

from dataclasses import dataclass

import numpy as np

from control.joints import LEGS
from control.timing import SLOT_COUNT
from sim.backends.simulation.mismatch import Mismatch
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig
from sim.benchmarks.estimator_contact_tasks import DURATION_S, TASKS
from sim.benchmarks.estimator_panel import EstimatorPanel
from sim.benchmarks.estimator_scores import Scores
from sim.scenes import SceneModel
from sim.trials.rollout_profiles import rms_force
from sim.trials.rollout_runner import RejectedError, drive, rollout_pipeline

AFTER_TOUCH_S = 0.3
"""Scored from here after the first touch to the end, with and without contact."""
TOUCH_N = 0.5


@dataclass(frozen=True, slots=True)
class ContactPlan:
    """One trial: number in TASKS, surface, mass scale of every link, seed of commands, friction and sensor errors."""

    task: int
    padded: bool
    mass_scale: float
    seed: int
    duration_s: float = DURATION_S


@dataclass(frozen=True, slots=True)
class ContactTrial:
    """One plan, played.

    Attributes:
        plan: as asked.
        failure: why it does not count ("fall", "contact" of another part, "diverged", "no contact"), or empty.
        scores: by estimator, from AFTER_TOUCH_S after the first touch on; empty after a failure.
        contact_share: of these samples, those in contact.
        rms_force_n: of the true force in these samples.
        ripple_n: root mean square distance of the true force at 500 Hz from its own mean over each 20 ms: the error that an
            estimate at 50 Hz has at least.
        time_s, force_true_n: (n,) s and (n, 3) N of these samples.
    """

    plan: ContactPlan
    failure: str
    scores: dict[str, Scores]
    contact_share: float
    rms_force_n: float
    ripple_n: float
    time_s: np.ndarray
    force_true_n: np.ndarray


def run_contact_trial(plan: ContactPlan) -> ContactTrial:
    """Play one trial."""
    task, random = TASKS[plan.task], np.random.default_rng(plan.seed)
    sensors = SensorConfig()
    scene = task.scene(plan.padded)
    untouchable = _part_may_not_touch(scene)
    backend = MujocoBackend(scene, sensors, plan.seed)
    backend.open()
    backend.set_mismatch(Mismatch(plan.mass_scale, joint_friction_scale=random.uniform(0.5, 1.5)))
    pipeline = rollout_pipeline()
    panel = EstimatorPanel(pipeline.model, sensors.delay_ticks)
    touched_s = np.inf
    times, forces, touching = [], [], []
    try:
        for tick in drive(backend, pipeline, task.commands(random), plan.duration_s):
            truth = backend.truth()
            panel.observe(tick.sensor, tick.output.base, tick.output.applied_command.mask, truth)
            in_contact = bool(np.linalg.norm(truth.force_true_n) > TOUCH_N)
            if in_contact:
                touched_s = min(touched_s, tick.time_s)
            scored = tick.time_s >= touched_s + AFTER_TOUCH_S
            if scored:
                forces.append(truth.force_true_n)
                touching.append(in_contact)
            if tick.index % SLOT_COUNT == 0:
                if untouchable[backend.data.contact.geom].any():
                    raise RejectedError("contact")
                panel.sample(truth, scored)
                if scored:
                    times.append(tick.time_s)
    except RejectedError as reason:
        return _failed(plan, str(reason))
    if not times:
        return _failed(plan, "no contact")
    return ContactTrial(
        plan,
        failure="",
        scores=panel.scores(),
        contact_share=float(np.mean(touching)),
        rms_force_n=rms_force(np.array(forces)),
        ripple_n=_ripple(np.array(forces)),
        time_s=np.array(times),
        force_true_n=np.array(panel.force_true_n),
    )


def _failed(plan: ContactPlan, failure: str) -> ContactTrial:
    return ContactTrial(plan, failure, {}, 0.0, 0.0, 0.0, np.zeros(0), np.zeros((0, 3)))


def _ripple(force: np.ndarray) -> float:
    """See ContactTrial.ripple_n; force (n, 3) N at 500 Hz."""
    blocks = force[: len(force) // SLOT_COUNT * SLOT_COUNT].reshape(-1, SLOT_COUNT, 3)
    return rms_force((blocks - blocks.mean(axis=1, keepdims=True)).reshape(-1, 3))


def _part_may_not_touch(scene: SceneModel) -> np.ndarray:
    """(ngeom,) bool: parts of the robot other than wheels and tool."""
    model = scene.model
    robot = np.isin(model.geom_bodyid, [model.body(name).id for name in scene.robot_bodies])
    robot[[model.geom(name).id for name in (*(f"{leg}_wheel" for leg in LEGS), "end_effector")]] = False
    return robot
