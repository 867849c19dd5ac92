"""Sources of external wrenches on the simulated bodies, each with its own life time. Forces act on the robot."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

FRAMES = ("world", "heading", "body")
"""In the order of sim.backends.simulation.pulses."""


@dataclass(frozen=True, slots=True)
class BodyState:
    """What a source may depend on. Vectors in world.

    Attributes:
        time_s, period_s: start and length of the tick that the wrench acts through.
        point: (3,) m, application point.
        velocity: (3,) m/s, of the body's material point there.
        rotation_body_to_world, rotation_heading_to_world: (3, 3).
        heading_origin: (3,) m, origin of the heading frame (on the ground below the base).
    """

    time_s: float
    period_s: float
    point: np.ndarray
    velocity: np.ndarray
    rotation_body_to_world: np.ndarray
    rotation_heading_to_world: np.ndarray
    heading_origin: np.ndarray


class WrenchSource(Protocol):
    """One contribution other than a Pulse. `body` names the body, `point_m` (3,) the application point in that body's frame."""

    @property
    def body(self) -> str: ...

    @property
    def point_m(self) -> np.ndarray: ...

    @property
    def duration_s(self) -> float:
        """Life time from the tick it was added; may be inf."""
        ...

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean force (3,) N and moment (3,) N m about the point over the tick that starts at `age_s`, both in world."""
        ...


def _vector(name: str, value: object) -> np.ndarray:
    array = np.array(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers, not {value}")
    array.setflags(write=False)
    return array


def _zero() -> np.ndarray:
    return np.zeros(3)


@dataclass(frozen=True)
class Pulse:
    """A scripted wrench: rises linearly over `ramp_s`, holds, and falls over `ramp_s`, all within `duration_s`.

    Its impulse is force * (duration_s - ramp_s), exactly: each tick gets the mean of the profile over that tick, so neither
    a duration between two ticks nor a short ramp loses any of it.

    Raises:
        ValueError: a vector is not three finite numbers, the frame is unknown, or the times do not fit.
    """

    force_n: np.ndarray
    duration_s: float
    torque_nm: np.ndarray = field(default_factory=_zero)
    point_m: np.ndarray = field(default_factory=_zero)
    body: str = "end_effector"
    frame: str = "heading"
    ramp_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("force_n", "torque_nm", "point_m"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        if self.frame not in FRAMES:
            raise ValueError(f"frame is {self.frame!r}; the frames are {', '.join(FRAMES)}")
        if not self.duration_s > 0:
            raise ValueError(f"duration_s is {self.duration_s}; it must be positive")
        if not 0 <= self.ramp_s <= 0.5 * self.duration_s:
            raise ValueError(f"ramp_s is {self.ramp_s}; the range is 0 to half of duration_s ({0.5 * self.duration_s})")

    def row(self, start_s: float, body: int) -> np.ndarray:
        """(ROW,) numbers for sim.backends.simulation.pulses, started at `start_s` on a body."""
        frame = FRAMES.index(self.frame)
        return np.array(
            [start_s, self.duration_s, self.ramp_s, frame, body, *self.force_n, *self.torque_nm, *self.point_m], dtype=float
        )


@dataclass(frozen=True)
class Spring:
    """Virtual spring-damper of the paper (Sec. II.E): f = Kp (x_d - x) - Kd v, per axis of the anchor's frame.

    With `frame` "world" the anchor is a fixed point; with "heading" it rides with the robot, and v is still the velocity in
    world, as in the paper. `limit_n` caps the length of the force: the operator's hand on the drag handle.

    Attributes:
        anchor_m: (3,) x_d in `frame`.
        stiffness, damping: (3,) N/m and N s/m, or one number for all axes.
    """

    anchor_m: np.ndarray
    stiffness: np.ndarray | float
    damping: np.ndarray | float
    body: str = "end_effector"
    point_m: np.ndarray = field(default_factory=_zero)
    frame: str = "world"
    duration_s: float = np.inf
    limit_n: float = np.inf

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            value = getattr(self, name)
            gains = _vector(name, value if np.ndim(value) else [value] * 3)
            if (gains < 0).any():
                raise ValueError(f"{name} is {value}; it must not be negative")
            object.__setattr__(self, name, gains)
        for name in ("anchor_m", "point_m"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        if self.frame not in ("world", "heading"):
            raise ValueError(f"frame is {self.frame!r}; the anchor is fixed in 'world' or rides in 'heading'")
        for name in ("duration_s", "limit_n"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be positive")

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """See WrenchSource."""
        if self.frame == "world":
            force = self.stiffness * (self.anchor_m - state.point) - self.damping * state.velocity
        else:
            rotation = state.rotation_heading_to_world
            error = self.anchor_m - (state.point - state.heading_origin) @ rotation
            force = rotation @ (self.stiffness * error - self.damping * (state.velocity @ rotation))
        length = float(np.sqrt(force @ force))
        if length > self.limit_n:
            force *= self.limit_n / length
        return force, np.zeros(3)
