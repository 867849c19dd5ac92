"""The operator's drag: a soft, capped spring from the hand of the simulated robot to the point that the operator holds."""

import numpy as np

from sim.backends.simulation.wrenches import Spring

DRAG_STIFFNESS_NPM = 150.0
DRAG_DAMPING_NSPM = 12.0
DRAG_LIMIT_N = 40.0
"""The force never exceeds this, however far the operator pulls: as much as can be commanded along one axis."""

DRAG_HEARTBEAT_S = 0.3
"""A drag whose operator has not been heard for this long is let go."""


def drag_spring(target_in_world: np.ndarray) -> Spring:
    """The spring that pulls the end effector towards a point (3,) m in world.

    Raises:
        ValueError: the target is not three finite numbers.
    """
    return Spring(target_in_world, DRAG_STIFFNESS_NPM, DRAG_DAMPING_NSPM, limit_n=DRAG_LIMIT_N)
