"""Losses of the force networks, on forces in units of the output scale."""

import torch
from torch.nn import functional

from control.estimation.networks.force_network import LOG_VARIANCE_RANGE


def smooth_l1(raw: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Eq. (16) of the paper with transition delta = 1; `raw` and `target` (batch, 3)."""
    return functional.smooth_l1_loss(raw, target, beta=1.0)


def beta_likelihood(raw: torch.Tensor, learnable: torch.Tensor, wanted: torch.Tensor, beta: float = 0.5) -> torch.Tensor:
    """Gaussian negative log likelihood with every sample weighted by variance^beta (Seitzer et al., ICLR 2022).

    The plain likelihood (beta = 0) learns the mean badly where the variance is large; beta = 1 is the squared error. The mean
    follows what can be learned; the variance follows all of the error, so that it covers what cannot.

    Args:
        raw: (batch, 6) mean, then logarithm of the variance.
        learnable: (batch, 3) target of the mean.
        wanted: (batch, 3) what the error is measured against.
    """
    mean, log_variance = raw[:, :3], raw[:, 3:].clamp(*LOG_VARIANCE_RANGE)
    precision = torch.exp(-log_variance)
    mean_loss = (learnable - mean).square() * precision.detach()
    variance_loss = log_variance + (wanted - mean.detach()).square() * precision
    return (0.5 * (mean_loss + variance_loss) * torch.exp(beta * log_variance).detach()).mean()
