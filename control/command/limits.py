"""Limits, validation and rate limiting of the full command, so that a jump of a set-point never yanks the robot."""

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from control.command.command_record import COMMAND, from_record, to_record
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed
from control.kernels.small_algebra import clip
from control.types import Command
from control.values import value

Range = tuple[float, float]

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
        guidance_force_n: under guidance, whose spring holds a hand that is pulled with more than may be asked for.
        guidance_force_rate_nps: of each force reference under guidance, whose reference is a spring on the measured hand.
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
    guidance_force_n: Range = (-46.0, 46.0)
    guidance_force_rate_nps: float = 250.0
    velocity_acceleration: tuple[float, float, float] = (1.0, 0.5, 1.5)


class CommandError(ValueError):
    """A command that no clipping can repair: `field` names the part, the message says what it must be."""

    def __init__(self, field_name: str, requirement: str) -> None:
        super().__init__(f"command field {field_name!r} must be {requirement}")
        self.field = field_name


@value
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


LIMITS = config_record(CommandLimits())
"""The numbers of CommandLimits."""


@lru_cache(maxsize=8)
def limits_record(limits: CommandLimits) -> np.ndarray:
    """CommandLimits as a record LIMITS (1,) for kernels; not to be written to."""
    return packed(LIMITS, limits)


@kernel("void(Limits, f8[:])", Limits=LIMITS)
def _clip_to_box(limits: np.record, position: np.ndarray) -> None:
    """Clip a position (3,), m, to its ranges."""
    k = limits
    position[0] = clip(position[0], k.position_x_m[0], k.position_x_m[1])
    position[1] = clip(position[1], k.position_y_m[0], k.position_y_m[1])
    position[2] = clip(position[2], k.position_z_m[0], k.position_z_m[1])


@kernel("b1(Limits[::1], Command[::1])", Limits=LIMITS, Command=COMMAND)
def _clip(limits: np.ndarray, command: np.ndarray) -> bool:
    """Move a command (1,) to the nearest one within limits; False, and nothing changes, where no clipping can repair it.

    Ranges count per element. The position lies in a box and in a ball about the shoulder, both convex: a few alternating
    projections land in both.
    """
    k, c = limits[0], command[0]
    squares = 0.0
    for i in range(4):
        squares += c.orientation_wxyz[i] ** 2
    length = math.sqrt(squares)
    # Written so that what is not a number is refused.
    if not 1e-6 <= length < math.inf:
        return False
    for i in range(3):
        if c.mask[i] not in (0.0, 1.0):
            return False
        if not (math.isfinite(c.force_n[i]) and math.isfinite(c.position_m[i]) and math.isfinite(c.base_velocity[i])):
            return False
    for i in range(4):
        c.orientation_wxyz[i] /= length
    for i in range(3):
        c.force_n[i] = clip(c.force_n[i], k.force_n[0], k.force_n[1])
    c.base_velocity[0] = clip(c.base_velocity[0], k.velocity_x_mps[0], k.velocity_x_mps[1])
    c.base_velocity[1] = clip(c.base_velocity[1], k.velocity_y_mps[0], k.velocity_y_mps[1])
    c.base_velocity[2] = clip(c.base_velocity[2], k.yaw_rate_rps[0], k.yaw_rate_rps[1])
    _clip_to_box(k, c.position_m)
    for _ in range(8):
        squares = 0.0
        for i in range(3):
            squares += (c.position_m[i] - k.shoulder_m[i]) ** 2
        distance = math.sqrt(squares)
        if distance <= k.reach_m:
            break
        for i in range(3):
            c.position_m[i] = k.shoulder_m[i] + (c.position_m[i] - k.shoulder_m[i]) * ((k.reach_m - 1e-4) / distance)
        _clip_to_box(k, c.position_m)
    return True


def clip_command(command: Command, limits: CommandLimits) -> Command:
    """The nearest command within limits, with fresh arrays and a unit quaternion.

    Raises:
        CommandError: wrong shape, not finite, a mask other than 0 and 1, or a quaternion of zero length.
    """
    for name in COMMAND.names or ():
        shape = np.shape(getattr(command, name))
        if shape != COMMAND[name].shape:
            raise CommandError(name, f"an array of {COMMAND[name].shape[0]} numbers, not of shape {shape}")
    clipped = to_record(command)
    if not _clip(limits_record(limits), clipped):
        raise _defect(clipped[0])
    return from_record(clipped, bool(command.guidance))


def _defect(command: np.record) -> CommandError:
    """What is wrong with a record that `_clip` refuses."""
    for name in COMMAND.names or ():
        if not np.isfinite(command[name]).all():
            return CommandError(name, f"finite, not {command[name].tolist()}")
    if not np.isin(command.mask, (0.0, 1.0)).all():
        return CommandError("mask", f"0 (position) or 1 (force) per axis, not {command.mask.tolist()}")
    return CommandError("orientation_wxyz", "a quaternion of non-zero length")
