"""PPO with an estimation head: after each update of the policy, a pass of supervised steps on the same rollout."""

from typing import Any

import numpy as np
import torch

from control.learning.baselines.networks import BaselineActorCritic
from control.learning.policy.ppo import Ppo, PpoConfig, PpoStatistics, Rollout

ESTIMATION_RATES = {"portela": 1e-4, "zhi": 1e-5}
"""Learning rate of the estimation loss. UniFP's own; that of Portela et al., 1e-3, would undo what imitation has taught an
estimator that the actor listens to."""

_MINIBATCHES = 4


class BaselinePpo(Ppo):
    """Improves a baseline: what is estimated follows `targets` in the critic's truth.

    Attributes:
        estimation_loss: mean of the last update.
    """

    def __init__(self, network: BaselineActorCritic, config: PpoConfig) -> None:
        super().__init__(network, config)
        self._baseline = network
        rate = ESTIMATION_RATES[network.method.name]
        self.estimation_optimizer = torch.optim.Adam(network.estimation_parameters(), rate, fused=True)
        self.estimation_loss = float("nan")

    def update(self, rollout: Rollout) -> PpoStatistics:
        """See Ppo."""
        statistics = super().update(rollout)
        network, count = self._baseline, sum(self._baseline.method.targets.values())
        observed, targets = rollout.observations.flatten(0, 1), rollout.privileged[..., -count:].flatten(0, 1)
        losses = []
        for rows in torch.randperm(len(observed)).chunk(_MINIBATCHES):
            loss = network.estimation_loss(observed[rows], targets[rows])
            self._descend(self.estimation_optimizer, network.estimation_parameters(), loss)
            losses.append(loss.item())
        self.estimation_loss = float(np.mean(losses))
        return statistics

    def state(self) -> dict[str, Any]:
        """See Ppo."""
        return super().state() | {"estimation_optimizer": self.estimation_optimizer.state_dict()}

    def restore(self, state: dict[str, Any]) -> None:
        """See Ppo."""
        super().restore(state)
        self.estimation_optimizer.load_state_dict(state["estimation_optimizer"])
