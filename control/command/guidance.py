"""Zero-force guidance: a hand leads the robot by its end effector.

All axes are force-controlled towards zero force, so the hand yields. The planar force that remains drives the base: its x
component rolls it forward or back, its y component turns it towards the pull. The end effector rides ahead of the wheels,
so turning moves it sideways, and together both let it follow any planar direction although the wheels cannot.
A soft centring force brings the hand back to a comfortable place before the base, so the base follows and the arm never
stretches out.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND, HandState
from control.types import Command


@dataclass(frozen=True, slots=True)
class GuidanceConfig:
    """Gains of the admittance from the led hand to the base.

    Attributes:
        dead_band_n: planar force below which the base rests; above the estimator's bias, so it does not drift.
        forward_gain: m/s per N of planar force beyond the dead band.
        yaw_gain: rad/s per N.
        forward_limit_mps, yaw_limit_rps: saturation.
        smoothing_s: time constant of the low-pass on the force.
        centring_stiffness: N/m of the soft spring near the comfortable place: 4 N at 10 cm.
        stretch_m: distance beyond which the spring stiffens.
        stretch_stiffness: N/m beyond it, so that 15 N stretch the arm by less than 20 cm.
        glide_mps: speed at which the spring's rest position moves from where guidance began to the comfortable place.
    """

    dead_band_n: float = 3.0
    forward_gain: float = 0.045
    yaw_gain: float = 0.09
    forward_limit_mps: float = 0.5
    yaw_limit_rps: float = 0.5
    smoothing_s: float = 0.08
    centring_stiffness: float = 40.0
    stretch_m: float = 0.10
    stretch_stiffness: float = 150.0
    glide_mps: float = 0.15


class Guidance:
    """Overrides mask, force and base velocity of a command whose `guidance` is set; passes any other through."""

    def __init__(self, config: GuidanceConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget the force history and the spring's rest position."""
        self._force: np.ndarray | None = None
        self._rest = DEFAULT_COMMAND.position_m

    def step(self, command: Command, hand: HandState, dt_s: float) -> Command:
        """The command that follows the led hand, or `command` itself when guidance is off.

        Args:
            command: as asked.
            hand: measured hand with the estimated force on it.
            dt_s: period of the caller.
        """
        if not command.guidance:
            self.reset()
            return command
        force = hand.force_estimated_n
        if self._force is None:
            self._force = np.zeros(3)
            self._rest = hand.position_in_heading
        self._force = self._force + min(1.0, dt_s / self.config.smoothing_s) * (force - self._force)
        self._rest = self._rest + _limited(DEFAULT_COMMAND.position_m - self._rest, self.config.glide_mps * dt_s)
        return replace(
            command,
            mask=np.ones(3),
            force_n=self.centring_force(hand.position_in_heading - self._rest),
            position_m=hand.position_in_heading,
            base_velocity=self.base_velocity(self._force),
        )

    def base_velocity(self, force: np.ndarray) -> np.ndarray:
        """Base velocity (3,) [m/s, 0, rad/s] for a smoothed force (3,), N, on the hand, heading frame."""
        config = self.config
        size = float(np.hypot(force[0], force[1]))
        excess = max(0.0, size - config.dead_band_n) / max(size, 1e-9)
        forward = np.clip(config.forward_gain * excess * force[0], -config.forward_limit_mps, config.forward_limit_mps)
        yaw = np.clip(config.yaw_gain * excess * force[1], -config.yaw_limit_rps, config.yaw_limit_rps)
        return np.array([forward, 0.0, yaw])

    def centring_force(self, displacement: np.ndarray) -> np.ndarray:
        """Force (3,), N, at which the hand rests when led by `displacement` (3,), m, from the spring's rest position."""
        config = self.config
        distance = float(np.linalg.norm(displacement))
        if distance <= config.stretch_m:
            return config.centring_stiffness * displacement
        size = config.centring_stiffness * config.stretch_m + config.stretch_stiffness * (distance - config.stretch_m)
        return size / distance * displacement


def _limited(vector: np.ndarray, length: float) -> np.ndarray:
    """`vector` shortened to at most `length`."""
    size = float(np.linalg.norm(vector))
    return vector if size <= length else length / size * vector
