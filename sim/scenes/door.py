"""Spring-loaded door (paper Sec. IV.C): press the lever down to free the latch, then push the door open against its closer.

The latch is mechanical: a bolt behind the lever's axis stands in front of a strike plate on the frame and swings clear of
it when the lever is pressed down by about 0.35 rad. The strike's far side slants, so that a door that closes lifts its bolt
over it and latches again. Positive door angles open away from the robot.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from sim.scenes.scene import DRY_FRICTION_SOLIMP, Parameter, Reading, joint_reading

DESCRIPTION = "A spring-loaded door: press the lever, push, keep it open"

HINGE_X_M, HINGE_Y_M = 0.84, 0.55
WIDTH_M, HEIGHT_M = 0.80, 1.20
LEVER_HEIGHT_M = 0.55
LEVER_X_M = HINGE_X_M - 0.08
LEVER_AXIS_Y_M = HINGE_Y_M - WIDTH_M + 0.05
LEVER_LENGTH_M = 0.14
CLOSER_STIFFNESS = 5.0
"""N m/rad."""
CLOSER_PRELOAD = 2.5
"""N m at the closed door."""
CLOSER_DAMPING = 4.0
"""N m s/rad; the leaf takes some two seconds to close."""
LEVER_STIFFNESS = 1.2
"""N m/rad."""
PARAMETERS = (
    Parameter("spring_scale", 1.0, 0.2, 2.5, drawn=(0.9, 1.1)),
    Parameter("damping_nmsprad", CLOSER_DAMPING, 1.0, 15.0, drawn=(3.0, 5.0)),
    Parameter("leaf_kg", 8.0, 4.0, 16.0, drawn=(7.0, 10.0)),
)
LEAF_FRICTION = 0.4
"""Of smooth paint under rubber."""
PADDED = ("door", "door_lever_grip")
_HALF_THICKNESS_M = 0.02
_BOLT_LENGTH_M = 0.10
_WOOD = [0.72, 0.56, 0.40, 1.0]
_METAL = [0.45, 0.47, 0.50, 1.0]
_FRAME = [0.88, 0.88, 0.86, 1.0]


def readings() -> tuple[Reading, ...]:
    """How far the leaf is open and the lever pressed."""
    return joint_reading("door_angle_rad", "door_hinge"), joint_reading("lever_angle_rad", "lever_hinge")


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Adds the bodies "door" (hinge "door_hinge") and "door_lever" (hinge "lever_hinge"), and the fixed frame."""
    door = spec.worldbody.add_body(name="door", pos=[HINGE_X_M, HINGE_Y_M, 0.0])
    door.add_joint(
        name="door_hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 0, 1],
        range=[0.0, 1.9],
        limited=True,
        solref_limit=[0.05, 1.0],  # a stop of rubber
        stiffness=[values["spring_scale"] * CLOSER_STIFFNESS, 0, 0],
        springref=-CLOSER_PRELOAD / CLOSER_STIFFNESS,
        damping=[values["damping_nmsprad"], 0, 0],
        frictionloss=0.3,
        solimp_friction=DRY_FRICTION_SOLIMP,
    )
    door.add_geom(
        name="door",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[_HALF_THICKNESS_M, 0.5 * WIDTH_M, 0.5 * HEIGHT_M - 0.01],
        pos=[0.0, -0.5 * WIDTH_M, 0.5 * HEIGHT_M + 0.01],
        mass=values["leaf_kg"],
        friction=[LEAF_FRICTION, 0.005, 0.0001],
        rgba=_WOOD,
    )
    _add_lever(door)
    _add_frame(spec)
    # The leaf turns into the hinge post; the joint's range is what stops it.
    spec.add_exclude(name="door_frame", bodyname1="world", bodyname2="door")
    return ("door", "door_lever")


def _add_lever(door: mujoco.MjsBody) -> None:
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    lever = door.add_body(name="door_lever", pos=[0.0, LEVER_AXIS_Y_M - HINGE_Y_M, LEVER_HEIGHT_M])
    lever.add_joint(
        name="lever_hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[-1, 0, 0],
        range=[0.0, 0.7],
        limited=True,
        stiffness=[LEVER_STIFFNESS, 0, 0],
        springref=-0.15,
        damping=[0.05, 0, 0],
        armature=0.001,
    )
    reach = LEVER_X_M - HINGE_X_M
    parts = {
        "axis": ([reach, 0, 0, 0, 0, 0], 0.010),
        "grip": ([reach, 0, 0, reach, LEVER_LENGTH_M, 0], 0.010),
        "bolt": ([0, 0, 0, 0, -_BOLT_LENGTH_M, 0], 0.008),
    }
    for name, (ends, radius) in parts.items():
        lever.add_geom(name=f"door_lever_{name}", type=capsule, fromto=ends, size=[radius, 0, 0], mass=0.08, rgba=_METAL)
    back = [reach, LEVER_LENGTH_M, 0, reach + 0.045, LEVER_LENGTH_M, 0]  # the grip's end turns back to the leaf
    lever.add_geom(
        name="door_lever_return",
        type=capsule,
        fromto=back,
        size=[0.010, 0, 0],
        mass=0.02,
        contype=0,
        conaffinity=0,
        rgba=_METAL,
    )
    for side, x in (("near", -1.0), ("far", 1.0)):
        door.add_geom(
            name=f"door_plate_{side}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.002, 0.022, 0.11],
            pos=[x * (_HALF_THICKNESS_M + 0.002), LEVER_AXIS_Y_M - HINGE_Y_M, LEVER_HEIGHT_M - 0.03],
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=_METAL,
        )


def _add_frame(spec: mujoco.MjSpec) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    latch_y = HINGE_Y_M - WIDTH_M
    posts = {"hinge": HINGE_Y_M + 0.06, "latch": latch_y - 0.11}
    for name, y in posts.items():
        size = [0.04, 0.05, 0.5 * HEIGHT_M + 0.03]
        spec.worldbody.add_geom(name=f"door_post_{name}", type=box, size=size, pos=[HINGE_X_M, y, size[2]], rgba=_FRAME)
    spec.worldbody.add_geom(
        name="door_strike",
        type=box,
        size=[0.01, 0.021, 0.012],
        pos=[HINGE_X_M + 0.02, latch_y - 0.039, LEVER_HEIGHT_M],
        rgba=_METAL,
    )
    _add_slant(spec, np.array([HINGE_X_M + 0.03, latch_y - 0.039, LEVER_HEIGHT_M + 0.012]))


def _add_slant(spec: mujoco.MjSpec, top: np.ndarray) -> None:
    """The strike's far side: a chute from its upper edge `top` (3,) m down and away from the robot."""
    slope, half_length, half_thickness = 0.38, 0.046, 0.004
    along, normal = np.array([np.cos(slope), 0.0, -np.sin(slope)]), np.array([np.sin(slope), 0.0, np.cos(slope)])
    spec.worldbody.add_geom(
        name="door_slant",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half_length, 0.021, half_thickness],
        pos=top + half_length * along - half_thickness * normal,
        quat=[np.cos(0.5 * slope), 0.0, np.sin(0.5 * slope), 0.0],
        friction=[0.05, 0.005, 0.0001],
        priority=1,
        rgba=_METAL,
    )
