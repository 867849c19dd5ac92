"""Board wiping (paper Sec. IV.B): follow a pattern on a level board (x, y) while the force along z is regulated."""

import mujoco

DESCRIPTION = "A level board to wipe: position along x and y, force along z"

TOP_HEIGHT_M = 0.42
CENTER_X_M = 0.62
FRICTION = 0.35


def add_objects(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Adds the fixed geom "board" on two legs; no body moves."""
    half_x, half_y, half_thickness = 0.20, 0.30, 0.015
    # Above the tool's priority, so that the board's own, lower friction holds.
    spec.worldbody.add_geom(
        name="board",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half_x, half_y, half_thickness],
        pos=[CENTER_X_M, 0.0, TOP_HEIGHT_M - half_thickness],
        friction=[FRICTION, 0.005, 0.0001],
        priority=2,
        condim=4,
        rgba=[0.93, 0.94, 0.96, 1.0],
    )
    leg_half_height = 0.5 * (TOP_HEIGHT_M - 2 * half_thickness)
    for side, y in (("left", half_y - 0.03), ("right", -half_y + 0.03)):
        spec.worldbody.add_geom(
            name=f"board_leg_{side}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.02, 0.02, leg_half_height],
            pos=[CENTER_X_M + half_x - 0.03, y, leg_half_height],
            rgba=[0.45, 0.47, 0.50, 1.0],
        )
    return ()
