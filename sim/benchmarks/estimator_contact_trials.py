"""Real contact for the estimator benchmark: press a table, push a wall, slide a box. Scenes, commands and one trial of each.

Truth is the simulated contact force on the tool. The controller, fed by `adaptive`, meets the surface without being told
where it is. Surfaces are padded, as if with rubber: between rigid bodies the simulated force jumps from tick to tick while
they slide, which no sensor at 50 Hz follows. Rigid ones are there to show that, see ContactTrial.ripple_n.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from control.command import DEFAULT_COMMAND
from control.joints import LEGS
from control.types import Command
from sim.backends.mujoco_backend import MujocoBackend
from sim.benchmarks.estimator_panel import SAMPLE_TICKS, EstimatorPanel
from sim.benchmarks.estimator_scores import Scores
from sim.mismatch import Mismatch
from sim.rollout_profiles import rms_force
from sim.rollout_runner import RejectedError, drive, rollout_pipeline
from sim.scenes import SceneModel, assemble
from sim.sensors import SensorConfig

DURATION_S = 12.0
APPROACH_S = 1.5
"""The hand takes its place; the task starts then."""
CHANGE_S = 2.5
"""Between two draws of the command."""
AFTER_TOUCH_S = 0.3
"""Scored from here after the first touch to the end, with and without contact."""
TOUCH_N = 0.5
SURFACE = "surface"
"""Name of the geom that is touched."""

TABLE_HEIGHT_M = 0.44
WALL_X_M = 0.68
BOX_X_M = 0.70
BOX_HALF_M = (0.20, 0.25, 0.26)
BOX_MASS_KG = 4.0
BOX_FRICTION = 0.3
"""12 N of sliding friction; pushed at 0.42 m the box does not tip."""

PADDING_SOLREF = (0.02, 1.0)
PADDING_SOLIMP = (0.1, 0.9, 0.003, 0.5, 2.0)
"""2 mm deep under 15 N."""

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_PRIORITY = 2
"""Above the tool and the floor: the surface's friction and padding hold."""


def table(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds a fixed level plate in front of the robot."""
    _add_surface(spec.worldbody, [0.3, 0.5, 0.02], friction=0.5, pos=[0.75, 0.0, TABLE_HEIGHT_M - 0.02])
    return ()


def wall(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds a fixed upright plate in front of the robot."""
    _add_surface(spec.worldbody, [0.02, 1.0, 0.6], friction=0.5, pos=[WALL_X_M + 0.02, 0.0, 0.6])
    return ()


def box(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds a free box on the floor in front of the robot."""
    body = spec.worldbody.add_body(name="box", pos=[BOX_X_M + BOX_HALF_M[0], 0.0, BOX_HALF_M[2]])
    body.add_freejoint()
    _add_surface(body, BOX_HALF_M, friction=BOX_FRICTION, mass=BOX_MASS_KG)
    return ("box",)


def _add_surface(body: mujoco.MjsBody, half_m: Sequence[float], friction: float, **options: Any) -> None:
    body.add_geom(
        name=SURFACE, type=_BOX, size=half_m, friction=[friction, 0.005, 0.0001], priority=_PRIORITY, condim=4, **options
    )


def press(random: np.random.Generator) -> Command:
    """Press down with 5-20 N at a place that changes, so that the tool also slides."""
    place = np.array([random.uniform(0.54, 0.62), random.uniform(-0.08, 0.08), TABLE_HEIGHT_M])
    return replace(
        DEFAULT_COMMAND,
        mask=np.array([0.0, 0.0, 1.0]),
        force_n=np.array([0.0, 0.0, random.uniform(5.0, 20.0)]),
        position_m=place,
    )


def push(random: np.random.Generator) -> Command:
    """Push forward with 5-15 N at a height that changes."""
    place = np.array([0.6, random.uniform(-0.08, 0.08), random.uniform(0.5, 0.6)])
    return replace(
        DEFAULT_COMMAND,
        mask=np.array([1.0, 0.0, 0.0]),
        force_n=np.array([-random.uniform(5.0, 15.0), 0.0, 0.0]),
        position_m=place,
    )


def slide(random: np.random.Generator) -> Command:
    """Hold the hand low and drive forward."""
    place = np.array([0.6, 0.0, 0.42])
    return replace(DEFAULT_COMMAND, position_m=place, base_velocity=np.array([random.uniform(0.1, 0.25), 0.0, 0.0]))


@dataclass(frozen=True, slots=True)
class ContactTask:
    """What is touched and how.

    Attributes:
        name: for the table.
        add_objects: as sim.scenes.assemble takes it.
        ready_m: (3,) hand before the task, in heading.
        draw: the next command of the task.
    """

    name: str
    add_objects: Callable[[mujoco.MjSpec], tuple[str, ...]]
    ready_m: tuple[float, float, float]
    draw: Callable[[np.random.Generator], Command]

    def scene(self, padded: bool) -> SceneModel:
        """A fresh world."""

        def add_objects(spec: mujoco.MjSpec) -> tuple[str, ...]:
            movable_bodies = self.add_objects(spec)
            if padded:
                surface = spec.geom(SURFACE)
                surface.solref, surface.solimp = PADDING_SOLREF, PADDING_SOLIMP
            return movable_bodies

        return assemble(self.name, self.name, add_objects)

    def commands(self, random: np.random.Generator) -> Callable[[float], Command]:
        """The command over time, s."""
        ready = replace(DEFAULT_COMMAND, position_m=np.array(self.ready_m))
        drawn = [self.draw(random) for _ in range(int(DURATION_S / CHANGE_S) + 1)]
        return lambda time_s: ready if time_s < APPROACH_S else drawn[int((time_s - APPROACH_S) / CHANGE_S)]


TASKS = (
    ContactTask("press table", table, (0.58, 0.0, 0.52), press),
    ContactTask("push wall", wall, (0.60, 0.0, 0.55), push),
    ContactTask("slide box", box, (0.60, 0.0, 0.42), slide),
)


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
        ripple_n: root mean square distance of the true force at 500 Hz from its own mean over each 20 ms: the error, from
            the first touch on, of an estimate at 50 Hz that is perfect on average.
        time_s, force_true: (n,) s and (n, 3) N of these samples.
    """

    plan: ContactPlan
    failure: str
    scores: dict[str, Scores]
    contact_share: float
    rms_force_n: float
    ripple_n: float
    time_s: np.ndarray
    force_true: np.ndarray


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
            in_contact = bool(np.linalg.norm(truth.end_effector_force) > TOUCH_N)
            if in_contact:
                touched_s = min(touched_s, tick.time_s)
            scored = tick.time_s >= touched_s + AFTER_TOUCH_S
            if scored:
                forces.append(truth.end_effector_force)
                touching.append(in_contact)
            if tick.index % SAMPLE_TICKS == 0:
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
        force_true=np.array(panel.force_true),
    )


def _failed(plan: ContactPlan, failure: str) -> ContactTrial:
    return ContactTrial(plan, failure, {}, 0.0, 0.0, 0.0, np.zeros(0), np.zeros((0, 3)))


def _ripple(force: np.ndarray) -> float:
    """See ContactTrial.ripple_n; force (n, 3) N at 500 Hz."""
    blocks = force[: len(force) // SAMPLE_TICKS * SAMPLE_TICKS].reshape(-1, SAMPLE_TICKS, 3)
    return rms_force((blocks - blocks.mean(axis=1, keepdims=True)).reshape(-1, 3))


def _part_may_not_touch(scene: SceneModel) -> np.ndarray:
    """(ngeom,) bool: parts of the robot other than wheels and tool."""
    model = scene.model
    robot = np.isin(model.geom_bodyid, [model.body(name).id for name in scene.robot_bodies])
    robot[[model.geom(name).id for name in (*(f"{leg}_wheel" for leg in LEGS), "end_effector")]] = False
    return robot
