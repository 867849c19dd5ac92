"""Throughput of policy training: the environment and the whole PPO loop beside the bare physics batch, in one run.

    python -m sim.benchmarks.training [--quick] [--count N] [--json PATH]

CPU time of one thread, so that other work on the machine counts less; the bars are ratios to bare `mujoco.batch`. Turns of
the three alternate on the same robots, which a policy of the residual form keeps standing and driving. The bare turn repeats
the physics steps of an environment turn, from the same states and alone: what a step costs depends on what the robots do.
"""

import sys
import time
from collections.abc import Callable
from unittest.mock import patch

import numpy as np
import torch

from control.joints import JOINT_COUNT
from control.learning.policy.ppo import PpoConfig
from sim.benchmarks.report import Report, Row, argument_parser, at_least
from sim.training.env import TrainingEnv, TrainingEnvConfig
from sim.training.policy_training import make_learner
from sim.training.training_run import PolicyTrainingConfig


def measure(count: int, seed: int, turns: int) -> Row:
    """Environment steps per CPU second: bare physics, and the environment and PPO as shares of it."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    config = PolicyTrainingConfig(ppo=PpoConfig(critic_only=0))
    env = TrainingEnv(TrainingEnvConfig(count=count, seed=seed, form=config.form))
    learner = make_learner(config)
    horizon = learner.config.horizon
    nothing = np.zeros((count, JOINT_COUNT))

    def environment() -> None:
        for _ in range(horizon):
            env.step(nothing)

    def ppo() -> None:
        learner.iterate(env)

    def bare() -> float:
        """CPU seconds of the physics of one environment turn."""
        batch, states = env.robot.batch, []
        step = batch.step

        def noted() -> None:
            states.append(batch.state.copy())
            step()

        with patch.object(batch, "step", noted):
            environment()
        end, spent = batch.state.copy(), 0.0
        for state in states:
            batch.state[:] = state
            spent += _cpu_seconds(step)
        batch.state[:] = end
        return spent

    seconds = np.array([(bare(), _cpu_seconds(environment), _cpu_seconds(ppo)) for _ in range(turns + 1)])
    # The first turn warms up. Load on the machine comes in bursts, so turns are compared one by one.
    seconds = seconds[1:]
    shares = np.median(seconds[:, :1] / seconds, axis=0)
    rates = horizon * count / np.median(seconds, axis=0)
    return {
        "count": count,
        "bare_steps_per_cpu_s": float(rates[0]),
        "environment_steps_per_cpu_s": float(rates[1]),
        "ppo_steps_per_cpu_s": float(rates[2]),
        "environment_share": float(shares[1]),
        "ppo_share": float(shares[2]),
    }


def _cpu_seconds(work: Callable[[], None]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Throughput of policy training beside bare physics.")
    parser.add_argument("--count", type=int, default=512, help="robots in the batch (default 512)")
    arguments = parser.parse_args()
    report = Report("training", arguments.seed)
    row = measure(arguments.count, arguments.seed, 1 if arguments.quick else 5)
    report.rows.append(row)
    report.bars += [
        at_least("environment, share of bare physics", float(row["environment_share"] or 0.0), 0.6, "1"),
        at_least("whole PPO loop, share of bare physics", float(row["ppo_share"] or 0.0), 0.35, "1"),
    ]
    report.finish(arguments.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
