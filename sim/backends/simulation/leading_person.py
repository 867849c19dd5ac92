"""A person who leads the simulated hand for a while, in one direction after the other, and lets go between.

A lead is a spring and damper between the hand and a palm that walks away evenly, as in sim.trials.guidance_trials.
"""

from dataclasses import dataclass, field

import numpy as np

from sim.backends.simulation.wrenches import BodyState

LEAD_S, PAUSE_S = 3.5, 2.5
DISTANCE_M, SPEED_MPS = 0.5, 0.2
STIFFNESS, DAMPING = 300.0, 20.0
DIRECTIONS = 8
"""Of the heading frame, evenly around; a seed shuffles them and turns them by up to half a step."""


@dataclass(slots=True)
class LeadDone:
    """One lead: how far the hand came along it, m, and the largest force, N."""

    STATE = ("progress_m", "force_n")

    progress_m: float = 0.0
    force_n: float = 0.0


@dataclass(slots=True)
class LeadingPerson:
    """A source of wrenches, see sim.backends.simulation.wrenches.WrenchSource.

    Attributes:
        seed: shuffles the directions.
        duration_s: for which the person stays.
        leads: so far.
    """

    STATE = ("leads", "_start", "_direction")

    seed: int
    duration_s: float = 60.0
    body: str = "end_effector"
    point_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    leads: list[LeadDone] = field(default_factory=list)
    _angles: np.ndarray = field(init=False)
    _start: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _direction: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        random = np.random.default_rng([self.seed, 18])
        turn = random.uniform(-0.5, 0.5)
        self._angles = 2.0 * np.pi * (random.permutation(DIRECTIONS) + turn) / DIRECTIONS

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Force (3,) N in world on the hand, and no moment."""
        count, since_s = divmod(age_s - PAUSE_S, LEAD_S + PAUSE_S)
        if age_s < PAUSE_S or since_s > LEAD_S or age_s + LEAD_S - since_s > self.duration_s:
            return np.zeros(3), np.zeros(3)
        if len(self.leads) <= int(count):
            angle = self._angles[int(count) % DIRECTIONS]
            self._start = state.point.copy()
            self._direction = state.rotation_heading_to_world @ np.array([np.cos(angle), np.sin(angle), 0.0])
            self.leads.append(LeadDone())
        anchor = self._start + min(DISTANCE_M, SPEED_MPS * since_s) * self._direction
        force = STIFFNESS * (anchor - state.point) - DAMPING * state.velocity
        lead = self.leads[-1]
        lead.progress_m = max(lead.progress_m, float(self._direction @ (state.point - self._start)))
        lead.force_n = max(lead.force_n, float(np.linalg.norm(force)))
        return force, np.zeros(3)
