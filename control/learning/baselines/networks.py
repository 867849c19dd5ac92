"""The baselines' networks as modules: actor-critics whose actor looks through an estimator or an encoder at the history.

The critic sees the newest frame and the truth, as the policy's critic sees its observation and the truth.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from control.baselines.baseline_weights import METHODS
from control.baselines.method import Method
from control.baselines.portela import ESTIMATOR_HIDDEN
from control.baselines.zhi import ENCODER_HIDDEN, FEATURES, HEAD_HIDDEN
from control.joints import JOINT_COUNT
from control.learning.policy.actor_critic import CRITIC_HIDDEN, ActorCritic, imitation_error, mlp


class BaselineActorCritic(ActorCritic, ABC):
    """Actor on a history (n, frames * frame size), oldest first, with an estimation head."""

    def __init__(self, method: Method, privileged: int, std: float | Sequence[float], bfloat16: bool) -> None:
        """`privileged`: size of the critic's truth, without what is estimated. See ActorCritic for the rest."""
        *_, (actor_inputs, *hidden, actions) = method.layers().values()
        super().__init__(actor_inputs, privileged, actions, std, bfloat16, hidden=tuple(hidden))
        self.method = method
        self._privileged = privileged
        self.critic_trunk = mlp(method.frame_size + privileged, CRITIC_HIDDEN)

    @abstractmethod
    def estimates(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Scaled estimates (n, targets)."""

    def values(self, observation: torch.Tensor, privileged: torch.Tensor) -> torch.Tensor:
        """(n, VALUE_HEADS)."""
        return super().values(self._newest(observation), privileged[:, : self._privileged])

    def estimation_parameters(self) -> list[nn.Parameter]:
        """What the estimation loss trains; the policy gradient reaches those that lead to the action too."""
        return [parameter for name, parameter in self.named_parameters() if not name.startswith(_ACTING)]

    @abstractmethod
    def actor_parameters(self) -> list[nn.Parameter]:
        """What the policy gradient trains."""

    def imitation_parameters(self) -> list[nn.Parameter]:
        """What imitation trains: the actor, and what is estimated meanwhile."""
        return [p for name, p in self.named_parameters() if not name.startswith("critic") and name != "log_std"]

    def imitation_loss(self, observations: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """See imitation_error, and mean square of the estimates; `labels` (n, actions + targets)."""
        actions = imitation_error(self.mean(observations, imitating=True), labels[:, :JOINT_COUNT])
        return actions + self.estimation_loss(observations, labels[:, JOINT_COUNT:], imitating=True)

    def estimation_loss(self, observations: torch.Tensor, targets: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Mean square of the scaled estimates' errors; `targets` (n, targets)."""
        return nn.functional.mse_loss(self.estimates(observations, imitating), targets)

    @abstractmethod
    def arrays(self) -> dict[str, np.ndarray]:
        """Weights as `Method.network` takes them."""

    def _newest(self, observation: torch.Tensor) -> torch.Tensor:
        return observation[:, -self.method.frame_size :]


_ACTING = ("actor", "critic", "log_std")


class PortelaActorCritic(BaselineActorCritic):
    """Estimates feed the actor beside the history, and are not detached: the policy gradient shapes the estimator too."""

    def __init__(self, method: Method, privileged: int, std: float | Sequence[float], bfloat16: bool) -> None:
        super().__init__(method, privileged, std, bfloat16)
        self.estimator_trunk = mlp(method.frames * method.frame_size, ESTIMATOR_HIDDEN)
        self.estimator_head = nn.Linear(ESTIMATOR_HIDDEN[-1], sum(method.targets.values()))

    def estimates(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Scaled estimates (n, targets)."""
        dtype = torch.bfloat16 if imitating else torch.float32
        return self._through(self.estimator_trunk, self.estimator_head, observation, dtype)

    def mean(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Mean action (n, a)."""
        return super().mean(torch.cat([observation, self.estimates(observation, imitating)], dim=1), imitating)

    def actor_parameters(self) -> list[nn.Parameter]:
        """What the policy gradient trains."""
        return [*super(BaselineActorCritic, self).actor_parameters(), *self.estimation_parameters()]

    def arrays(self) -> dict[str, np.ndarray]:
        """Weights as `Method.network` takes them."""
        return _arrays("estimator", self.estimator_trunk, self.estimator_head) | _arrays(
            "actor", self.actor_trunk, self.actor_head
        )


class ZhiActorCritic(BaselineActorCritic):
    """An encoder's features feed the actor beside the newest frame, and a head that estimates from them."""

    def __init__(self, method: Method, privileged: int, std: float | Sequence[float], bfloat16: bool) -> None:
        super().__init__(method, privileged, std, bfloat16)
        self.encoder = mlp(method.frames * method.frame_size, (*ENCODER_HIDDEN, FEATURES))
        self.head_trunk = mlp(FEATURES, HEAD_HIDDEN)
        self.head = nn.Linear(HEAD_HIDDEN[-1], sum(method.targets.values()))

    def estimates(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Scaled estimates (n, targets)."""
        dtype = torch.bfloat16 if imitating else torch.float32
        return self._through(self.head_trunk, self.head, self._features(observation, imitating), dtype)

    def mean(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Mean action (n, a)."""
        features = self._features(observation, imitating)
        return super().mean(torch.cat([self._newest(observation), features], dim=1), imitating)

    def actor_parameters(self) -> list[nn.Parameter]:
        """What the policy gradient trains."""
        return [*super(BaselineActorCritic, self).actor_parameters(), *self.encoder.parameters()]

    def imitation_loss(self, observations: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """See BaselineActorCritic, with the history encoded once for both."""
        features = self._features(observations, imitating=True)
        acting = super(BaselineActorCritic, self).mean(torch.cat([self._newest(observations), features], dim=1), True)
        estimates = self._through(self.head_trunk, self.head, features, torch.bfloat16)
        actions = imitation_error(acting, labels[:, :JOINT_COUNT])
        return actions + nn.functional.mse_loss(estimates, labels[:, JOINT_COUNT:])

    def arrays(self) -> dict[str, np.ndarray]:
        """Weights as `Method.network` takes them."""
        return (
            _arrays("encoder", self.encoder)
            | _arrays("head", self.head_trunk, self.head)
            | _arrays("actor", self.actor_trunk, self.actor_head)
        )

    def _features(self, observation: torch.Tensor, imitating: bool) -> torch.Tensor:
        dtype = torch.bfloat16 if imitating else torch.float32
        return self._through(self.encoder, nn.Identity(), observation, dtype)


def make_network(name: str, privileged: int, std: float | Sequence[float], bfloat16: bool) -> BaselineActorCritic:
    """The network of the method `name`, untrained; draws from torch's random numbers."""
    kind = {"portela": PortelaActorCritic, "zhi": ZhiActorCritic}[name]
    return kind(METHODS[name], privileged, std, bfloat16)


def _arrays(name: str, *parts: nn.Module) -> dict[str, np.ndarray]:
    layers = [layer for part in parts for layer in part.modules() if isinstance(layer, nn.Linear)]
    arrays = {}
    for index, layer in enumerate(layers):
        arrays[f"{name}_weight_{index}"] = layer.weight.detach().numpy()
        arrays[f"{name}_bias_{index}"] = layer.bias.detach().numpy()
    return arrays
