"""Proximal policy optimisation with several critics: one value head and one advantage per objective.

Schulman et al. 2017 (clipped surrogate), Schulman et al. 2016 (generalised advantage estimation). Each head has its own
discount; advantages are normalised per head, weighted, summed and normalised again, so no objective drowns another by scale
(multi-critic). Parts of the body may weigh the objectives differently: each part's actions are judged by what they can change.
The critic has its own optimiser: it keeps its step size when the policy's shrinks to hold the KL target.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from control.learning.policy.actor_critic import ActorCritic
from control.learning.policy.vector_env import VectorEnv


@dataclass(frozen=True, slots=True)
class PpoConfig:
    """Attributes:
    horizon: steps per robot and iteration.
    epochs, minibatches: passes over them. Of a policy that is good already the gradient is small beside its noise, and Adam
        makes full steps of either: one large batch serves it better than several small ones.
    discounts: per value head.
    parts: number of actions of each part of the body that has weights of its own; empty for one part.
    head_weights: of each part, per value head. What weighs little adds little noise to a part's gradient.
    trace: lambda of the advantage estimate.
    clip: of the probability ratio. value_clip: of the change of a value.
    actor_rate, critic_rate: step sizes; the actor's adapts within `actor_rate_range` to `target_kl`.
    entropy: weight of the exploration bonus.
    mean_penalty: of each part, weight of the squared mean action over its noise; for a policy whose zero action is already
        good, so that it departs from it only where that pays.
    gradient_limit: norm at which the gradients of actor and critic are clipped, each.
    std_range: of the action noise.
    noise_memory: correlation of the noise of one step and the next. Noise that lasts moves a robot where white noise only
        shakes it. The likelihood of an action has to know of it: without, the gradient mostly teaches the policy to work
        against its own noise.
    critic_only: first iterations, in which only the critic learns; after fewer it explains little of the returns.
    """

    horizon: int = 24
    epochs: int = 4
    minibatches: int = 1
    discounts: tuple[float, ...] = (0.99, 0.97)
    parts: tuple[int, ...] = ()
    head_weights: tuple[tuple[float, ...], ...] = ((1.0, 1.5),)
    trace: float = 0.95
    clip: float = 0.2
    value_clip: float = 0.2
    actor_rate: float = 1e-5
    actor_rate_range: tuple[float, float] = (1e-6, 1.5e-3)
    critic_rate: float = 1e-3
    target_kl: float = 0.012
    entropy: float = 0.0
    mean_penalty: tuple[float, ...] = (0.0,)
    gradient_limit: float = 1.0
    std_range: tuple[float, float] = (0.01, 1.5)
    noise_memory: float = 0.0
    critic_only: int = 60

    def __post_init__(self) -> None:
        parts = max(1, len(self.parts))
        if not len(self.head_weights) == len(self.mean_penalty) == parts:
            raise ValueError(
                f"{parts} parts need as many head_weights and mean_penalty, not {self.head_weights}, {self.mean_penalty}"
            )


@dataclass(frozen=True, slots=True)
class Rollout:
    """T steps of N robots. Shapes (T, N, ...), log_probabilities (T, N, parts), values (T + 1, N, heads),
    rewards (T, N, heads), dones (T, N);
    `before` (N, actions) is how far the noise was from the mean before the first step.

    `means` of the actions and `values` carry the graph of their gradients, for one pass backward: the first update of a network
    is at the parameters that acted, and need not compute them again."""

    observations: torch.Tensor
    privileged: torch.Tensor
    means: torch.Tensor
    actions: torch.Tensor
    log_probabilities: torch.Tensor
    values: torch.Tensor
    rewards: torch.Tensor
    dones: torch.Tensor
    before: torch.Tensor


@dataclass(frozen=True, slots=True)
class PpoStatistics:
    """Means over one iteration. `reward`: (heads,) per step."""

    reward: tuple[float, ...]
    value_loss: float
    policy_loss: float
    kl: float
    clipped_share: float
    actor_rate: float
    std: float


def advantages(rollout: Rollout, discounts: torch.Tensor, trace: float) -> torch.Tensor:
    """Generalised advantage estimates (T, N, heads).

    A_t = delta_t + discount * trace * A_{t+1}, delta_t = r_t + discount * V_{t+1} - V_t, cut where an episode ends.
    """
    result = torch.zeros_like(rollout.rewards)
    running = torch.zeros_like(rollout.rewards[0])
    values = rollout.values.detach()
    for t in reversed(range(len(result))):
        goes_on = (1.0 - rollout.dones[t])[:, None]
        delta = rollout.rewards[t] + discounts * values[t + 1] * goes_on - values[t]
        running = delta + discounts * trace * goes_on * running
        result[t] = running
    return result


def combined_advantage(per_head: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """(B, parts) from (B, heads) and weights (parts, heads): normalise each head, weight, sum, scale to unit deviation."""
    normalised = (per_head - per_head.mean(dim=0)) / (per_head.std(dim=0) + 1e-8)
    total = normalised @ weights.T
    return total / (total.std(dim=0) + 1e-8)


def policy_loss(log_ratio: torch.Tensor, advantage: torch.Tensor, clip: float) -> torch.Tensor:
    """Clipped surrogate, to be minimised, summed over parts; `log_ratio` and `advantage` (..., parts)."""
    ratio = torch.exp(log_ratio)
    return -torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage).sum(dim=-1).mean()


def value_loss(values: torch.Tensor, old_values: torch.Tensor, returns: torch.Tensor, clip: float) -> torch.Tensor:
    """Mean square error (heads,) of each head: the worse of the value and the one clipped about the old. All (B, heads)."""
    clipped = old_values + (values - old_values).clamp(-clip, clip)
    return torch.max((values - returns) ** 2, (clipped - returns) ** 2).mean(dim=0)


class Ppo:
    """Collects rollouts from an environment and improves an actor-critic on them."""

    def __init__(self, network: ActorCritic, config: PpoConfig) -> None:
        self.network, self.config = network, config
        self.actor_optimizer = torch.optim.Adam(network.actor_parameters(), config.actor_rate, eps=1e-6, fused=True)
        self.critic_optimizer = torch.optim.Adam(network.critic_parameters(), config.critic_rate, eps=1e-6, fused=True)
        self.actor_rate = config.actor_rate
        self.iteration = 0
        self._discounts = torch.tensor(config.discounts)
        self._weights = torch.tensor(config.head_weights)
        self._penalty = torch.tensor(config.mean_penalty)

    def iterate(self, env: VectorEnv) -> PpoStatistics:
        """One rollout and the update on it."""
        rollout = self.collect(env)
        statistics = self.update(rollout)
        self.iteration += 1
        return statistics

    def collect(self, env: VectorEnv) -> Rollout:
        """Act for `horizon` steps."""
        network, horizon, memory = self.network, self.config.horizon, self.config.noise_memory
        observations, privileged, means, actions, deviations, rewards, dones, ended = ([] for _ in range(8))
        with torch.no_grad():
            deviation = before = network.deviate(torch.zeros(len(env.observation), len(network.log_std)), memory=0.0)
            for _ in range(horizon):
                observation = torch.from_numpy(env.observation)
                observations.append(observation)
                privileged.append(torch.from_numpy(env.privileged))
                with torch.enable_grad():
                    means.append(network.mean(observation))
                deviation = network.deviate(deviation, memory)
                deviations.append(deviation)
                actions.append(means[-1] + deviation)
                outcome = env.step(actions[-1].numpy())
                rewards.append(torch.from_numpy(outcome.reward.astype(np.float32)))
                dones.append(torch.from_numpy(outcome.done.astype(np.float32)))
                ended.append((outcome.ended, outcome.last_observation, outcome.last_privileged))
            observations.append(torch.from_numpy(env.observation))
            privileged.append(torch.from_numpy(env.privileged))
            observed, truth = torch.stack(observations), torch.stack(privileged)
            with torch.enable_grad():
                mean = torch.stack(means)
                # Values take no part in acting, so one pass over the whole rollout yields them.
                values = network.values(observed.flatten(0, 1), truth.flatten(0, 1)).unflatten(0, observed.shape[:2])
            for reward, (robots, *last) in zip(rewards, ended, strict=True):
                if len(robots):
                    # Time was up, but the task would go on: what follows is worth the last state's value.
                    reward[robots] += self._discounts * network.values(*map(torch.from_numpy, last))
            log_probabilities = self._log_probabilities(torch.stack(deviations), before)
        return Rollout(
            observations=observed[:-1],
            privileged=truth[:-1],
            means=mean,
            actions=torch.stack(actions),
            log_probabilities=log_probabilities,
            values=values,
            rewards=torch.stack(rewards),
            dones=torch.stack(dones),
            before=before,
        )

    def update(self, rollout: Rollout) -> PpoStatistics:
        """Several epochs of minibatches; the policy stands still once it has moved far beyond the KL target."""
        config, network = self.config, self.network
        all_values = rollout.values[:-1].detach()
        per_head = advantages(rollout, self._discounts, config.trace)
        all_returns = per_head + all_values
        all_advantages = combined_advantage(per_head.flatten(0, 1), self._weights).unflatten(0, per_head.shape[:2])
        learn_policy = self.iteration >= config.critic_only
        near = True

        value_losses, policy_losses, divergences, clipped = [], [], [], []
        for epoch in range(config.epochs):
            for robots in self._batches(per_head.shape[1]):
                # The network is still the one that acted, on all robots.
                known = epoch == 0 and config.minibatches == 1
                observed = rollout.observations[:, robots].flatten(0, 1)
                truth = rollout.privileged[:, robots].flatten(0, 1)
                values = rollout.values[:-1].flatten(0, 1) if known else network.values(observed, truth)
                old_values, returns = all_values[:, robots].flatten(0, 1), all_returns[:, robots].flatten(0, 1)
                loss = value_loss(values, old_values, returns, config.value_clip).sum()
                self._descend(self.critic_optimizer, network.critic_parameters(), loss)
                value_losses.append(loss.item())
                if not (learn_policy and near):
                    continue
                mean = rollout.means.flatten(0, 1) if known else network.mean(observed)
                actions = rollout.actions[:, robots]
                log_probability = self._log_probabilities(actions - mean.view(actions.shape), rollout.before[robots])
                log_ratio = (log_probability - rollout.log_probabilities[:, robots]).clamp(-5.0, 5.0)
                with torch.no_grad():
                    ratio = torch.exp(log_ratio)
                    divergences.append(float((ratio - 1.0 - log_ratio).sum(dim=-1).mean()))
                    clipped.append(float(((ratio - 1.0).abs() > config.clip).float().mean()))
                near = self._adapt_rate(divergences[-1])
                loss = policy_loss(log_ratio, all_advantages[:, robots], config.clip)
                size = self._by_part((mean * torch.exp(-network.log_std.detach())).square()).mean(dim=0)
                regular = size @ self._penalty - config.entropy * network.log_std.sum()
                self._descend(self.actor_optimizer, network.actor_parameters(), loss + regular)
                with torch.no_grad():
                    network.log_std.clamp_(*np.log(config.std_range).tolist())
                policy_losses.append(loss.item())
        return PpoStatistics(
            reward=tuple(rollout.rewards.mean(dim=(0, 1)).tolist()),
            value_loss=float(np.mean(value_losses)),
            policy_loss=float(np.mean(policy_losses)) if policy_losses else 0.0,
            kl=float(np.mean(divergences)) if divergences else 0.0,
            clipped_share=float(np.mean(clipped)) if clipped else 0.0,
            actor_rate=self.actor_rate,
            std=float(network.log_std.detach().exp().mean()),
        )

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps besides the network."""
        return {
            "actor_optimizer": self.actor_optimizer.state_dict(),
            "critic_optimizer": self.critic_optimizer.state_dict(),
            "actor_rate": self.actor_rate,
            "iteration": self.iteration,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from `state()`."""
        self.actor_optimizer.load_state_dict(state["actor_optimizer"])
        self.critic_optimizer.load_state_dict(state["critic_optimizer"])
        self.actor_rate, self.iteration = state["actor_rate"], state["iteration"]

    def _batches(self, robots: int) -> Sequence[torch.Tensor | slice]:
        """Of robots, not of steps: an action's likelihood needs the step before. One batch is all of them as they lie."""
        return torch.randperm(robots).chunk(self.config.minibatches) if self.config.minibatches > 1 else [slice(None)]

    def _log_probabilities(self, deviations: torch.Tensor, before: torch.Tensor) -> torch.Tensor:
        """(T, N, parts) of successive deviations (T, N, actions) that follow `before` (N, actions)."""
        last = torch.cat([before[None], deviations[:-1]])
        of_actions = self.network.log_probability(deviations, last, self.config.noise_memory)
        return self._by_part(of_actions)

    def _by_part(self, of_actions: torch.Tensor) -> torch.Tensor:
        """Sums (..., parts) of (..., actions)."""
        parts = self.config.parts or (of_actions.shape[-1],)
        return torch.stack([part.sum(dim=-1) for part in of_actions.split(parts, dim=-1)], dim=-1)

    def _adapt_rate(self, kl: float) -> bool:
        """Step size towards the KL target; False when this update has gone too far."""
        config = self.config
        low, high = config.actor_rate_range
        if kl > 2.0 * config.target_kl:
            self.actor_rate = max(low, self.actor_rate / 1.5)
        elif kl < 0.5 * config.target_kl:
            self.actor_rate = min(high, self.actor_rate * 1.15)
        for group in self.actor_optimizer.param_groups:
            group["lr"] = self.actor_rate
        return kl <= 4.0 * config.target_kl

    def _descend(self, optimizer: torch.optim.Optimizer, parameters: list[nn.Parameter], loss: torch.Tensor) -> None:
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, self.config.gradient_limit)
        optimizer.step()
