"""Random whole-body commands of the training batch, in segments of a few seconds: the curriculum of tasks."""

from dataclasses import dataclass

import numpy as np

from control.command.command_record import commands
from control.command.guidance import GUIDANCE_STATE, GuidanceConfig, follow_hands, guidance_record
from sim.trials.random_segments import reachable_hands

FREE, FORCE, TOUCH, SLIDE, LEAD = range(5)
"""Kinds of segment: no force axis; force axes against springs that move; against something stiff that does not, like a table;
dragging something; a person leads the hand."""


@dataclass(frozen=True, slots=True)
class CommandRanges:
    """Attributes:
    segment_s: length of a segment.
    stand_share: of segments with the base at rest; of the others, `turn_share` also turn.
    forward_mps, yaw_rps: base velocity.
    kind_shares: of FREE, FORCE, TOUCH, SLIDE and LEAD segments.
    all_axes_share: of segments with force axes that have every axis on force.
    force_n: largest force of an axis; `no_force_share` of axes ask for zero.
    wave_share: of FORCE and TOUCH segments whose force also swings by up to `wave_part` of force_n.
    wave_hz: its frequency.
    slide_force_n, slide_hz: amplitude and frequency of the lateral force that drags in SLIDE segments.
    press_n: downward force on what is dragged.
    touch_reach_m: how far, per axis, TOUCH segments go along what they touch.
    hands: number of reachable poses to draw from.
    """

    segment_s: tuple[float, float] = (3.0, 5.0)
    stand_share: float = 0.35
    turn_share: float = 0.7
    forward_mps: tuple[float, float] = (-0.55, 0.55)
    yaw_rps: tuple[float, float] = (-0.5, 0.5)
    kind_shares: tuple[float, ...] = (0.2, 0.3, 0.1, 0.28, 0.12)
    all_axes_share: float = 0.25
    force_n: float = 25.0
    no_force_share: float = 0.15
    wave_share: float = 0.3
    wave_part: float = 0.4
    wave_hz: tuple[float, float] = (0.1, 0.5)
    slide_force_n: tuple[float, float] = (3.0, 12.0)
    slide_hz: tuple[float, float] = (0.15, 0.5)
    press_n: tuple[float, float] = (5.0, 25.0)
    touch_reach_m: float = 0.08
    hands: int = 1500


class CommandSource:
    """Draws segments and says what is asked now.

    Attributes:
        kind: (n,) of the segment. time_s, duration_s: (n,) since its start, and its length.
        commands: COMMAND (n,), what is asked. slide_axis: (n,) 0 x or 1 y, of SLIDE segments.
        constant_force: (n, 3) N, that the force asked for swings about.
        wave_amplitude: (n, 3) N, wave_rate: (n,) rad/s, of the swinging force.
    """

    def __init__(self, count: int, ranges: CommandRanges, random: np.random.Generator) -> None:
        self._ranges, self._random = ranges, random
        self._positions, self._orientations = reachable_hands(random, ranges.hands)
        self.commands = commands(count)
        self.kind = np.zeros(count, int)
        self.slide_axis = np.ones(count, int)
        self.time_s, self.duration_s = np.zeros(count), np.ones(count)
        self.wave_amplitude, self.wave_rate = np.zeros((count, 3), order="F"), np.zeros(count)
        self.constant_force = np.zeros((count, 3), order="F")
        self._guidance = guidance_record(GuidanceConfig())
        self._led = np.zeros(count, GUIDANCE_STATE)

    def draw(self, ids: np.ndarray, hand_position: np.ndarray, hand_orientation: np.ndarray) -> None:
        """Start new segments of robots `ids` (m,), whose hands are at (m, 3) m, (m, 4) wxyz in heading."""
        ranges, random, asked, count = self._ranges, self._random, self.commands, len(ids)
        self.time_s[ids] = 0.0
        self.duration_s[ids] = random.uniform(*ranges.segment_s, count)
        kind = random.choice(len(ranges.kind_shares), count, p=ranges.kind_shares)
        self.kind[ids] = kind

        velocity = np.zeros((count, 3))
        moving = (random.random(count) > ranges.stand_share) & ((kind == FREE) | (kind == FORCE))
        velocity[:, 0] = moving * random.uniform(*ranges.forward_mps, count)
        velocity[:, 2] = moving * (random.random(count) < ranges.turn_share) * random.uniform(*ranges.yaw_rps, count)
        asked["base_velocity"][ids] = velocity

        chosen = random.integers(len(self._positions), size=count)
        # What is touched or dragged, and who leads, is where the hand is, and a hand that is held cannot reach any pose.
        stays = ((kind == TOUCH) | (kind == SLIDE) | (kind == LEAD))[:, None]
        beside = hand_position + random.uniform(-1.0, 1.0, (count, 3)) * ranges.touch_reach_m * (kind == TOUCH)[:, None]
        asked["position_m"][ids] = np.where(stays, beside, self._positions[chosen])
        asked["orientation_wxyz"][ids] = np.where(stays, hand_orientation, self._orientations[chosen])

        some = (random.random((count, 3)) < 0.5).astype(float)
        mask = np.where(random.random((count, 1)) < ranges.all_axes_share, 1.0, some)
        axis = random.integers(2, size=count)
        sliding = np.zeros((count, 3))
        sliding[:, 2] = 1.0
        sliding[np.arange(count), axis] = 1.0
        mask = np.where((kind == SLIDE)[:, None], sliding, mask)
        mask[kind == FREE], mask[kind == LEAD] = 0.0, 1.0
        asked["mask"][ids], self.slide_axis[ids] = mask, axis

        force = random.uniform(-ranges.force_n, ranges.force_n, (count, 3)) * mask
        force[random.random((count, 3)) < ranges.no_force_share] = 0.0
        amplitude = ranges.wave_part * ranges.force_n * random.random((count, 3)) * mask
        amplitude *= (random.random((count, 1)) < ranges.wave_share) & ((kind == FORCE) | (kind == TOUCH))[:, None]
        rate = 2.0 * np.pi * random.uniform(*ranges.wave_hz, count)
        slides = np.flatnonzero(kind == SLIDE)
        force[slides, axis[slides]] = 0.0
        force[slides, 2] = random.uniform(*ranges.press_n, len(slides))
        amplitude[slides] = 0.0
        amplitude[slides, axis[slides]] = random.uniform(*ranges.slide_force_n, len(slides))
        rate[slides] = 2.0 * np.pi * random.uniform(*ranges.slide_hz, len(slides))
        self._led["force_n"][ids], self._led["rest_m"][ids] = 0.0, hand_position
        self.constant_force[ids], self.wave_amplitude[ids], self.wave_rate[ids] = force, amplitude, rate

    def advance(self, hand_position: np.ndarray, force_estimated_n: np.ndarray, dt_s: float) -> None:
        """Time passes: swinging forces move on, led robots follow (control.command.guidance).

        Args:
            hand_position: (n, 3) m, measured, in heading.
            force_estimated_n: (n, 3) N, estimated, in heading.
            dt_s: control period.
        """
        self.time_s += dt_s
        # A cosine, so that what is dragged swings about where the hand began.
        wave = np.cos(self.wave_rate * self.time_s)[:, None]
        self.commands["force_n"] = self.constant_force + self.wave_amplitude * wave
        led = np.flatnonzero(self.kind == LEAD)
        follow_hands(self._guidance, led, hand_position, force_estimated_n, dt_s, self._led, self.commands)
