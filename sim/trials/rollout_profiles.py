"""What happens in a rollout: the force on the end effector over time, and the commands that move base and arm.

Force profiles, each with its own rms force and rms slope (published in every data set's manifest):
    hold: random directions, quick smooth changes (0.3-1 s), then held 1-3 s.
    sine: three sines per axis, 0.05-0.5 Hz.
    slow: three sines per axis, 0.02-0.12 Hz.
    spring: a soft or stiff spring to a point near the hand that comes and goes: a force that answers motion, as contact does.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.frames import quaternion_multiply
from control.types import Command
from sim.backends.simulation.wrenches import BodyState, Spring

FORCE_LIMIT_N = 30.0
HORIZONTAL_LIMIT_N = 20.0
"""Sideways the wheels stand on a narrow track, and forward they only roll: beyond this the robot is pushed over or away."""

PROFILES = ("hold", "sine", "slow", "spring")
START_RAMP_S = 1.0


def sampled_force(profile: str, random: np.random.Generator, duration_s: float, period_s: float) -> np.ndarray:
    """Force (steps, 3) N in heading over time, zero at the start, at most FORCE_LIMIT_N long.

    Raises:
        ValueError: the profile is not one that is known beforehand ("spring" is not, it depends on the motion).
    """
    steps = round(duration_s / period_s)
    if profile == "hold":
        force = _hold(random, steps, period_s)
    elif profile == "sine":
        force = _sines(random, steps, period_s, 0.05, 0.5)
    elif profile == "slow":
        force = _sines(random, steps, period_s, 0.02, 0.12)
    else:
        raise ValueError(f"no sampled force profile {profile!r}; there are hold, sine and slow")
    return _limited(force)


@dataclass(frozen=True)
class SampledForce:
    """A force in heading at the end effector, one sample per tick; implements sim.backends.simulation.wrenches.WrenchSource.

    Attributes:
        samples: (steps, 3) N.
        period_s: between samples.
    """

    samples: np.ndarray
    period_s: float
    body: str = "end_effector"
    point_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def duration_s(self) -> float:
        """Life time."""
        return len(self.samples) * self.period_s

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Force and zero moment, in world."""
        index = min(round(age_s / self.period_s), len(self.samples) - 1)
        return state.rotation_heading_to_world @ self.samples[index], np.zeros(3)


def random_spring(random: np.random.Generator, hand_in_world: np.ndarray, duration_s: float, offset_m: np.ndarray) -> Spring:
    """A spring to a point 1-15 cm from the hand, 100-3000 N/m, lightly to well damped, capped at a random force.

    It acts `offset_m` (3,) m from the hand's modelled point, in the hand's axes.
    """
    stiffness = float(np.exp(random.uniform(np.log(100.0), np.log(3000.0))))
    direction = _direction(random)
    distance = min(random.uniform(0.01, 0.15), FORCE_LIMIT_N / stiffness)
    return Spring(
        anchor_m=hand_in_world + distance * direction,
        stiffness=stiffness,
        damping=random.uniform(0.1, 1.0) * np.sqrt(stiffness),
        point_m=offset_m,
        duration_s=duration_s,
        limit_n=random.uniform(5.0, HORIZONTAL_LIMIT_N),
    )


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """Ranges of the random commands; position around the default hand, heading frame.

    Attributes:
        position_half_range_m: (3,) of the hand around its default.
        orientation_half_range_rad: (3,) about heading x, y, z.
        base_velocity_limit: (3,) m/s, m/s, rad/s.
        hand_interval_s, base_interval_s: time between changes.
        still_share: share of intervals in which the base, or the hand, stays.
        force_mode_share: share of hand intervals with one axis under force control at zero desired force. Only for forces
            that yield when the hand gives way: any other would push it to the end of its reach.
    """

    position_half_range_m: tuple[float, float, float] = (0.10, 0.22, 0.18)
    orientation_half_range_rad: tuple[float, float, float] = (0.4, 0.25, 0.5)
    base_velocity_limit: tuple[float, float, float] = (0.6, 0.1, 0.5)
    hand_interval_s: tuple[float, float] = (1.3, 4.0)
    base_interval_s: tuple[float, float] = (1.0, 4.0)
    still_share: float = 0.2
    force_mode_share: float = 0.0


class RandomMotion:
    """Commands that change at random times. Position control, except for the intervals in force mode."""

    def __init__(self, config: MotionConfig, random: np.random.Generator) -> None:
        self._config = config
        self._random = random
        self._command = DEFAULT_COMMAND
        self._next_hand_s = self._next_base_s = 0.5

    def step(self, time_s: float) -> Command:
        """The command at `time_s`, which must not go back."""
        if time_s >= self._next_hand_s:
            self._next_hand_s = time_s + self._random.uniform(*self._config.hand_interval_s)
            self._change_hand()
        if time_s >= self._next_base_s:
            self._next_base_s = time_s + self._random.uniform(*self._config.base_interval_s)
            self._change_base()
        return self._command

    def _change_hand(self) -> None:
        config, random = self._config, self._random
        mask = np.zeros(3)
        if random.random() < config.force_mode_share:
            mask[random.integers(3)] = 1.0
        self._command = replace(self._command, mask=mask)
        if random.random() < config.still_share:
            return
        offset = np.array(config.position_half_range_m) * random.uniform(-1.0, 1.0, 3)
        half = 0.5 * np.array(config.orientation_half_range_rad) * random.uniform(-1.0, 1.0, 3)
        turn = np.array([1.0, *half]) / np.sqrt(1.0 + half @ half)
        self._command = replace(
            self._command,
            position_m=DEFAULT_COMMAND.position_m + offset,
            orientation_wxyz=quaternion_multiply(turn, DEFAULT_COMMAND.orientation_wxyz),
        )

    def _change_base(self) -> None:
        random = self._random
        velocity = np.zeros(3)
        if random.random() >= self._config.still_share:
            velocity = np.array(self._config.base_velocity_limit) * random.uniform(-1.0, 1.0, 3)
        self._command = replace(self._command, base_velocity=velocity)


def rms_force(force: np.ndarray) -> float:
    """Root mean square length of a force (steps, 3), N."""
    return float(np.sqrt((force * force).sum(axis=1).mean()))


def rms_slope(force: np.ndarray, period_s: float) -> float:
    """Root mean square length of the derivative of a force (steps, 3), N/s."""
    return rms_force(np.diff(force, axis=0) / period_s)


def _hold(random: np.random.Generator, steps: int, period_s: float) -> np.ndarray:
    force = np.zeros((steps, 3))
    step, current = round(0.5 / period_s), np.zeros(3)
    while step < steps:
        target = np.zeros(3) if random.random() < 0.2 else random.uniform(3.0, FORCE_LIMIT_N) * _direction(random)
        target = _limited(target)
        ramp = round(random.uniform(0.3, 1.0) / period_s)
        hold = round(random.uniform(1.0, 3.0) / period_s)
        s = np.linspace(0.0, 1.0, ramp)[:, None]
        change = current + (target - current) * (s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        room = force[step : step + ramp]
        room[:] = change[: len(room)]
        force[step + ramp : step + ramp + hold] = target
        step += ramp + hold
        current = target
    return force


def _sines(random: np.random.Generator, steps: int, period_s: float, low_hz: float, high_hz: float) -> np.ndarray:
    time = np.arange(steps)[:, None, None] * period_s
    amplitude, phase = random.uniform(2.0, 8.0, (3, 3)), random.uniform(0.0, 2.0 * np.pi, (3, 3))
    frequency = random.uniform(low_hz, high_hz, (3, 3))
    force = (amplitude * np.sin(2.0 * np.pi * frequency * time + phase)).sum(axis=2)
    return force * np.minimum(time[:, :, 0] / START_RAMP_S, 1.0)


def _limited(force: np.ndarray) -> np.ndarray:
    """Shortened, where needed, to HORIZONTAL_LIMIT_N across and FORCE_LIMIT_N in all; (..., 3)."""
    force = np.array(force)
    across = np.sqrt((force[..., :2] ** 2).sum(axis=-1, keepdims=True))
    force[..., :2] *= np.minimum(1.0, HORIZONTAL_LIMIT_N / np.maximum(across, 1e-9))
    length = np.sqrt((force**2).sum(axis=-1, keepdims=True))
    return force * np.minimum(1.0, FORCE_LIMIT_N / np.maximum(length, 1e-9))


def _direction(random: np.random.Generator) -> np.ndarray:
    vector = random.standard_normal(3)
    return vector / np.linalg.norm(vector)
