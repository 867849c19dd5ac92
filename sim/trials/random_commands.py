"""Random whole-body commands on the full stack against virtual springs, judged by simulator truth."""

from dataclasses import dataclass, field

import numpy as np

from control.frames import rotation_from_quaternion
from control.joints import END_EFFECTOR_FRAME
from control.types import Command
from sim.backends.simulation.wrenches import Pulse
from sim.trials.random_segments import RandomSegments
from sim.trials.trial import Trial, TrialSetup

SWITCH_S = 1.0
"""Force errors count from here after a change of command: the force reference ramps for up to 0.8 s."""
SETTLE_S = 2.3
"""Position errors count from here: references arrive after up to 2 s."""


@dataclass(slots=True)
class Errors:
    """Errors of a random run, one entry per controller period: NaN where an axis is in the other mode.

    `force[mask, level]` (n, 3) N, `position` (n, 3) m, `orientation` (n,) rad, `forward` (n,) m/s, `yaw` (n,) rad/s,
    `estimate` (n, 3) N, `own` the same of the controller's own estimate, where it makes one, `power` (n,) W of all drives,
    `overshoot` N per axis that changed to force control: the largest error beyond the reference in its first second.
    """

    force: dict[tuple[str, float], list[np.ndarray]] = field(default_factory=dict)
    position: list[np.ndarray] = field(default_factory=list)
    orientation: list[float] = field(default_factory=list)
    forward: list[float] = field(default_factory=list)
    yaw: list[float] = field(default_factory=list)
    estimate: list[np.ndarray] = field(default_factory=list)
    own: list[np.ndarray] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    overshoot: list[float] = field(default_factory=list)
    falls: int = 0
    pushes: int = 0
    robot_minutes: float = 0.0

    def force_at(self, level_n: float) -> np.ndarray:
        """(n, 3) N, of all masks at a level."""
        parts = [errors for (_, level), errors in self.force.items() if level == level_n and errors]
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def add(self, other: "Errors") -> None:
        """Take in another run."""
        for key, errors in other.force.items():
            self.force.setdefault(key, []).extend(errors)
        for name in ("position", "orientation", "forward", "yaw", "estimate", "own", "power", "overshoot"):
            getattr(self, name).extend(getattr(other, name))
        self.falls += other.falls
        self.pushes += other.pushes
        self.robot_minutes += other.robot_minutes


def random_commands(setup: TrialSetup, seed: int, minutes: float, levels_n: tuple[float, ...] = (10.0, 20.0)) -> Errors:
    """Random commands against virtual springs for a time; after a fall the robot is put back on its wheels."""
    errors, random = Errors(), np.random.default_rng(seed + 1)
    segments = RandomSegments(seed, levels_n)
    trial, last_mask = Trial(setup, seed), np.zeros(3)
    while errors.robot_minutes < minutes:
        segment, level = segments.draw(trial.hand_in_heading)
        wrench = trial.session.backend.wrenches.add(segment.spring)
        if setup.push_n > 0.0:
            push = Pulse(random.uniform(-setup.push_n, setup.push_n, 3), duration_s=0.3, ramp_s=0.05)
            trial.session.backend.wrenches.add(push)
            errors.pushes += 1
        elapsed = _run_segment(trial, segment.command, segment.duration_s, level, last_mask, errors)
        errors.robot_minutes += elapsed / 60.0
        last_mask = segment.command.mask
        if trial.fallen:
            errors.falls += 1
            seed += 1
            trial, last_mask = Trial(setup, seed), np.zeros(3)
        else:
            trial.session.backend.wrenches.remove(wrench)
    return errors


def _run_segment(trial: Trial, command: Command, seconds: float, level: float, last_mask: np.ndarray, errors: Errors) -> float:
    on_force = command.mask > 0.5
    force = errors.force.setdefault(("".join(str(int(m)) for m in command.mask), level), [])
    target = rotation_from_quaternion(command.orientation_wxyz)
    beyond = np.zeros(3)
    elapsed = 0.0
    for elapsed in trial.run(command, seconds):
        truth, output = trial.truth, trial.session.output
        error = truth.force_true_n - command.force_n
        if elapsed <= SWITCH_S:
            applied = truth.force_true_n - output.applied_command.force_n
            beyond = np.maximum(beyond, np.abs(applied) * on_force * (last_mask < 0.5))
        else:
            force.append(np.where(on_force, error, np.nan))
            errors.estimate.append(output.hand.force_estimated_n - truth.force_true_n)
            if (own := trial.own_force_n) is not None:
                errors.own.append(own - truth.force_true_n)
            forward = truth.base_linear_velocity @ truth.rotation_heading_to_world[:, 0]
            errors.forward.append(float(forward - command.base_velocity[0]))
            errors.yaw.append(float(truth.base_angular_velocity[2] - command.base_velocity[2]))
            sensor = trial.session.backend.read()
            errors.power.append(float(np.abs(sensor.joint_torque * sensor.joint_velocity).sum()))
        if elapsed > SETTLE_S:
            errors.position.append(np.where(on_force, np.nan, trial.hand_in_heading - command.position_m))
            hand = trial.session.backend.data.site(END_EFFECTOR_FRAME).xmat.reshape(3, 3)
            turned = truth.rotation_heading_to_world.T @ hand
            cosine = 0.5 * (np.trace(target.T @ turned) - 1.0)
            errors.orientation.append(float(np.arccos(np.clip(cosine, -1.0, 1.0))))
        if trial.fallen:
            break
    errors.overshoot += [float(value) for value in beyond[on_force & (last_mask < 0.5)]]
    return elapsed


def rms(values: np.ndarray) -> float:
    """Root mean square over everything that is not NaN; NaN when nothing is left."""
    kept = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")


def settled_position_cm(errors: Errors) -> float:
    """RMS length of the settled position error over the position axes of each sample, cm; NaN without any."""
    position = np.array(errors.position)
    held = np.isfinite(position).any(axis=1) if position.size else np.zeros(0, bool)
    return 100.0 * rms(np.sqrt(np.nansum(position[held] ** 2, axis=1))) if held.any() else float("nan")
