"""Policy and value networks: an actor MLP with Gaussian actions, and one critic trunk with a value head per objective."""

import math
import time
from collections.abc import Sequence
from functools import cache
from typing import Any

import torch
from torch import nn

HIDDEN = (512, 256, 128)
CRITIC_HIDDEN = (256, 128)
"""Of the critic. One of the actor's size takes three times as long and explains the returns no sooner."""

TYPICAL_ERROR = 0.2
"""Units of action, beyond which an error of imitation counts by its size, not its square. Robots whose arm rests on a stop,
where no torque matters, are few and their errors twenty times as large: squared, they would be most of the loss."""

VALUE_HEADS = 2
_LOG_SQRT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class _RoundedTrunk(torch.autograd.Function):
    """Linear and ELU layers whose gradients are computed in bfloat16, at half the time of float32; values in `dtype`.

    One function for all layers: what passes back from one to the next need not be converted for autograd in between.
    """

    @staticmethod
    def forward(ctx: Any, inputs: torch.Tensor, dtype: torch.dtype, *parameters: torch.Tensor) -> torch.Tensor:
        """Features (n, out) in `dtype` of inputs (n, in); `parameters` are the layers' weights and biases."""
        weights, biases = parameters[::2], parameters[1::2]
        values = inputs.to(dtype)
        rounded = [values.bfloat16()]
        for weight, bias in zip(weights, biases, strict=True):
            values = nn.functional.elu(nn.functional.linear(values, weight.to(dtype), bias.to(dtype)), inplace=True)
            rounded.append(values.bfloat16())
        ctx.save_for_backward(*rounded, *weights)
        return values

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        layers = len(ctx.saved_tensors) // 2
        rounded, weights = ctx.saved_tensors[: layers + 1], ctx.saved_tensors[layers + 1 :]
        gradient, of_parameters = gradients[0].bfloat16(), []
        for layer in reversed(range(layers)):
            # From the output of ELU, not its input.
            gradient = torch.ops.aten.elu_backward(gradient, 1.0, 1.0, 1.0, True, rounded[layer + 1])
            of_parameters = [gradient.t() @ rounded[layer], gradient.sum(dim=0, dtype=torch.float32), *of_parameters]
            if layer or ctx.needs_input_grad[0]:
                gradient = gradient @ weights[layer].bfloat16()
        return gradient.float() if ctx.needs_input_grad[0] else None, None, *of_parameters


@cache
def bfloat16_pays() -> bool:
    """Whether this machine multiplies matrices faster in bfloat16 than in float32, as CPUs with tiles do."""
    left, right = torch.ones(2048, 512), torch.ones(512, 512)

    def fastest_s(dtype: torch.dtype) -> float:
        one, other, times_s = left.to(dtype), right.to(dtype), []
        for _ in range(5):
            started = time.perf_counter()
            torch.mm(one, other)
            times_s.append(time.perf_counter() - started)
        return min(times_s)

    return fastest_s(torch.bfloat16) < fastest_s(torch.float32)


def imitation_error(actions: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Huber loss of actions (n, a) against a teacher's (n, a), of slope 1 beyond TYPICAL_ERROR."""
    return nn.functional.huber_loss(actions, labels, delta=TYPICAL_ERROR) / TYPICAL_ERROR


def mlp(inputs: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Linear and ELU layers; the last hidden size is the output."""
    layers: list[nn.Module] = []
    for size in hidden:
        # In place, the gradient of ELU needs its output only, not the exponential once more.
        layers += [nn.Linear(inputs, size), nn.ELU(inplace=True)]
        inputs = size
    return nn.Sequential(*layers)


class ActorCritic(nn.Module):
    """Actor on observations; critic on observations and privileged truth."""

    def __init__(
        self,
        observation: int,
        privileged: int,
        actions: int,
        std: float | Sequence[float],
        bfloat16: bool,
        hidden: tuple[int, ...] = HIDDEN,
        critic_hidden: tuple[int, ...] = CRITIC_HIDDEN,
    ) -> None:
        """`std`: initial standard deviation of actions, of all or (a,).

        `bfloat16`: hidden layers of the critic compute in bfloat16, and so do the actor's for imitation. For PPO the actor
        computes in float32, only its gradients in bfloat16: rounding moves actions by about 0.003, which at an action noise of
        0.1 looks like a KL divergence of 0.01, as much as a whole update may have.
        """
        super().__init__()
        self.actor_trunk = mlp(observation, hidden)
        self.actor_head = nn.Linear(hidden[-1], actions)
        self.critic_trunk = mlp(observation + privileged, critic_hidden)
        self.critic_heads = nn.Linear(critic_hidden[-1], VALUE_HEADS)
        self.log_std = nn.Parameter(torch.log(torch.as_tensor(std, dtype=torch.float32).expand(actions)))
        self._bfloat16 = bfloat16
        with torch.no_grad():
            self.actor_head.weight *= 0.05
            self.actor_head.bias.zero_()

    def mean(self, observation: torch.Tensor, imitating: bool = False) -> torch.Tensor:
        """Mean action (n, a)."""
        dtype = torch.bfloat16 if imitating else torch.float32
        return self._through(self.actor_trunk, self.actor_head, observation, dtype)

    def values(self, observation: torch.Tensor, privileged: torch.Tensor) -> torch.Tensor:
        """(n, VALUE_HEADS)."""
        inputs = torch.cat([observation, privileged], dim=1)
        return self._through(self.critic_trunk, self.critic_heads, inputs, torch.bfloat16)

    def log_probability(self, deviation: torch.Tensor, last: torch.Tensor, memory: float) -> torch.Tensor:
        """(..., a) of deviations (..., a) from the mean after those of the step before, `last` (..., a), action by action.

        Deviations are a first-order autoregressive process with the standard deviation of `log_std`, whatever its `memory`
        (Korenkevych et al., IJCAI 2019).
        """
        spread = math.sqrt(1.0 - memory**2)
        scaled = (deviation - memory * last) * torch.exp(-self.log_std) / spread
        return -0.5 * scaled**2 - self.log_std - math.log(spread) - _LOG_SQRT_TWO_PI

    def deviate(self, last: torch.Tensor, memory: float) -> torch.Tensor:
        """Random deviations (n, a) from the mean, after those of the step before."""
        return memory * last + math.sqrt(1.0 - memory**2) * torch.exp(self.log_std) * torch.randn_like(last)

    def imitation_parameters(self) -> list[nn.Parameter]:
        """What imitation trains."""
        return [*self.actor_trunk.parameters(), *self.actor_head.parameters()]

    def imitation_loss(self, observations: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """See imitation_error; `labels` (n, a)."""
        return imitation_error(self.mean(observations, imitating=True), labels)

    def actor_parameters(self) -> list[nn.Parameter]:
        """What the policy gradient trains."""
        return [*self.actor_trunk.parameters(), *self.actor_head.parameters(), self.log_std]

    def critic_parameters(self) -> list[nn.Parameter]:
        """What the value loss trains."""
        return [*self.critic_trunk.parameters(), *self.critic_heads.parameters()]

    def _through(self, trunk: nn.Module, head: nn.Module, inputs: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
        if not self._bfloat16:
            return head(trunk(inputs))
        return head(_RoundedTrunk.apply(inputs, dtype, *trunk.parameters()).float())
