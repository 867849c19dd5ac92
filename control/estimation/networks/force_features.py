"""What the force networks see at one 50 Hz step, by group: eq. (13) of the paper, and what our hybrid adds.

Every function takes arrays with any leading shape, so that the running estimator and the training read one definition.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.estimation.networks.force_signals import Signals
from control.joints import ARM_SLICE, JOINT_NAMES, LEG_SLICE, LEGS

_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class FeatureGroup:
    """Names and extraction of a few features that belong together."""

    names: tuple[str, ...]
    extract: Callable[[Signals], np.ndarray]


def _posture(signals: Signals) -> np.ndarray:
    # Wheel angles grow without bound and a wheel is round: their position says nothing.
    position = signals.joint_position
    return np.concatenate([position[..., LEG_SLICE], position[..., ARM_SLICE]], axis=-1)


def _gait_phase(signals: Signals) -> np.ndarray:
    return np.broadcast_to(np.array([0.0, 1.0]), (*signals.mask.shape[:-1], 2))


def _force_length(signals: Signals) -> np.ndarray:
    return np.sqrt((signals.nominal_force**2).sum(axis=-1, keepdims=True))


def _named(prefix: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{prefix}.{name}" for name in names)


GENERALIZED_NAMES = tuple(f"base_{part}_{axis}" for part in ("force", "moment") for axis in _AXES) + JOINT_NAMES
"""Rows of a generalized force with the joints in the order of control.joints, not in tree order."""

GROUPS = {
    "joint_position": FeatureGroup(
        _named("joint_position", JOINT_NAMES[LEG_SLICE] + JOINT_NAMES[ARM_SLICE]),
        _posture,
    ),
    "joint_velocity": FeatureGroup(_named("joint_velocity", JOINT_NAMES), lambda s: s.joint_velocity),
    "joint_torque": FeatureGroup(_named("joint_torque", JOINT_NAMES), lambda s: s.joint_torque),
    "orientation": FeatureGroup(_named("gravity_in_base", _AXES), lambda s: s.gravity_in_base),
    "angular_velocity": FeatureGroup(_named("angular_velocity", _AXES), lambda s: s.angular_velocity),
    "gait_phase": FeatureGroup(_named("gait_phase", ("sin", "cos")), _gait_phase),
    "mode": FeatureGroup(_named("mask", _AXES), lambda s: s.mask),
    "linear_acceleration": FeatureGroup(_named("linear_acceleration", _AXES), lambda s: s.linear_acceleration),
    "linear_velocity": FeatureGroup(_named("linear_velocity", _AXES), lambda s: s.linear_velocity),
    "nominal_force": FeatureGroup(_named("nominal_force", _AXES), lambda s: s.nominal_force),
    "nominal_force_length": FeatureGroup(("nominal_force_length",), _force_length),
    "nominal_wheel_forces": FeatureGroup(
        tuple(f"nominal_wheel_force.{leg}.{axis}" for leg in LEGS for axis in _AXES),
        lambda s: s.nominal_wheel_forces,
    ),
    "nominal_residual": FeatureGroup(_named("nominal_residual", GENERALIZED_NAMES), lambda s: s.nominal_residual),
    "nominal_unexplained": FeatureGroup(_named("nominal_unexplained", GENERALIZED_NAMES), lambda s: s.nominal_unexplained),
    "nominal_mass_scale": FeatureGroup(_named("nominal_mass_scale", ("arm", "rest")), lambda s: s.nominal_mass_scale),
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


def features(groups: tuple[str, ...], signals: Signals) -> np.ndarray:
    """(..., len(feature_names(groups))) features of `signals`, not normalised."""
    return np.concatenate([GROUPS[group].extract(signals) for group in groups], axis=-1)


def increment_columns(groups: tuple[str, ...], increment_groups: tuple[str, ...]) -> np.ndarray:
    """(features,) 1 where a feature of `groups` belongs to one of `increment_groups`, else 0."""
    return np.concatenate([np.full(len(GROUPS[group].names), float(group in increment_groups)) for group in groups])


def sigma_drivers(windows: np.ndarray, increments: np.ndarray, mass_scale: np.ndarray) -> np.ndarray:
    """What a network's standard deviation is scaled by: how unlike arm and rest are, and how fast the force has changed.

    Where the masses of arm and rest are off by unlike factors, so are those of their links, which two scales cannot tell. And
    the error that a network states is too large for slow forces and too small for fast ones.

    Args:
        windows: (..., H, features) normalised.
        increments: (features,) of `increment_columns`.
        mass_scale: (..., 2) features of SIGMA_GROUPS at the newest step.

    Returns:
        (..., SIGMA_DRIVERS): difference of the mass scales, then the logarithm of the mean length of the window's H increments.
    """
    lengths = np.sqrt((windows * windows) @ increments)
    change = lengths.sum(axis=-1, keepdims=True) / lengths.shape[-1]
    unlike = np.abs(mass_scale[..., :1] - mass_scale[..., 1:])
    return np.concatenate([unlike, np.log(_CHANGE_FLOOR + change)], axis=-1)
