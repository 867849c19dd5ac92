"""Rollouts as tensors from which windows are drawn: normalisation from the training split alone."""

from dataclasses import dataclass

import numpy as np
import torch

from control.estimation.networks.force_features import features, increment_columns
from control.estimation.networks.force_network import NORMALIZED_LIMIT
from control.learning.rollout_bias import rollout_bias
from control.learning.rollout_data import SETTLE_STEPS, DatasetError, Rollout
from control.learning.targets import TrainingTarget


@dataclass(frozen=True, slots=True)
class Normalization:
    """Of features, per column: (F,) mean and standard deviation, 1 for a constant column."""

    mean: np.ndarray
    std: np.ndarray

    @classmethod
    def of(cls, rollouts: list[Rollout], target: TrainingTarget) -> "Normalization":
        """From all steps of `rollouts`, which must be the training split."""
        stacked = np.concatenate([raw_features(rollout, target) for rollout in rollouts])
        std = stacked.std(axis=0, dtype=float)
        return cls(stacked.mean(axis=0, dtype=float), np.where(std > 1e-6, std, 1.0))


def raw_features(rollout: Rollout, target: TrainingTarget) -> np.ndarray:
    """(T, F) features of a rollout, not normalised; what is seen as change has none at the first step."""
    levels = features(target.feature_groups, rollout.signals(target.features_from))
    before = np.vstack([levels[:1], levels[:-1]])
    return levels - before * increment_columns(target.feature_groups, target.increment_groups)


def wanted_force(rollout: Rollout, target: TrainingTarget) -> np.ndarray:
    """(T, 3) N what the network should give: truth minus the nominal estimate, eq. (12), or truth."""
    if target.nominal is None:
        return rollout.force_true_n
    return rollout.force_true_n - rollout.arrays[f"{target.nominal}.force"]


class WindowSet:
    """All windows of equally long rollouts.

    Attributes:
        rollout_count, step_count: R and T.
    """

    def __init__(self, rollouts: list[Rollout], target: TrainingTarget, normalization: Normalization, history: int) -> None:
        """
        Raises:
            DatasetError: rollouts of different length.
        """
        lengths = {len(rollout.force_true_n) for rollout in rollouts}
        if len(lengths) != 1:
            raise DatasetError(f"rollouts have different lengths {sorted(lengths)}; collect them with one --duration")
        self.rollout_count, self.step_count = len(rollouts), lengths.pop()
        values = np.empty((len(rollouts), history - 1 + self.step_count, len(normalization.mean)), np.float32)
        for row, rollout in zip(values, rollouts, strict=True):
            normalized = (raw_features(rollout, target) - normalization.mean) / normalization.std
            row[history - 1 :] = normalized.clip(-NORMALIZED_LIMIT, NORMALIZED_LIMIT)
            row[: history - 1] = row[history - 1]  # missing steps repeat the first one, as the running estimator does
        self._values = torch.from_numpy(values)
        wanted = [wanted_force(rollout, target) for rollout in rollouts]
        learnable = wanted
        if target.gaussian:
            learnable = [force - rollout_bias(rollout, force) for force, rollout in zip(wanted, rollouts, strict=True)]
        self._wanted = torch.from_numpy(np.stack(wanted).astype(np.float32))
        self._learnable = torch.from_numpy(np.stack(learnable).astype(np.float32))
        self._offsets = torch.arange(history)

    def windows(self, rollouts: torch.Tensor, steps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Windows that end at `steps` (batch,) of `rollouts` (batch,), and what is wanted of them.

        Returns:
            windows (batch, H, F); learnable force (batch, 3) N, without the rollout's bias where the network states its own
            error; all of the wanted force (batch, 3) N.
        """
        windows = self._values[rollouts[:, None], steps[:, None] + self._offsets]
        return windows, self._learnable[rollouts, steps], self._wanted[rollouts, steps]

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """`count` random windows from the second half second on."""
        rollouts = torch.randint(self.rollout_count, (count,), generator=generator)
        steps = torch.randint(SETTLE_STEPS // 2, self.step_count, (count,), generator=generator)
        return self.windows(rollouts, steps)
