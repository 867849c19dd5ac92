"""What a scene is: the robot on a floor, and objects that it can push, wipe, turn or open."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from control.paths import ROBOT_MJCF

DRY_FRICTION_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Constraint impedance of dry joint friction that really holds: MuJoCo's default one creeps under load."""

PADDING_SOLREF = (0.02, 1.0)
PADDING_SOLIMP = (0.1, 0.9, 0.003, 0.5, 2.0)
"""Contact of a surface with a thin skin of rubber: it gives way by 2 mm under 15 N. Between rigid bodies the simulated force
jumps from tick to tick while they slide, which no sensor at 50 Hz follows."""
_PADDED_PRIORITY = 2
"""Above the tool and the floor: friction and padding of the surface hold."""

_PRIMITIVES = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}


@dataclass(frozen=True)
class Primitive:
    """One geom of a body that is not the robot, for drawing.

    Attributes:
        name: of the geom.
        kind: "plane", "sphere", "capsule", "ellipsoid", "cylinder" or "box".
        size: (3,) m, as MuJoCo defines it: half extents of a box, radius and half length (along z) of a capsule or
            cylinder, radius of a sphere, half axes of an ellipsoid; zeros where unused (an infinite plane is all zero).
        body: name of the body that carries it, "world" for a fixed one.
        position: (3,) m, in the body's frame.
        orientation_wxyz: (4,), geom to body.
        rgba: (4,) 0-1.
    """

    name: str
    kind: str
    size: np.ndarray
    body: str
    position: np.ndarray
    orientation_wxyz: np.ndarray
    rgba: np.ndarray


@dataclass(frozen=True, slots=True)
class Parameter:
    """Something of a scene that can be changed while it runs.

    Attributes:
        name: with its unit.
        default: what it is when nothing else is said.
        minimum, maximum: its range.
        drawn: range of what a seed draws; the task is not told.
    """

    name: str
    default: float
    minimum: float
    maximum: float
    drawn: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Reading:
    """Something of a scene that can be read off, such as an angle; `read` takes the state after a tick.

    What is read more than once per control period, such as the share of a pattern that is wiped, may count from call to call;
    `memory` has the STATE (control.state.capture) that it counts in.
    """

    name: str
    read: Callable[[mujoco.MjData], float]
    memory: object | None = None


def joint_reading(name: str, joint: str, sign: float = 1.0) -> Reading:
    """Position of a joint, rad or m, times `sign`."""
    return Reading(name, lambda data: sign * float(data.joint(joint).qpos[0]))


@dataclass(frozen=True)
class SceneModel:
    """A scene, ready to simulate.

    Attributes:
        name: as in sim.scenes.SCENE_NAMES.
        description: one line for the page.
        model: the compiled model. Its holder may change it (masses, friction): build the scene anew for a fresh one.
        robot_bodies: names of the robot's bodies.
        movable_bodies: names of the object bodies that move, in the order of GroundTruth.object_positions.
        primitives: all geoms that are not the robot's, fixed and movable.
        readings: what can be read off.
        values: its parameters, by name.
        rigid: nothing that the hand touches is padded.
    """

    name: str
    description: str
    model: mujoco.MjModel
    robot_bodies: tuple[str, ...]
    movable_bodies: tuple[str, ...]
    primitives: tuple[Primitive, ...]
    readings: tuple[Reading, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    rigid: bool = False


def pad(spec: mujoco.MjSpec, names: tuple[str, ...]) -> None:
    """Put a thin skin of rubber on geoms."""
    for name in names:
        geom = spec.geom(name)
        geom.solref, geom.solimp, geom.priority = PADDING_SOLREF, PADDING_SOLIMP, _PADDED_PRIORITY


def assemble(name: str, description: str, add_objects: Callable[[mujoco.MjSpec], tuple[str, ...]]) -> SceneModel:
    """Robot and floor, plus what `add_objects(spec)` adds; it returns the names of the bodies that move."""
    spec = mujoco.MjSpec.from_file(str(ROBOT_MJCF))
    robot_bodies = tuple(body.name for body in spec.bodies if body.name != "world")
    _forget_robot_defaults(spec)
    # Its friction is for objects and links: wheels and tool have priority 1, so theirs holds on whatever they touch.
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        rgba=[0.82, 0.83, 0.85, 1.0],
        friction=[0.8, 0.01, 0.001],
    )
    movable_bodies = add_objects(spec)
    model = spec.compile()
    return SceneModel(name, description, model, robot_bodies, movable_bodies, _primitives(model, robot_bodies))


def _forget_robot_defaults(spec: mujoco.MjSpec) -> None:
    """New elements take the main defaults, which in the robot's file are those of its drives and hidden collision geoms."""
    joint, geom = spec.default.joint, spec.default.geom
    joint.armature, joint.frictionloss, joint.damping = 0.0, 0.0, [0.0, 0.0, 0.0]
    geom.group = 0


def _primitives(model: mujoco.MjModel, robot_bodies: tuple[str, ...]) -> tuple[Primitive, ...]:
    primitives = []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom]).name
        if body in robot_bodies:
            continue
        primitives.append(
            Primitive(
                name=model.geom(geom).name,
                kind=_PRIMITIVES[mujoco.mjtGeom(model.geom_type[geom])],
                size=model.geom_size[geom].copy(),
                body=body,
                position=model.geom_pos[geom].copy(),
                orientation_wxyz=model.geom_quat[geom].copy(),
                rgba=model.geom_rgba[geom].copy(),
            )
        )
    return tuple(primitives)
