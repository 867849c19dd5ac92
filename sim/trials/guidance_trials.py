"""Guidance trials: a hand leads the robot's hand half a metre and lets go; or nobody leads, and the robot should stay.

Judged by the simulator's truth; the robot sees its noisy sensors and its own estimates alone.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from sim.backends.simulation.wrenches import BodyState
from sim.trials.trial import Trial


@dataclass(slots=True)
class Lead:
    """A person's hand: a spring-damper whose anchor walks a distance in a direction of the world, then waits."""

    direction: np.ndarray
    start: np.ndarray
    distance_m: float = 0.55
    speed_mps: float = 0.2
    stiffness: float = 300.0
    damping: float = 20.0
    body: str = "end_effector"
    point_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    duration_s: float = np.inf
    largest_force_n: float = 0.0

    def wrench(self, state: BodyState, age_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Force (3,) N in world and no moment, see sim.backends.simulation.wrenches.WrenchSource."""
        anchor = self.start + min(self.distance_m, self.speed_mps * age_s) * self.direction
        force = self.stiffness * (anchor - state.point) - self.damping * state.velocity
        self.largest_force_n = max(self.largest_force_n, float(np.linalg.norm(force)))
        return force, np.zeros(3)


@dataclass(frozen=True, slots=True)
class LeadResult:
    """What one lead achieved; distances in m, times in s."""

    hand_progress_m: float
    base_travel_m: float
    largest_force_n: float
    stretch_m: float
    stop_s: float
    fallen: bool


GUIDED = replace(DEFAULT_COMMAND, guidance=True)


def lead(trial: Trial, angle_rad: float) -> LeadResult:
    """Lead the hand of a fresh trial half a metre in a direction of the heading frame, let go, and see the robot stop."""
    for _ in trial.run(GUIDED, 1.5):
        pass
    base, hand = trial.truth.base_position.copy(), trial.truth.end_effector_position.copy()
    hand_in_heading = trial.hand_in_heading
    direction = trial.truth.rotation_heading_to_world @ np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    person = Lead(direction, hand)
    wrench = trial.session.backend.wrenches.add(person)
    stretch = 0.0
    for _ in trial.run(GUIDED, person.distance_m / person.speed_mps + 2.0):
        stretch = max(stretch, float(np.linalg.norm(trial.hand_in_heading - hand_in_heading)))
    progress = float(direction @ (trial.truth.end_effector_position - hand))
    travel = float(np.linalg.norm((trial.truth.base_position - base)[:2]))
    trial.session.backend.wrenches.remove(wrench)
    stop = 0.0
    for elapsed in trial.run(GUIDED, 3.0):
        truth = trial.truth
        speed = float(np.linalg.norm(truth.base_linear_velocity[:2]))
        if speed > 0.03 or abs(truth.base_angular_velocity[2]) > 0.06:
            stop = elapsed
    return LeadResult(progress, travel, person.largest_force_n, stretch, stop, trial.fallen)


def rest_drift(trial: Trial, seconds: float) -> tuple[float, float]:
    """Drift of the base (m) and of the hand in the heading frame (m) while guided by nobody, after 2 s to settle."""
    for _ in trial.run(GUIDED, 2.0):
        pass
    base, hand = trial.truth.base_position.copy(), trial.hand_in_heading
    for _ in trial.run(GUIDED, seconds):
        pass
    drift = float(np.linalg.norm((trial.truth.base_position - base)[:2]))
    return drift, float(np.linalg.norm(trial.hand_in_heading - hand))
