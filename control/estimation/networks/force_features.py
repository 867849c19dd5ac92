"""What the force networks see at one 50 Hz step, by group: eq. (13) of the paper, and what our hybrid adds.

A feature is a column of the signals, so that the running estimator and the training read one definition.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.estimation.networks.force_signals import SIGNALS
from control.joints import ARM_SLICE, JOINT_COUNT, JOINT_NAMES, LEG_SLICE, LEGS
from control.kernels.compiled import kernel

_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class FeatureGroup:
    """Names of a few features that belong together, the field of SIGNALS that holds them and which of its entries they are."""

    names: tuple[str, ...]
    field: str
    entries: tuple[int, ...]


def _group(field: str, names: tuple[str, ...]) -> FeatureGroup:
    """All of a field."""
    return FeatureGroup(names, field, tuple(range(len(names))))


def _named(prefix: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{prefix}.{name}" for name in names)


GENERALIZED_NAMES = tuple(f"base_{part}_{axis}" for part in ("force", "moment") for axis in _AXES) + JOINT_NAMES
"""Rows of a generalized force with the joints in the order of control.joints, not in tree order."""

_POSTURE = (*range(JOINT_COUNT)[LEG_SLICE], *range(JOINT_COUNT)[ARM_SLICE])
"""Wheel angles grow without bound and a wheel is round: their position says nothing."""

GROUPS = {
    "joint_position": FeatureGroup(
        _named("joint_position", tuple(JOINT_NAMES[joint] for joint in _POSTURE)), "joint_position", _POSTURE
    ),
    "joint_velocity": _group("joint_velocity", _named("joint_velocity", JOINT_NAMES)),
    "joint_torque": _group("joint_torque", _named("joint_torque", JOINT_NAMES)),
    "orientation": _group("gravity_in_base", _named("gravity_in_base", _AXES)),
    "angular_velocity": _group("angular_velocity", _named("angular_velocity", _AXES)),
    "gait_phase": _group("gait_phase", _named("gait_phase", ("sin", "cos"))),
    "mode": _group("mask", _named("mask", _AXES)),
    "linear_acceleration": _group("linear_acceleration", _named("linear_acceleration", _AXES)),
    "linear_velocity": _group("linear_velocity", _named("linear_velocity", _AXES)),
    "nominal_force": _group("nominal_force", _named("nominal_force", _AXES)),
    "nominal_force_length": _group("nominal_force_length", ("nominal_force_length",)),
    "nominal_wheel_forces": _group(
        "nominal_wheel_forces", tuple(f"nominal_wheel_force.{leg}.{axis}" for leg in LEGS for axis in _AXES)
    ),
    "nominal_residual": _group("nominal_residual", _named("nominal_residual", GENERALIZED_NAMES)),
    "nominal_unexplained": _group("nominal_unexplained", _named("nominal_unexplained", GENERALIZED_NAMES)),
    "nominal_mass_scale": _group("nominal_mass_scale", _named("nominal_mass_scale", ("arm", "rest"))),
}

PAPER_GROUPS = ("joint_position", "joint_velocity", "joint_torque", "orientation", "angular_velocity", "gait_phase", "mode")
"""Eq. (13): x_dyn, x_base, x_gait, x_mode."""

HYBRID_INCREMENT_GROUPS = ("nominal_force",)
HYBRID_GROUPS = (*HYBRID_INCREMENT_GROUPS, "nominal_force_length")
"""Ours: how the nominal force has changed from step to step, and how long it is.

Its level tells one robot from another, by masses, offsets and torque constants: a network that sees levels learns the errors of
the robots in its training set and worsens the estimate on others. And noise, which a network can take out, is large among
changes while it vanishes beside a force of 20 N.
"""


SIGMA_GROUPS = ("nominal_mass_scale",)
"""What scales a network's standard deviation besides, by way of `sigma_drivers`. The force must not depend on it: the level
of a mass tells robots apart."""

SIGMA_DRIVERS = 2
"""Number of drivers that `sigma_drivers` gives."""

# Keeps the logarithm finite where nothing changes; small beside the slowest windows of the validation set, 0.3.
_CHANGE_FLOOR = 0.05


def feature_names(groups: tuple[str, ...]) -> tuple[str, ...]:
    """Names of all features of `groups`, in order.

    Raises:
        ValueError: a group does not exist (the message lists those that do).
    """
    unknown = [group for group in groups if group not in GROUPS]
    if unknown:
        raise ValueError(f"unknown feature groups {unknown}; available: {', '.join(GROUPS)}")
    return tuple(name for group in groups for name in GROUPS[group].names)


def feature_columns(groups: tuple[str, ...]) -> np.ndarray:
    """(features,) number of SIGNALS that each feature of `groups` is."""
    first = {name: offset // np.dtype(float).itemsize for name, (_, offset, *_) in (SIGNALS.fields or {}).items()}
    return np.array([first[GROUPS[group].field] + entry for group in groups for entry in GROUPS[group].entries])


def numbers(signals: np.ndarray) -> np.ndarray:
    """(n * columns,) the SIGNALS (n,) as plain numbers, in the same memory."""
    return signals.view(float)


def features(groups: tuple[str, ...], signals: np.ndarray) -> np.ndarray:
    """(n, len(feature_names(groups))) features of SIGNALS (n,), not normalised."""
    return numbers(signals).reshape(len(signals), -1)[:, feature_columns(groups)]


def increment_columns(groups: tuple[str, ...], increment_groups: tuple[str, ...]) -> np.ndarray:
    """(features,) 1 where a feature of `groups` belongs to one of `increment_groups`, else 0."""
    return np.concatenate([np.full(len(GROUPS[group].names), float(group in increment_groups)) for group in groups])


def sigma_drivers(windows: np.ndarray, increments: np.ndarray, mass_scales: np.ndarray) -> np.ndarray:
    """What a network's standard deviation is scaled by: how unlike arm and rest are, and how fast the force has changed.

    Where the masses of arm and rest are off by unlike factors, so are those of their links, which two scales cannot tell. And
    the error that a network states is too large for slow forces and too small for fast ones.

    Args:
        windows: (n, H, features) normalised.
        increments: (features,) of `increment_columns`.
        mass_scales: (n, 2) features of SIGMA_GROUPS at the newest step.

    Returns:
        (n, SIGMA_DRIVERS): difference of the mass scales, then the logarithm of the mean length of the window's H increments.
    """
    drivers = np.empty((len(windows), SIGMA_DRIVERS))
    _all_sigma_drivers(np.asarray(windows, float), increments, mass_scales, drivers)
    return drivers


@kernel("UniTuple(f8, 2)(matrix, f8[::1], f8, f8)")
def sigma_drivers_of(window: np.ndarray, increments: np.ndarray, arm_scale: float, rest_scale: float) -> tuple[float, float]:
    """See `sigma_drivers`: |s_arm - s_rest|, and log(c + 1/H sum_t |increments_t|), of one window (H, features)."""
    steps, size = window.shape
    change = 0.0
    for t in range(steps):
        square = 0.0
        for i in range(size):
            square += increments[i] * window[t, i] * window[t, i]
        change += math.sqrt(square)
    return abs(arm_scale - rest_scale), math.log(_CHANGE_FLOOR + change / steps)


@kernel("void(Array(f8, 3, 'A', readonly=True), f8[::1], matrix, f8[:,::1])")
def _all_sigma_drivers(windows: np.ndarray, increments: np.ndarray, mass_scales: np.ndarray, drivers: np.ndarray) -> None:
    """See `sigma_drivers`."""
    for n in range(len(windows)):
        drivers[n] = sigma_drivers_of(windows[n], increments, mass_scales[n, 0], mass_scales[n, 1])
