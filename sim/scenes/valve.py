"""Valve rotation (paper Sec. IV.A): turn a handwheel that faces the robot by a force in the y-z plane.

The tool is a ball and cannot grasp, so the wheel's handle is a short square cup, open towards the robot: the ball in it
pulls and pushes in every direction of the plane while its orientation stays free.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from sim.scenes.scene import DRY_FRICTION_SOLIMP, Parameter, Reading, joint_reading

DESCRIPTION = "A handwheel with friction, turned by the cup on its rim"

CENTER_HEIGHT_M = 0.54
HANDLE_RADIUS_M = 0.12
CUP_BOTTOM_X_M = 0.71
"""x of the inner face of the cup, where the ball comes to rest."""
FRICTION_TORQUE = 0.8
"""N m."""
DAMPING = 2.0
"""N m s/rad."""
PARAMETERS = (
    Parameter("friction_nm", FRICTION_TORQUE, 0.0, 1.8, drawn=(0.5, 1.0)),
    Parameter("damping_nmsprad", DAMPING, 0.5, 6.0, drawn=(1.6, 2.4)),
    Parameter("height_m", CENTER_HEIGHT_M, 0.50, 0.58, drawn=(0.53, 0.55)),
)
PADDED = tuple(f"valve_cup_{part}" for part in ("bottom", "left", "right", "top", "low"))
_CUP_HALF_WIDTH_M = 0.027
_CUP_DEPTH_M = 0.035
_WALL_M = 0.004
_RIM_SEGMENTS = 12
_METAL = [0.45, 0.47, 0.50, 1.0]
_RED = [0.78, 0.22, 0.20, 1.0]
_MARK = [0.95, 0.85, 0.25, 1.0]


def readings() -> tuple[Reading, ...]:
    """How far the wheel is turned; positive turns the top to the robot's right."""
    return (joint_reading("valve_angle_rad", "valve_hinge"),)


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Adds the body "valve" (hinge "valve_hinge" about x, handle on top at angle 0) and its post."""
    plane_x, height = CUP_BOTTOM_X_M + 0.02, values["height_m"]
    valve = spec.worldbody.add_body(name="valve", pos=[plane_x, 0.0, height])
    valve.add_joint(
        name="valve_hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[1, 0, 0],
        damping=[values["damping_nmsprad"], 0, 0],
        frictionloss=values["friction_nm"],
        solimp_friction=DRY_FRICTION_SOLIMP,
        armature=0.01,
    )
    _add_wheel(valve)
    _add_cup(valve, CUP_BOTTOM_X_M - plane_x)
    post_half_height = 0.5 * (height + 0.05)
    spec.worldbody.add_geom(
        name="valve_post",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.02, 0.03, post_half_height],
        pos=[plane_x + 0.09, 0.0, post_half_height],
        rgba=_METAL,
    )
    spec.worldbody.add_geom(
        name="valve_stem",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[plane_x + 0.02, 0, height, plane_x + 0.09, 0, height],
        size=[0.015, 0, 0],
        contype=0,
        conaffinity=0,
        rgba=_METAL,
    )
    _add_dial(spec, plane_x + 0.05, height)
    return ("valve",)


def _add_dial(spec: mujoco.MjSpec, x: float, height: float) -> None:
    """Marks behind the wheel, the first on top, against which its handle is read."""
    for index, angle in enumerate(np.arange(0.0, 2.0 * np.pi, np.pi / 6.0)):
        inner, outer = (radius * np.array([0.0, -np.sin(angle), np.cos(angle)]) for radius in (0.15, 0.175))
        spec.worldbody.add_geom(
            name=f"valve_mark_{index}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*(inner + [x, 0.0, height]), *(outer + [x, 0.0, height])],
            size=[0.006 if index == 0 else 0.003, 0, 0],
            contype=0,
            conaffinity=0,
            rgba=_MARK if index == 0 else _METAL,
        )


def _add_wheel(valve: mujoco.MjsBody) -> None:
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    angles = np.linspace(0.0, 2.0 * np.pi, _RIM_SEGMENTS + 1)
    rim = HANDLE_RADIUS_M * np.stack([np.zeros_like(angles), np.sin(angles), np.cos(angles)], axis=1)
    for index in range(_RIM_SEGMENTS):
        ends = [*rim[index], *rim[index + 1]]
        valve.add_geom(name=f"valve_rim_{index}", type=capsule, fromto=ends, size=[0.01, 0, 0], mass=0.05, rgba=_RED)
    for index in range(0, _RIM_SEGMENTS, 4):
        ends = [0, 0, 0, *rim[index]]
        color = _MARK if index == 0 else _RED
        valve.add_geom(name=f"valve_spoke_{index}", type=capsule, fromto=ends, size=[0.008, 0, 0], mass=0.05, rgba=color)


def _add_cup(valve: mujoco.MjsBody, bottom_x: float) -> None:
    """Bottom plate and four walls around (0, HANDLE_RADIUS_M) of the wheel's y-z plane, open towards -x."""
    wide, deep = _CUP_HALF_WIDTH_M + 2 * _WALL_M, 0.5 * _CUP_DEPTH_M
    side = _CUP_HALF_WIDTH_M + _WALL_M
    parts = {
        "bottom": ((_WALL_M, wide, wide), (bottom_x + _WALL_M, 0.0, 0.0)),
        "left": ((deep, _WALL_M, wide), (bottom_x - deep, side, 0.0)),
        "right": ((deep, _WALL_M, wide), (bottom_x - deep, -side, 0.0)),
        "top": ((deep, _CUP_HALF_WIDTH_M, _WALL_M), (bottom_x - deep, 0.0, side)),
        "low": ((deep, _CUP_HALF_WIDTH_M, _WALL_M), (bottom_x - deep, 0.0, -side)),
    }
    for name, (size, (x, y, z)) in parts.items():
        valve.add_geom(
            name=f"valve_cup_{name}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=list(size),
            pos=[x, y, HANDLE_RADIUS_M + z],
            mass=0.01,
            rgba=_METAL,
        )
