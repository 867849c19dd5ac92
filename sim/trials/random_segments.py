"""Random segments: a whole-body command, and the virtual spring that answers it on force axes."""

from dataclasses import dataclass, field

import numpy as np

from control.frames import quaternion_from_rotation
from control.joints import ARM_SLICE, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.types import Command
from sim.backends.simulation.wrenches import BodyState

_ARM_LOWER = (-0.6, 0.7, -2.5, -1.1, -0.5, -0.4)
_ARM_UPPER = (0.6, 2.3, -0.8, 1.1, 0.5, 0.4)
_HAND_LOWER = (0.42, -0.25, 0.25)
_HAND_UPPER = (0.72, 0.25, 0.75)
_PITCH_RANGE = (-0.4, 1.2)


@dataclass(slots=True)
class MovingSpring:
    """Virtual spring-damper, eq. (23), per axis, whose anchor glides from the hand to a new place.

    With `rides` the anchor keeps to the heading frame while the robot drives, and damping acts on the velocity relative to it.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    start_in_heading: np.ndarray
    glide: np.ndarray
    glide_s: float
    rides: bool
    body: str = "end_effector"
    point_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    duration_s: float = np.inf
    _origin: np.ndarray | None = None
    _rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    _last_position: np.ndarray | None = None

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Force (3,) N in world and no moment, see sim.backends.simulation.wrenches.WrenchSource."""
        if self._origin is None or self.rides:
            self._origin, self._rotation = state.heading_origin, state.rotation_heading_to_world
        position = (state.point - self._origin) @ self._rotation
        velocity = state.velocity @ self._rotation
        if self.rides:
            last = position if self._last_position is None else self._last_position
            velocity = (position - last) / state.period_s
            self._last_position = position
        anchor = self.start_in_heading + min(1.0, age_s / self.glide_s) * self.glide
        force = self.stiffness * (anchor - position) - self.damping * velocity
        return self._rotation @ force, np.zeros(3)


@dataclass(frozen=True, slots=True)
class Segment:
    """A command, the spring that answers it on force axes, and how long both last."""

    command: Command
    spring: MovingSpring
    duration_s: float


class RandomSegments:
    """Draws segments: reachable hand poses, all masks, forces of +-level, driving and turning."""

    def __init__(self, seed: int, levels_n: tuple[float, ...]) -> None:
        self._random = np.random.default_rng(seed)
        self._levels_n = levels_n
        self._positions, self._orientations = reachable_hands(self._random, 400)

    def draw(self, hand_in_heading: np.ndarray) -> tuple[Segment, float]:
        """The next segment from the hand's present place (3,), and its force level, N."""
        random = self._random
        velocity = np.zeros(3)
        if random.random() < 0.65:
            velocity[0] = random.uniform(-0.5, 0.5)
            velocity[2] = random.uniform(-0.45, 0.45) * (random.random() < 0.7)
        kind = random.random()
        mask = (random.random(3) < 0.5).astype(float) if 0.4 < kind < 0.85 else np.full(3, float(kind >= 0.85))
        level = float(random.choice(self._levels_n))
        force = level * random.choice([-1.0, 1.0], 3) * mask
        stiffness = np.maximum(np.exp(random.uniform(np.log(80.0), np.log(1500.0), 3)), np.abs(force) / 0.12) * mask
        index = random.integers(len(self._positions))
        target = self._positions[index]
        # Where the force asked for holds the hand beside the target, so within its reach.
        stretch = force / np.maximum(stiffness, 1e-9)
        command = Command(mask, force, target, self._orientations[index], velocity)
        spring = MovingSpring(
            stiffness=stiffness,
            damping=random.uniform(0.2, 0.8) * np.sqrt(stiffness),
            start_in_heading=hand_in_heading,
            glide=target + random.uniform(-0.06, 0.06, 3) + stretch - hand_in_heading,
            glide_s=1.3 * random.uniform(0.8, 2.0),
            rides=bool(velocity.any()),
        )
        return Segment(command, spring, float(random.uniform(3.0, 5.0))), level


def reachable_hands(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Hand positions (n, 3) m and orientations (n, 4) wxyz in heading that random arm postures reach in the stance."""
    model = RobotModel()
    posture = NOMINAL_POSITION.copy()
    positions, orientations = [], []
    while len(positions) < count:
        posture[ARM_SLICE] = random.uniform(_ARM_LOWER, _ARM_UPPER)
        model.update_configuration(np.eye(3), posture)
        position = model.end_effector_position + np.array([0.0, 0.0, NOMINAL_BASE_HEIGHT_M])
        rotation = model.end_effector_rotation
        pitch = np.arcsin(-rotation[2, 0])
        if np.all((position > _HAND_LOWER) & (position < _HAND_UPPER)) and _PITCH_RANGE[0] < pitch < _PITCH_RANGE[1]:
            positions.append(position)
            orientations.append(quaternion_from_rotation(rotation))
    return np.array(positions), np.array(orientations)
