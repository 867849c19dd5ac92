"""Dataset aggregation (Ross et al. 2011): imitate a teacher on the states that the student itself visits."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from control.learning.policy.actor_critic import ActorCritic
from control.learning.policy.vector_env import VectorEnv


@dataclass(frozen=True, slots=True)
class DaggerConfig:
    """Attributes:
    steps: environment steps.
    teacher_steps: over which the share of robots that the teacher drives falls from 1 to 0.
    capacity: newest samples that are kept.
    updates, batch: gradient steps per environment step, and their size.
    learning_rate, final_rate: held for the first half, then a straight line to the end.
    exploration: standard deviation of noise on the student's actions.
    drift, drift_memory: of further noise that lasts, by its correlation of one step and the next. Without, a student that
        cannot tell the masses of its robot blames what it feels on them: where it presses too hard the arm must be light, and
        it presses harder still. With, most of what it feels has nothing to do with masses.
    """

    steps: int = 3000
    teacher_steps: int = 250
    capacity: int = 600_000
    updates: int = 3
    batch: int = 2048
    learning_rate: float = 1e-3
    final_rate: float = 3e-5
    exploration: float = 0.05
    drift: float = 0.15
    drift_memory: float = 0.98

    def rate(self, step: int) -> float:
        """Learning rate at an environment step."""
        late = max(0.0, 2.0 * step / self.steps - 1.0)
        return self.learning_rate + late * (self.final_rate - self.learning_rate)


class SampleRing:
    """The newest observations and teacher actions."""

    def __init__(self, capacity: int, observation: int, actions: int) -> None:
        self._observations, self._actions = torch.zeros(capacity, observation), torch.zeros(capacity, actions)
        self._next, self.count = 0, 0

    def add(self, observations: torch.Tensor, actions: torch.Tensor) -> None:
        """Append samples (n, o) and (n, a); the oldest give way."""
        capacity = len(self._observations)
        rows = (self._next + torch.arange(len(observations))) % capacity
        self._observations[rows], self._actions[rows] = observations, actions
        self._next = (self._next + len(observations)) % capacity
        self.count = min(capacity, self.count + len(observations))

    def draw(self, size: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Random samples, with replacement."""
        rows = torch.randint(0, self.count, (size,))
        return self._observations[rows], self._actions[rows]


class Samples(Protocol):
    """What has been seen and what the teacher did, see SampleRing."""

    def add(self, observations: torch.Tensor, actions: torch.Tensor) -> None:
        """Append samples (n, o) and (n, a)."""
        ...

    def draw(self, size: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Random samples: observations, and labels as the network's imitation loss takes them."""
        ...


def imitate(
    env: VectorEnv,
    network: ActorCritic,
    config: DaggerConfig,
    progress: Callable[[int, float], None],
    samples: Samples | None = None,
    start: int = 0,
) -> float:
    """Train the actor on the teacher's actions; `progress(step, loss)` is called every 50 steps. Returns the last loss.

    Args:
        env: of the robots.
        network: to train.
        config: of the imitation.
        progress: called with the steps done and the running loss.
        samples: to collect in; a SampleRing by default.
        start: steps done before, of an imitation that was cut off; its samples are collected anew.
    """
    optimizer = torch.optim.Adam(network.imitation_parameters(), config.learning_rate, fused=True)
    count, size = env.observation.shape
    ring = samples
    generator = np.random.default_rng(int(torch.randint(0, 2**31, ()).item()))
    loss_mean, drift = float("nan"), np.zeros(())
    for step in range(start, config.steps):
        observation = torch.from_numpy(env.observation)
        label = env.teacher_action()
        if ring is None:
            ring = SampleRing(config.capacity, size, label.shape[1])
        ring.add(observation, torch.from_numpy(label.astype(np.float32)))
        with torch.inference_mode():
            own = network.mean(observation).numpy()
        white = generator.standard_normal((2, *own.shape))
        drift = config.drift_memory * drift + np.sqrt(1.0 - config.drift_memory**2) * white[0]
        own = own + config.exploration * white[1] + config.drift * drift
        by_teacher = generator.random(count) < 1.0 - step / config.teacher_steps
        env.step(np.where(by_teacher[:, None], label, own))
        for group in optimizer.param_groups:
            group["lr"] = config.rate(step)
        loss = torch.zeros(())
        for _ in range(config.updates):
            observations, actions = ring.draw(config.batch)
            loss = network.imitation_loss(observations, actions)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
        value = loss.item()
        loss_mean = value if np.isnan(loss_mean) else 0.98 * loss_mean + 0.02 * value
        if step % 50 == 49:
            progress(step + 1, loss_mean)
    return loss_mean
