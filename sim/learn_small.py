"""Learn something small in the Gymnasium world, in minutes on one core: `python -m sim.learn_small`.

Cross-entropy search for a constant correction of the model-based controller, 22 numbers, that presses better: each robot of the
batch tries its own. Everything is in this file, and nothing but numpy is needed; the same loop takes any learner. Then the full
stack tries what was learned.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import gymnasium
import numpy as np

from control.joints import JOINT_COUNT

ELITE_SHARE = 0.2
SMALLEST_SPREAD = 0.02


def search(task: str, robots: int, rounds: int, steps: int, seed: int) -> tuple[np.ndarray, list[float]]:
    """The best constant action (22,) found, and the mean reward per step of every round."""
    random = np.random.default_rng(seed)
    envs = gymnasium.make_vec(f"sim.gym:Forcelens/{task}-v0", robots, vectorization_mode="vector_entry_point")
    mean, spread, history = np.zeros(JOINT_COUNT), np.full(JOINT_COUNT, 0.2), []
    elite = max(2, round(ELITE_SHARE * robots))
    for number in range(rounds):
        tried = np.clip(random.normal(mean, spread, (robots, JOINT_COUNT)), -1.0, 1.0)
        tried[0] = mean
        envs.reset(seed=seed)  # every round the same world, so that chance favours nobody
        reward = np.zeros(robots)
        for _ in range(steps):
            reward += envs.step(tried.astype(np.float32))[1] / steps
        best = np.argsort(reward)[-elite:]
        mean, spread = tried[best].mean(axis=0), np.maximum(tried[best].std(axis=0), SMALLEST_SPREAD)
        history.append(float(reward.mean()))
        print(f"round {number + 1} of {rounds}: reward per step {history[-1]:.4f}", flush=True)
    envs.close()
    return mean, history


def try_out(task: str, action: np.ndarray, seed: int, steps: int) -> float:
    """Mean reward per step of a constant action on the full stack."""
    env = gymnasium.make(f"sim.gym:Forcelens/{task}-v0")
    env.reset(seed=seed)
    rewards = []
    for _ in range(steps):
        _, reward, terminated, truncated, _ = env.step(action.astype(np.float32))
        rewards.append(float(reward))
        if terminated or truncated:
            break
    env.close()
    return float(np.mean(rewards))


def main(words: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", choices=("Press", "Guidance"), default="Press")
    parser.add_argument("--robots", type=int, default=128)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--steps", type=int, default=150, help="of a round, 20 ms each (default 150)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", type=Path, help="file for the curve")
    options = parser.parse_args(words)
    action, history = search(options.task, options.robots, options.rounds, options.steps, options.seed)
    for name, tried in (("the model-based controller alone", np.zeros(JOINT_COUNT)), ("with what was learned", action)):
        print(f"full stack, {name}: {try_out(options.task, tried, options.seed, options.steps):.3f} per step", flush=True)
    if options.plot is not None:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot

        figure, axes = pyplot.subplots(figsize=(7, 3.5), layout="constrained")
        axes.plot(range(1, len(history) + 1), history, marker="o")
        axes.set(xlabel="round", ylabel="mean reward per step", title=f"{options.task}: cross-entropy search")
        axes.grid(alpha=0.3)
        figure.savefig(options.plot, dpi=110)


if __name__ == "__main__":
    main()
