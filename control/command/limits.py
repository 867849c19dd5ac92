"""Limits, validation and rate limiting of the full command, so that a jump of a set-point never yanks the robot."""

from dataclasses import dataclass, field

import numpy as np

from control.types import Command

Range = tuple[float, float]

_SHAPES = {"mask": 3, "force_n": 3, "position_m": 3, "orientation_wxyz": 4, "base_velocity": 3}

DEFAULT_COMMAND = Command(
    mask=np.zeros(3),
    force_n=np.zeros(3),
    position_m=np.array([0.586, 0.0, 0.596]),
    orientation_wxyz=np.array([0.9553365, 0.0, 0.2955202, 0.0]),
    base_velocity=np.zeros(3),
)
"""Stand still, every axis position-controlled, hand where NOMINAL_POSITION holds it (0.6 rad below the horizon)."""


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Ranges and rates of the command, heading frame, SI.

    Attributes:
        force_n: on every axis. The arm carries 40 N; the wheels skid beyond it.
        tip_over_margin_m: distance that the centre of pressure keeps from the edges between the wheels under the force asked
            for, which is reduced as a whole where it would come nearer (control.command.tip_over). 20 N on every axis leave
            more; with less than 0.03 m the robot was seen to fall.
        position_x_m, position_y_m, position_z_m: box around the workspace in front of the trunk.
        shoulder_m: (3,) arm joint 2 above the ground in the nominal stance.
        reach_m: farthest hand from the shoulder; the arm stretches to 0.83 m with the hand in line, and a straight elbow
            leaves no way to yield.
        velocity_x_mps: forward speed.
        velocity_y_mps: sideways speed. Four wheels of fixed heading cannot roll sideways: the model-based controller
            leans the trunk that way instead and does not travel.
        yaw_rate_rps: beyond 0.5 rad/s the scrub of skid steering saturates the hips.
        position_speed_mps, position_acceleration_mps2: of the position reference.
        orientation_speed_rps, orientation_acceleration_rps2: of the orientation reference.
        force_rate_nps: of each force reference.
        velocity_acceleration: (3,) of the base velocity reference, m/s^2, m/s^2, rad/s^2.
    """

    force_n: Range = (-40.0, 40.0)
    tip_over_margin_m: float = 0.04
    position_x_m: Range = (0.30, 0.80)
    position_y_m: Range = (-0.35, 0.35)
    position_z_m: Range = (0.10, 0.95)
    shoulder_m: tuple[float, float, float] = (0.10, 0.0, 0.52)
    reach_m: float = 0.72
    velocity_x_mps: Range = (-0.6, 0.6)
    velocity_y_mps: Range = (-0.1, 0.1)
    yaw_rate_rps: Range = (-0.5, 0.5)
    position_speed_mps: float = 0.5
    position_acceleration_mps2: float = 1.5
    orientation_speed_rps: float = 1.2
    orientation_acceleration_rps2: float = 4.0
    force_rate_nps: float = 50.0
    velocity_acceleration: tuple[float, float, float] = (1.0, 0.5, 1.5)


class CommandError(ValueError):
    """A command that no clipping can repair: `field` names the part, the message says what it must be."""

    def __init__(self, field_name: str, requirement: str) -> None:
        super().__init__(f"command field {field_name!r} must be {requirement}")
        self.field = field_name


@dataclass(frozen=True, slots=True)
class HandState:
    """What the pipeline knows of the hand at one tick.

    Attributes:
        position_in_heading: (3,) m.
        rotation_to_heading: (3, 3).
        force_estimated_n: (3,) N, estimated, environment on hand.
    """

    position_in_heading: np.ndarray
    rotation_to_heading: np.ndarray
    force_estimated_n: np.ndarray = field(default_factory=lambda: np.zeros(3))


def clip_command(command: Command, limits: CommandLimits) -> Command:
    """The nearest command within limits, with fresh arrays and a unit quaternion.

    Raises:
        CommandError: wrong shape, not finite, a mask other than 0 and 1, or a quaternion of zero length.
    """
    for name, size in _SHAPES.items():
        value = np.asarray(getattr(command, name))
        if value.shape != (size,):
            raise CommandError(name, f"an array of {size} numbers, not of shape {value.shape}")
        if not np.isfinite(value).all():
            raise CommandError(name, f"finite, not {value.tolist()}")
    mask = np.asarray(command.mask, dtype=float)
    if not np.isin(mask, (0.0, 1.0)).all():
        raise CommandError("mask", f"0 (position) or 1 (force) per axis, not {mask.tolist()}")
    length = float(np.linalg.norm(command.orientation_wxyz))
    if length < 1e-6:
        raise CommandError("orientation_wxyz", "a quaternion of non-zero length")
    return Command(
        mask=mask.copy(),
        force_n=np.clip(command.force_n, *limits.force_n),
        position_m=_clip_position(command.position_m, limits),
        orientation_wxyz=command.orientation_wxyz / length,
        base_velocity=_clip_ranges(command.base_velocity, (limits.velocity_x_mps, limits.velocity_y_mps, limits.yaw_rate_rps)),
        guidance=bool(command.guidance),
    )


def _clip_ranges(values: np.ndarray, ranges: tuple[Range, Range, Range]) -> np.ndarray:
    lower, upper = np.transpose(ranges)
    return np.clip(values, lower, upper)


def _clip_position(position: np.ndarray, limits: CommandLimits) -> np.ndarray:
    box = (limits.position_x_m, limits.position_y_m, limits.position_z_m)
    shoulder = np.array(limits.shoulder_m)
    clipped = _clip_ranges(position, box)
    # Box and ball are convex and overlap: a few alternating projections land in both.
    for _ in range(8):
        offset = clipped - shoulder
        distance = np.linalg.norm(offset)
        if distance <= limits.reach_m:
            break
        clipped = _clip_ranges(shoulder + offset * ((limits.reach_m - 1e-4) / distance), box)
    return clipped
