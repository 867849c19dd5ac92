"""Pull trials: somebody pulls the hand of a robot that yields, constantly or in jerks, and lets go.

Judged by the simulator's truth; the robot sees its noisy sensors and its own estimates alone.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.types import Command
from sim.backends.simulation.wrenches import Pulse
from sim.trials.trial import Trial, TrialSetup

MODES: dict[str, Command] = {
    "guidance": replace(DEFAULT_COMMAND, guidance=True),
    "zero_force": replace(DEFAULT_COMMAND, mask=np.ones(3)),
}
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
"""(26, 3): along the axes, the edges and the diagonals of a cube, not normalised."""

SETTLE_S, INCLINE_S, PULL_S, AFTER_S = 1.0, 1.0, 4.0, 1.0
JERK_S, PAUSE_S = 0.6, 0.4


@dataclass(frozen=True, slots=True)
class Pull:
    """One pull.

    Attributes:
        setup: the robot.
        mode: of MODES.
        force_n: N, its size.
        direction: (3,) in heading, of any length.
        ramp_s: to the full force.
        jerky: on and off instead of held.
        seed: of the sensors, and of the direction in which the floor rises.
        slope_deg: of the floor.
    """

    setup: TrialSetup
    mode: str
    force_n: float
    direction: tuple[float, float, float]
    ramp_s: float
    jerky: bool
    seed: int
    slope_deg: float = 0.0

    def pulses(self) -> Iterator[tuple[float, Pulse]]:
        """When which force begins, s."""
        force = self.force_n * np.array(self.direction) / np.linalg.norm(self.direction)
        if not self.jerky:
            yield 0.0, Pulse(force, PULL_S, frame="world", ramp_s=self.ramp_s)
            return
        length = max(JERK_S, 2.0 * self.ramp_s)
        for start in np.arange(0.0, PULL_S, length + PAUSE_S):
            yield float(start), Pulse(force, length, frame="world", ramp_s=self.ramp_s)


@dataclass(frozen=True, slots=True)
class PullResult:
    """What a pull did to the robot.

    Attributes:
        fell: the robot lies, or its drives damp.
        tilt_deg: largest angle between the base's z axis and up.
        excursion_m: farthest that the hand came from where it was in the heading frame.
        outside_s: how long the hand was out of the workspace box.
        self_contact: arm, base and legs touched each other.
        estimate_rmse_n: of the force vector that the controller reads.
        flags: names of the limits and faults that were told.
    """

    fell: bool
    tilt_deg: float
    excursion_m: float
    outside_s: float
    self_contact: bool
    estimate_rmse_n: float
    flags: tuple[str, ...]


def incline(model: mujoco.MjModel, slope_rad: float, azimuth_rad: float) -> None:
    """Let the floor rise from the origin in a direction of the world, under whatever stands on it."""
    floor = model.geom("floor").id
    half = 0.5 * slope_rad
    model.geom_sameframe[floor] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE  # or MuJoCo would not look at its orientation
    model.geom_quat[floor] = [
        math.cos(half),
        math.sin(half) * math.sin(azimuth_rad),
        -math.sin(half) * math.cos(azimuth_rad),
        0.0,
    ]


def pull(trial_of: Pull) -> PullResult:
    """Pull a robot that has settled, and watch until a second after."""
    command = MODES[trial_of.mode]
    trial = Trial(trial_of.setup, trial_of.seed, settle_s=SETTLE_S)
    if trial_of.slope_deg != 0.0:
        azimuth = np.random.default_rng(trial_of.seed).uniform(-np.pi, np.pi)
        for elapsed in trial.run(command, INCLINE_S):
            incline(trial.session.backend.model, math.radians(trial_of.slope_deg) * elapsed / INCLINE_S, azimuth)
    for _ in trial.run(command, SETTLE_S):
        pass
    limits = trial.session.pipeline.config.limits
    box = np.array([limits.position_x_m, limits.position_y_m, limits.position_z_m]).T
    start, tilt, excursion, outside, touched, faults = trial.hand_in_heading, 0.0, 0.0, 0.0, False, Fault.NONE
    errors: list[float] = []
    pulses, elapsed = list(trial_of.pulses()), 0.0
    for elapsed in trial.run(command, PULL_S + AFTER_S):
        while pulses and pulses[0][0] <= elapsed:
            trial.session.backend.wrenches.add(pulses.pop(0)[1])
        w, x, y, z = trial.truth.base_orientation_wxyz
        tilt = max(tilt, math.degrees(math.acos(np.clip(w * w - x * x - y * y + z * z, -1.0, 1.0))))
        hand = trial.hand_in_heading
        excursion = max(excursion, float(np.linalg.norm(hand - start)))
        outside += 0.02 * bool((hand < box[0]).any() or (hand > box[1]).any())
        touched |= trial.session.backend.touches_itself()
        output = trial.session.output
        faults |= output.safety.faults
        errors.append(float(np.sum((output.hand.force_estimated_n - trial.truth.force_true_n) ** 2)))
        if trial.fallen:
            break
    flags = tuple(str(fault.name) for fault in faults)
    return PullResult(trial.fallen, tilt, excursion, outside, touched, float(np.sqrt(np.mean(errors))), flags)
