"""Box dragging (paper Sec. III.D): press on top of a box and drag it sideways by force alone.

The box runs on a lateral slide with viscous friction, so a lateral force A cos(w t) should move it by +-A / (c w):
0.2 m for 8 N at 0.2 Hz. The paper gives no mass or friction; these are chosen to meet its +-0.2 m range.
"""

from collections.abc import Mapping

import mujoco

from sim.scenes.scene import Parameter, Reading, joint_reading

DESCRIPTION = "A box on a lateral rail: press on its top and drag it sideways"

TOP_HEIGHT_M = 0.40
CENTER_X_M = 0.55
MASS_KG = 2.0
SLIDE_DAMPING = 31.8
"""N s/m."""
PARAMETERS = (
    Parameter("mass_kg", MASS_KG, 0.5, 6.0, drawn=(1.4, 2.6)),
    Parameter("damping_nspm", SLIDE_DAMPING, 5.0, 80.0, drawn=(SLIDE_DAMPING, SLIDE_DAMPING)),
)
PADDED = ("box",)
_HALF_LENGTH_X_M = 0.13
_HALF_LENGTH_Y_M = 0.20
_GROUND_CLEARANCE_M = 0.004
_RAIL_HALF_LENGTH_M = 0.85


def readings() -> tuple[Reading, ...]:
    """Where the box is along its rail."""
    return (joint_reading("box_position_m", "box_slide"),)


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Adds the body "box" (slide joint "box_slide" along y) and the drawn rails."""
    half_height = 0.5 * (TOP_HEIGHT_M - _GROUND_CLEARANCE_M)
    box = spec.worldbody.add_body(name="box", pos=[CENTER_X_M, 0.0, _GROUND_CLEARANCE_M + half_height])
    box.add_joint(
        name="box_slide",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 1, 0],
        damping=[values["damping_nspm"], 0, 0],
        range=[-0.6, 0.6],
        limited=True,
    )
    # Equal priority with the tool: the larger friction of the two holds, so 20 N of pressure can carry 8 N sideways.
    box.add_geom(
        name="box",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[_HALF_LENGTH_X_M, _HALF_LENGTH_Y_M, half_height],
        mass=values["mass_kg"],
        friction=[1.0, 0.01, 0.001],
        priority=1,
        condim=4,
        rgba=[0.76, 0.60, 0.42, 1.0],
    )
    for side, x in (("near", CENTER_X_M - 0.1), ("far", CENTER_X_M + 0.1)):
        spec.worldbody.add_geom(
            name=f"rail_{side}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.012, _RAIL_HALF_LENGTH_M, 0.001],
            pos=[x, 0.0, 0.001],
            contype=0,
            conaffinity=0,
            rgba=[0.45, 0.47, 0.50, 1.0],
        )
    return ("box",)
