"""Zero-force guidance: a hand leads the robot by its end effector.

All axes are force-controlled towards zero force, so the hand yields. The planar force that remains drives the base: its x
component rolls it forward or back, its y component turns it towards the pull. The end effector rides ahead of the wheels,
so turning moves it sideways, and together both let it follow any planar direction although the wheels cannot.
How far a gently led hand has moved tells of the force sooner than the estimate does, and without its bias.
A soft centring force brings the hand back to a comfortable place before the base, so the base follows and the arm never
stretches out.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from control.command.command_record import COMMAND, from_record, to_record
from control.command.limits import DEFAULT_COMMAND, HandState
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed, record
from control.kernels.small_algebra import clip
from control.types import Command


@dataclass(frozen=True, slots=True)
class GuidanceConfig:
    """Gains of the admittance from the led hand to the base.

    Attributes:
        dead_band_n: planar force below which the base rests; above the estimator's bias, so it does not drift.
        gentle_n: planar force up to which the centring force counts for half of the driving one. From twice as much on, the
            estimate is all of it: a firm pull swings the hand, and the base shall not swing with it.
        forward_gain: m/s per N of planar force beyond the dead band.
        yaw_gain: rad/s per N.
        forward_limit_mps, yaw_limit_rps: saturation.
        smoothing_s: time constant of the low-pass on the force.
        centring_stiffness: N/m of the soft spring near the comfortable place: 4 N at 10 cm.
        stretch_m: distance beyond which the spring stiffens.
        stretch_stiffness: N/m beyond it, so that 15 N stretch the arm by less than 20 cm.
        end_m, end_stiffness: the same again, so that 40 N stretch it by less than 30 cm: farther the robot could not bear them.
        glide_mps: speed at which the spring's rest position moves from where guidance began to the comfortable place.
    """

    dead_band_n: float = 2.0
    gentle_n: float = 10.0
    forward_gain: float = 0.08
    yaw_gain: float = 0.16
    forward_limit_mps: float = 0.5
    yaw_limit_rps: float = 0.5
    smoothing_s: float = 0.08
    centring_stiffness: float = 40.0
    stretch_m: float = 0.12
    stretch_stiffness: float = 150.0
    end_m: float = 0.16
    end_stiffness: float = 400.0
    glide_mps: float = 0.15


GUIDANCE = config_record(GuidanceConfig(), comfortable_m=3)
"""The numbers of GuidanceConfig, and the comfortable place of the hand in heading: that of the default command."""

GUIDANCE_STATE = record(force_n=3, rest_m=3)
"""Smoothed force on the hand, and the rest position of the centring spring, in heading."""


@kernel("void(Guidance, vector, f8[:])", Guidance=GUIDANCE)
def base_velocity(config: np.record, force_n: np.ndarray, out: np.ndarray) -> None:
    """Base velocity (3,) [m/s, 0, rad/s] for a driving force (3,), N, on the hand, heading frame.

    v = clip(k_v e f_x, +-v_max), w = clip(k_w e f_y, +-w_max), where e is the share of the planar force beyond the dead band.
    """
    size = math.hypot(force_n[0], force_n[1])
    excess = max(0.0, size - config.dead_band_n) / max(size, 1e-9)
    out[0] = clip(config.forward_gain * excess * force_n[0], -config.forward_limit_mps, config.forward_limit_mps)
    out[1] = 0.0
    out[2] = clip(config.yaw_gain * excess * force_n[1], -config.yaw_limit_rps, config.yaw_limit_rps)


@kernel("void(Guidance, vector, f8[:])", Guidance=GUIDANCE)
def centring_force(config: np.record, displacement_m: np.ndarray, out: np.ndarray) -> None:
    """Force (3,), N, at which the hand rests when led by a displacement (3,), m, from the spring's rest position.

    f = k d up to the stretch s, from there on (k s + k_s (|d| - s)) d / |d|, and beyond the end e with k_e (|d| - e) more.
    """
    distance = math.sqrt(displacement_m[0] ** 2 + displacement_m[1] ** 2 + displacement_m[2] ** 2)
    factor = config.centring_stiffness
    if distance > config.stretch_m:
        beyond = config.stretch_stiffness * (distance - config.stretch_m)
        beyond += config.end_stiffness * max(0.0, distance - config.end_m)
        factor = (config.centring_stiffness * config.stretch_m + beyond) / distance
    for i in range(3):
        out[i] = factor * displacement_m[i]


@kernel("void(Guidance, vector, vector, f8[:])", Guidance=GUIDANCE)
def driving_force(config: np.record, smoothed_n: np.ndarray, centring_n: np.ndarray, out: np.ndarray) -> None:
    """Force (3,), N, that drives the base: f + c (f_s - f), c = clip(1 - |f_xy| / 2 gentle, 0, 1/2).

    Args:
        smoothed_n: (3,) f, of the estimate.
        centring_n: (3,) f_s, at which the hand would rest where it is.
    """
    size = math.hypot(smoothed_n[0], smoothed_n[1])
    share = clip(1.0 - size / (2.0 * config.gentle_n), 0.0, 0.5)
    for i in range(3):
        out[i] = smoothed_n[i] + share * (centring_n[i] - smoothed_n[i])


@kernel("void(Guidance, vector, vector, f8, State, Command)", Guidance=GUIDANCE, State=GUIDANCE_STATE, Command=COMMAND)
def _follow(
    config: Any,
    hand_position: np.ndarray,
    force_estimated_n: np.ndarray,
    dt_s: float,
    state: Any,
    command: Any,
) -> None:
    """Let one command follow the hand: the force is low-passed, the spring's rest position glides to the comfortable place."""
    newest = min(1.0, dt_s / config.smoothing_s)
    away, displacement, drive = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        state.force_n[i] += newest * (force_estimated_n[i] - state.force_n[i])
        away[i] = config.comfortable_m[i] - state.rest_m[i]
    distance = math.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
    step = min(1.0, config.glide_mps * dt_s / max(distance, 1e-12))
    for i in range(3):
        state.rest_m[i] += step * away[i]
        displacement[i] = hand_position[i] - state.rest_m[i]
        command.mask[i] = 1.0
        command.position_m[i] = hand_position[i]
    centring_force(config, displacement, command.force_n)
    driving_force(config, state.force_n, command.force_n, drive)
    base_velocity(config, drive, command.base_velocity)


@kernel(
    "void(Guidance[::1], i8[:], matrix, matrix, f8, State[::1], Command[::1])",
    Guidance=GUIDANCE,
    State=GUIDANCE_STATE,
    Command=COMMAND,
)
def follow_hands(
    config: np.ndarray,
    led: np.ndarray,
    hand_positions: np.ndarray,
    forces_estimated_n: np.ndarray,
    dt_s: float,
    states: np.ndarray,
    commands: np.ndarray,
) -> None:
    """Override mask, position, force and base velocity of commands whose hands are led, as Guidance does.

    Args:
        config: GUIDANCE (1,).
        led: (k,) which of the n robots.
        hand_positions: (n, 3) m, measured, in heading.
        forces_estimated_n: (n, 3) N, on the hands, in heading.
        dt_s: period of the caller.
        states: GUIDANCE_STATE (n,), moved on. Guidance starts without force and with the spring at rest at the hand.
        commands: COMMAND (n,).
    """
    for index in range(len(led)):
        robot = int(led[index])
        _follow(config[0], hand_positions[robot], forces_estimated_n[robot], dt_s, states[robot], commands[robot])


def guidance_record(config: GuidanceConfig) -> np.ndarray:
    """GuidanceConfig as a record GUIDANCE (1,) for kernels."""
    return packed(GUIDANCE, config, comfortable_m=DEFAULT_COMMAND.position_m)


class Guidance:
    """Overrides mask, force and base velocity of a command whose `guidance` is set; passes any other through."""

    STATE = ("_state", "_started")

    def __init__(self, config: GuidanceConfig) -> None:
        self.config = config
        self._gains = guidance_record(config)
        self.reset()

    def reset(self) -> None:
        """Forget the force history and the spring's rest position."""
        self._state = np.zeros(1, GUIDANCE_STATE)
        self._started = False

    def step(self, command: Command, hand: HandState, dt_s: float) -> Command:
        """The command that follows the led hand, or `command` itself when guidance is off.

        Args:
            command: as asked.
            hand: measured hand with the estimated force on it.
            dt_s: period of the caller.
        """
        if not command.guidance:
            if self._started:
                self.reset()
            return command
        if not self._started:
            self._started = True
            self._state["rest_m"] = hand.position_in_heading
        led = to_record(command)
        position, force = hand.position_in_heading[None], hand.force_estimated_n[None]
        follow_hands(self._gains, _FIRST, position, force, dt_s, self._state, led)
        return from_record(led, guidance=True)


_FIRST = np.zeros(1, np.int64)
