"""Trust trials: a robot that nobody touches, drives about, presses on a box, or is pulled with its wrist at its end.

Judged by the simulator's truth; the robot sees its noisy sensors and its own estimates alone.
"""

import math
from dataclasses import replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.mistrust import EstimatorFlag
from sim.backends.protocol import GroundTruth
from sim.backends.simulation.wrenches import Pulse
from sim.trials.pull import DIRECTIONS
from sim.trials.trial import Trial, TrialSetup

SETTLE_S = 5.0
STOP_PULL_N, STOP_PULL_S, STOP_TURN_RAD = 20.0, 4.0, 1.4
PRESS_N, PRESS_SETTLE_S = 15.0, 4.0
ZERO_FORCE = replace(DEFAULT_COMMAND, mask=np.ones(3))

Metrics = dict[str, tuple[float, str]]
"""Value and unit by name."""


def untouched(setup: TrialSetup, seed: int, seconds: float) -> Metrics:
    """How far the hand wanders in the heading frame with every axis on force at 0 N."""
    trial = Trial(setup, seed)
    start = trial.hand_in_heading
    farthest = max(float(np.linalg.norm(trial.hand_in_heading - start)) for _ in trial.run(ZERO_FORCE, seconds))
    return {"hand wanders": (100.0 * farthest, "cm"), "falls": (float(trial.fallen), "1")}


def at_rest(setup: TrialSetup, seed: int, seconds: float) -> Metrics:
    """The largest component of the base velocity that is told of a robot that stands."""
    trial = Trial(setup, seed, settle_s=SETTLE_S)
    speeds = [np.abs(trial.session.output.base.linear_velocity_in_base).max() for _ in trial.run(DEFAULT_COMMAND, seconds)]
    return {"base velocity told": (float(max(speeds)), "m/s")}


def driven(setup: TrialSetup, seed: int, way_m: float) -> Metrics:
    """Error of the odometry after a way of random velocities and turns, of two seconds each."""
    random, trial = np.random.default_rng(seed), Trial(setup, seed, settle_s=SETTLE_S)
    start, told_start = trial.truth, trial.session.output.odometry
    last, way, turned = start, 0.0, 0.0
    while way < way_m:
        command = replace(DEFAULT_COMMAND, base_velocity=np.array([random.uniform(-0.6, 0.6), 0.0, random.uniform(-0.8, 0.8)]))
        for _ in trial.run(command, 2.0):
            truth = trial.truth
            turned += math.remainder(_yaw(truth) - _yaw(last), math.tau)
            way += float(np.linalg.norm((truth.base_position - last.base_position)[:2]))
            last = truth
    odometry = trial.session.output.odometry
    # Both ways along the axes of the heading at the start: the odometry's frame is older than that.
    c, s = math.cos(told_start.yaw_rad), math.sin(told_start.yaw_rad)
    told = (odometry.position_m - told_start.position_m) @ np.array([[c, -s], [s, c]])
    true = (last.base_position - start.base_position)[:2] @ start.rotation_heading_to_world[:2, :2]
    return {
        "odometry error over way": (100.0 * float(np.linalg.norm(told - true)) / way, "%"),
        "odometry yaw error": (math.degrees(abs(odometry.yaw_rad - told_start.yaw_rad - turned)), "deg"),
        "falls": (float(trial.fallen), "1"),
    }


def pressed(setup: TrialSetup, seed: int, seconds: float) -> Metrics:
    """Force on the axes that hold their position while the hand presses down on the box."""
    trial = Trial(setup, seed, scene="box")
    command = replace(DEFAULT_COMMAND, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, PRESS_N]))
    forces = [trial.truth.force_true_n for elapsed in trial.run(command, PRESS_SETTLE_S + seconds) if elapsed > PRESS_SETTLE_S]
    return {
        "largest force on still axes": (float(np.abs(forces)[:, :2].max()), "N"),
        "pressing force, mean": (float(np.mean(forces, axis=0)[2]), "N"),
    }


def pulled_at_stop(setup: TrialSetup, seed: int, direction: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the hand force and sigma, both (n, 3) N, while JOINT_AT_STOP is told: a wrist turned into its end, and a pull.

    Args:
        direction: of `pull.DIRECTIONS`.
    """
    trial, axis = Trial(setup, seed), np.random.default_rng(seed).normal(size=3)
    half = 0.5 * STOP_TURN_RAD
    turned = np.concatenate([[math.cos(half)], math.sin(half) * axis / np.linalg.norm(axis)])
    command = replace(ZERO_FORCE, orientation_wxyz=turned)
    for _ in trial.run(command, 3.0):
        pass
    along = DIRECTIONS[direction] / np.linalg.norm(DIRECTIONS[direction])
    trial.session.backend.wrenches.add(Pulse(STOP_PULL_N * along, STOP_PULL_S, frame="world", ramp_s=0.5))
    errors, sigmas = [], []
    for _ in trial.run(command, STOP_PULL_S + 1.0):
        output = trial.session.output
        sigma = output.estimates[setup.estimator].sigma_n
        if EstimatorFlag.JOINT_AT_STOP in output.estimator_flags and sigma is not None:
            errors.append(output.hand.force_estimated_n - trial.truth.force_true_n)
            sigmas.append(sigma)
    return np.reshape(errors, (-1, 3)), np.reshape(sigmas, (-1, 3))


def _yaw(truth: GroundTruth) -> float:
    return math.atan2(truth.rotation_heading_to_world[1, 0], truth.rotation_heading_to_world[0, 0])
