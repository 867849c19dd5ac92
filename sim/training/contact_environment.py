"""What the hand touches in training: the paper's virtual spring-damper, eq. (23), and contacts that move.

Per force axis: a spring-damper whose anchor glides and swings, soft to as stiff as a contact; something with viscous and dry
friction that is dragged along; a person who leads the hand. Position axes get disturbances and pushes.
"""

from dataclasses import dataclass

import numpy as np

from sim.training.batch_rotations import cross, rotate, rotate_back
from sim.training.commands import FREE, LEAD, SLIDE, TOUCH, CommandSource
from sim.training.robot import TIMESTEP_S, BatchedRobot

HAND_INERTIA_KG = 0.5
"""Least inertia that a force on the hand feels, 0.4 kg across. Forces are renewed every 10 ms; taken implicitly
for this mass, stiff springs stay stable, at the price of being softer than asked."""

DRY_FRICTION_SPEED_MPS = 0.03
"""Below this speed dry friction gives way."""


@dataclass(frozen=True, slots=True)
class ContactRanges:
    """Attributes:
    stiffness: N/m, log-uniform; at least so stiff that the force asked for stretches it by `longest_stretch_m`.
    stiff: N/m, of what TOUCH and SLIDE segments press on.
    damping_ratio: damping over sqrt(stiffness).
    glide_s: time in which the anchor goes to where the force asked for holds the hand `glide_error_m` beside its reference.
    swing_share, swing_m, swing_hz: of anchors that swing.
    travel_m: amplitude by which the force of a SLIDE segment drags its object; gives its viscous friction.
    dry_n: its dry friction.
    fence_m, fence_stiffness: where a spring ends the travel.
    lead_mps, lead_stiffness, lead_damping: of a leading person.
    disturbance_share, disturbance_n: of segments with a constant force on position axes.
    push_share, push_n, push_s: of segments with a push, in any direction, and its length.
    limit_n: largest force on an axis.
    """

    stiffness: tuple[float, float] = (80.0, 1500.0)
    longest_stretch_m: float = 0.12
    stiff: tuple[float, float] = (1500.0, 3000.0)
    damping_ratio: tuple[float, float] = (0.2, 0.8)
    glide_s: tuple[float, float] = (1.0, 2.6)
    glide_error_m: float = 0.06
    swing_share: float = 0.3
    swing_m: float = 0.05
    swing_hz: tuple[float, float] = (0.1, 0.6)
    travel_m: tuple[float, float] = (0.06, 0.2)
    dry_n: tuple[float, float] = (0.0, 3.0)
    fence_m: float = 0.25
    fence_stiffness: float = 300.0
    lead_mps: float = 0.25
    lead_stiffness: float = 300.0
    lead_damping: float = 20.0
    disturbance_share: float = 0.3
    disturbance_n: float = 4.0
    push_share: float = 0.12
    push_n: float = 18.0
    push_s: tuple[float, float] = (0.2, 0.5)
    limit_n: float = 45.0


class ContactEnvironment:
    """Forces on the hands, from the state of the segments' start on."""

    def __init__(self, robot: BatchedRobot, source: CommandSource, ranges: ContactRanges, random: np.random.Generator) -> None:
        self._robot, self._source, self._ranges, self._random = robot, source, ranges, random
        count = robot.count
        self._stiffness, self._damping, self._viscous, self._dry, self._fence = _vectors(count, 5)
        self._friction = np.zeros((count, 3), order="F")
        self._origin, self._start, self._glide, self._swing, self._disturbance, self._push = _vectors(count, 6)
        self._rotation = np.asfortranarray(np.tile(np.eye(3), (count, 1, 1)))
        self._glide_s, self._swing_rate, self._rides = np.ones(count), np.zeros(count), np.zeros(count, bool)
        self._push_from, self._push_to = np.zeros(count), np.zeros(count)

    def draw(self, ids: np.ndarray) -> None:
        """New surroundings for segments that have just been drawn; springs start relaxed at the hand."""
        ranges, random, robot, source = self._ranges, self._random, self._robot, self._source
        count, mask, kind = len(ids), source.commands["mask"][ids], source.kind[ids]
        asked = source.constant_force[ids]
        largest = np.abs(asked) + source.wave_amplitude[ids]
        low, high = np.log(ranges.stiffness)
        stiffness = np.exp(random.uniform(low, high, (count, 3)))
        stiffness = np.maximum(stiffness, largest / ranges.longest_stretch_m)
        stiff = kind == TOUCH
        stiffness = np.where(stiff[:, None], random.uniform(*ranges.stiff, (count, 3)), stiffness)
        damping = random.uniform(*ranges.damping_ratio, (count, 1)) * np.sqrt(stiffness)
        leading = kind == LEAD
        stiffness[leading], damping[leading] = ranges.lead_stiffness, ranges.lead_damping
        stiffness, damping = stiffness * mask, damping * mask

        sliding = np.flatnonzero(kind == SLIDE)
        axis = source.slide_axis[ids[sliding]]
        viscous, dry, fence = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
        amplitude, rate = source.wave_amplitude[ids[sliding], axis], source.wave_rate[ids[sliding]]
        viscous[sliding, axis] = amplitude / (rate * random.uniform(*ranges.travel_m, len(sliding)))
        dry[sliding, axis] = random.uniform(*ranges.dry_n, len(sliding)) * (amplitude > 5.0)
        fence[sliding, axis] = ranges.fence_stiffness
        stiffness[sliding, axis] = damping[sliding, axis] = 0.0
        stiffness[sliding, 2] = random.uniform(*ranges.stiff, len(sliding))
        self._stiffness[ids], self._damping[ids] = stiffness, damping
        self._viscous[ids], self._dry[ids], self._fence[ids] = viscous, dry, fence
        self._friction[ids] = 0.0

        base, heading = robot.base_position[ids] * [1.0, 1.0, 0.0], robot.rotation_heading_to_world[ids]
        self._origin[ids], self._rotation[ids] = base, heading
        self._start[ids] = rotate_back(heading, robot.hand_position[ids] - base)
        self._rides[ids] = (np.abs(source.commands["base_velocity"][ids]).sum(axis=1) > 0.0) & ~leading
        glide = source.commands["position_m"][ids] - self._start[ids]
        glide += random.uniform(-1.0, 1.0, (count, 3)) * ranges.glide_error_m
        # Where the force asked for holds the hand beside its reference, so within its reach.
        glide += np.where(stiffness > 0.0, asked / np.maximum(stiffness, 1e-9), 0.0)
        glide[stiff | (kind == SLIDE)] = 0.0
        glide_s = random.uniform(*ranges.glide_s, count)
        angle = random.uniform(-np.pi, np.pi, count)
        led = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) * source.duration_s[ids, None]
        glide = np.where(leading[:, None], ranges.lead_mps * random.random((count, 1)) * led, glide)
        self._glide[ids] = glide
        self._glide_s[ids] = np.where(leading, source.duration_s[ids], glide_s)
        swings = (random.random(count) < ranges.swing_share) & ~stiff & (kind != SLIDE) & ~leading
        self._swing[ids] = swings[:, None] * random.uniform(0.0, ranges.swing_m, (count, 3))
        self._swing_rate[ids] = 2.0 * np.pi * random.uniform(*ranges.swing_hz, count)

        disturbed = (random.random((count, 1)) < ranges.disturbance_share) * (1.0 - mask)
        self._disturbance[ids] = disturbed * random.uniform(-1.0, 1.0, (count, 3)) * ranges.disturbance_n
        pushed = (random.random((count, 1)) < ranges.push_share) & (kind == FREE)[:, None]
        self._push[ids] = pushed * random.uniform(-1.0, 1.0, (count, 3)) * ranges.push_n
        self._push_from[ids] = random.uniform(0.3, 2.5, count)
        self._push_to[ids] = self._push_from[ids] + random.uniform(*ranges.push_s, count)

    def stiffness_of_force_axes(self) -> np.ndarray:
        """(n, 3) N/m; zero on position axes and where nothing springs back."""
        return self._stiffness

    def anchors(self) -> np.ndarray:
        """(n, 3) m, in heading: what springs pull the hand to; on axes without a spring, the reference of the hand."""
        robot = self._robot
        (origin, rotation), (anchor, _) = self._frame(), self._anchor()
        base = robot.base_position * [1.0, 1.0, 0.0]
        tied = rotate_back(robot.rotation_heading_to_world, origin + rotate(rotation, anchor) - base)
        return np.where(self._stiffness > 0.0, tied, self._source.commands["position_m"])

    def _frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Origin (n, 3) m and axes (n, 3, 3), to world, that the surroundings are given in."""
        robot, rides = self._robot, self._rides[:, None]
        origin = np.where(rides, robot.base_position * [1.0, 1.0, 0.0], self._origin)
        return origin, np.where(rides[:, :, None], robot.rotation_heading_to_world, self._rotation)

    def _anchor(self) -> tuple[np.ndarray, np.ndarray]:
        """Anchors (n, 3) m in their frame, and the share (n, 1) of their glide that is done."""
        time = self._source.time_s[:, None]
        share = np.minimum(1.0, time / self._glide_s[:, None])
        return self._start + share * self._glide + self._swing * np.sin(self._swing_rate[:, None] * time), share

    def force(self) -> np.ndarray:
        """Force (n, 3), N, in world, on every hand now."""
        ranges, robot, time = self._ranges, self._robot, self._source.time_s[:, None]
        rides = self._rides[:, None]
        origin, rotation = self._frame()
        # Something that rides along moves with the heading frame.
        turn = robot.base_angular_velocity * [0.0, 0.0, 1.0]
        carried = robot.base_linear_velocity * [1.0, 1.0, 0.0] + cross(
            turn, robot.hand_position - robot.base_position * [1.0, 1.0, 0.0]
        )
        velocity = rotate_back(rotation, robot.hand_velocity - rides * carried)
        ahead = rotate_back(rotation, robot.hand_position - origin) + TIMESTEP_S * velocity

        anchor, share = self._anchor()
        anchor_velocity = np.where(share < 1.0, self._glide / self._glide_s[:, None], 0.0)
        force = self._stiffness * (anchor - ahead) + self._damping * (anchor_velocity - velocity)
        travel = ahead - self._start
        beyond = travel - np.clip(travel, -ranges.fence_m, ranges.fence_m)
        # Dry friction as a damper that weakens with speed.
        drag = self._viscous + self._dry / np.maximum(np.abs(velocity), DRY_FRICTION_SPEED_MPS)
        force -= self._fence * beyond
        gain = self._damping + TIMESTEP_S * (self._stiffness + self._fence * (beyond != 0.0))
        force /= 1.0 + TIMESTEP_S / HAND_INERTIA_KG * gain
        # What drags is pushed on against its friction: taken implicitly about the last one, steady sliding meets all of it.
        self._friction += (-drag * velocity - self._friction) / (1.0 + TIMESTEP_S / HAND_INERTIA_KG * drag)
        force += self._friction
        push = (time >= self._push_from[:, None]) & (time < self._push_to[:, None])
        force += np.minimum(1.0, time / 0.5) * self._disturbance + push * self._push
        return rotate(rotation, np.clip(force, -ranges.limit_n, ranges.limit_n))


def _vectors(count: int, number: int) -> list[np.ndarray]:
    return [np.zeros((count, 3), order="F") for _ in range(number)]
