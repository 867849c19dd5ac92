"""What is touched in the contact benchmark, and how: press a table, push a wall, slide a box.

The controller meets the surface without being told where it is. Surfaces are padded, as if with rubber: between rigid bodies
the simulated force jumps from tick to tick while they slide, which no sensor at 50 Hz follows. Rigid ones are there to show
that.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.types import Command
from sim.scenes import SceneModel, assemble, pad

DURATION_S = 12.0
APPROACH_S = 1.5
"""The hand takes its place; the task starts then."""
CHANGE_S = 2.5
"""Between two draws of the command."""
SURFACE = "surface"
"""Name of the geom that is touched."""

TABLE_HEIGHT_M = 0.44
WALL_X_M = 0.68
BOX_X_M = 0.70
BOX_HALF_M = (0.20, 0.25, 0.26)
BOX_MASS_KG = 4.0
BOX_FRICTION = 0.3
"""12 N of sliding friction; pushed at 0.42 m the box does not tip."""

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
                pad(spec, (SURFACE,))
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
