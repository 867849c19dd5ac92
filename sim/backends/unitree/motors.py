"""Vendor motor slots of the base, by name, and what unused slots carry."""

import numpy as np

from control.joints import JOINT_NAMES, LEG_SLICE, WHEEL_SLICE, permutation
from sim.backends.unitree.layout import MOTOR_SLOTS

VENDOR_LEGS = ("FR", "FL", "RR", "RL")
SLOT_NAMES = tuple(f"{leg}_{part}" for leg in VENDOR_LEGS for part in ("hip", "thigh", "calf")) + tuple(
    f"{leg}_wheel" for leg in VENDOR_LEGS
)
"""Joint behind each of the first 16 slots (vendor header: legs 0-11, wheels 12-15, both FR, FL, RR, RL)."""

BASE_JOINT_COUNT = len(SLOT_NAMES)
BASE_SLICE = slice(LEG_SLICE.start, WHEEL_SLICE.stop)
BASE_JOINT_NAMES = JOINT_NAMES[BASE_SLICE]

SLOT_OF_JOINT = permutation(SLOT_NAMES, BASE_JOINT_NAMES)
"""(16,): base_values = slot_values[SLOT_OF_JOINT]."""

JOINT_OF_SLOT = permutation(BASE_JOINT_NAMES, SLOT_NAMES)
"""(16,): slot_values = base_values[JOINT_OF_SLOT]."""

MODE_SERVO = 1
MODE_OFF = 0
POSITION_STOP = 2.146e9
VELOCITY_STOP = 16000.0
"""The vendor's "no target" values. With any gain they would be a jump to nowhere: only unused slots carry them, gains zero."""

UNUSED_SLOTS = slice(BASE_JOINT_COUNT, MOTOR_SLOTS)
COMMAND_HEAD = (0xFE, 0xEF)
LEVEL_LOW = 0xFF


def used_slots(values: np.ndarray) -> np.ndarray:
    """(16,) float64 in base joint order of a (20,) slot array."""
    return values[SLOT_OF_JOINT].astype(float)
