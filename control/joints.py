"""Joint order, gains, torque limits and nominal posture of the robot: the one map between all joint orders, by name.

The joint order everywhere in Forcelens is: FL, FR, RL, RR legs (hip, thigh, calf each), then the four wheels in the same
order, then arm joints 1-6: 22 joints. Gains are the paper's (Sec. II.E) and equal the actuators of assets/robot/robot.xml.
"""

from collections.abc import Sequence

import numpy as np

LEGS = ("FL", "FR", "RL", "RR")
LEG_JOINT_NAMES = tuple(f"{leg}_{part}" for leg in LEGS for part in ("hip", "thigh", "calf"))
WHEEL_JOINT_NAMES = tuple(f"{leg}_wheel" for leg in LEGS)
ARM_JOINT_NAMES = tuple(f"arm_joint{i}" for i in range(1, 7))
JOINT_NAMES = LEG_JOINT_NAMES + WHEEL_JOINT_NAMES + ARM_JOINT_NAMES
JOINT_COUNT = len(JOINT_NAMES)

LEG_SLICE = slice(0, 12)
WHEEL_SLICE = slice(12, 16)
ARM_SLICE = slice(16, 22)

WHEEL_RADIUS_M = 0.086
WHEEL_HALF_WIDTH_M = 0.02
WHEEL_FRICTION = 0.8
"""Coulomb coefficient of a wheel on the floor (assets/robot/PROVENANCE.md); equals the geoms of assets/robot/robot.xml."""

STOP_MARGIN_RAD = 0.02
"""A joint this close to its end may lie against it."""

END_EFFECTOR_FRAME = "end_effector"
WHEEL_CENTER_FRAMES = tuple(f"{leg}_wheel_center" for leg in LEGS)


def _frozen(values: Sequence[float]) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    array.setflags(write=False)
    return array


STIFFNESS = _frozen([40.0] * 12 + [0.0] * 4 + [15.0] * 6)
"""Proportional gains, shape (22,), N m/rad (paper Sec. II.E)."""

DAMPING = _frozen([2.0] * 12 + [3.0] * 4 + [1.0] * 6)
"""Derivative gains, shape (22,), N m s/rad (paper Sec. II.E)."""

TORQUE_LIMIT = _frozen([23.7, 23.7, 45.43] * 4 + [15.0] * 4 + [30.0, 60.0, 30.0, 30.0, 30.0, 30.0])
"""Peak actuator torque, shape (22,), N m (assets/robot/PROVENANCE.md)."""

NOMINAL_POSITION = _frozen([0.0, 0.80, -1.80] * 2 + [0.0, 0.60, -1.74] * 2 + [0.0] * 4 + [0.0, 1.8, -1.0, -0.2, 0.0, 0.0])
"""Nominal posture, shape (22,), rad: the wheels stand under the centre of mass, which the arm moves forward."""

NOMINAL_BASE_HEIGHT_M = 0.357
"""Height of the base origin above flat ground in the nominal posture."""


def permutation(source: Sequence[str], target: Sequence[str]) -> np.ndarray:
    """Indices `i` with `values_in_target_order = values_in_source_order[i]`.

    Raises:
        ValueError: a target name is missing in `source` (the message names it).
    """
    missing = [name for name in target if name not in source]
    if missing:
        raise ValueError(f"joints {missing} are missing; the source order has {list(source)}")
    return np.array([source.index(name) for name in target], dtype=int)
