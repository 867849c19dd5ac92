"""Rollouts as tensors from which windows are drawn: normalisation from the training split alone."""

from dataclasses import dataclass

import numpy as np
import torch

from control.force_features import features, relative_columns
from control.learning.rollout_bias import rollout_bias
from control.learning.rollout_data import SETTLE_STEPS, DatasetError, Rollout
from control.learning.targets import TrainingTarget
from control.network_weights import NORMALIZED_LIMIT

CHANGE_STEPS = 10
"""Relative features are scaled by how much they change over this many steps, half a window."""


@dataclass(frozen=True, slots=True)
class Normalization:
    """Of features, per column: (F,) mean and standard deviation, 1 for a constant column. A relative one has mean 0."""

    mean: np.ndarray
    std: np.ndarray

    @classmethod
    def of(cls, rollouts: list[Rollout], target: TrainingTarget) -> "Normalization":
        """From all steps of `rollouts`, which must be the training split."""
        values = [raw_features(rollout, target) for rollout in rollouts]
        stacked = np.concatenate(values)
        changes = np.concatenate([value[CHANGE_STEPS:] - value[:-CHANGE_STEPS] for value in values])
        relative = relative_columns(target.feature_groups, target.relative_groups) > 0.0
        mean = np.where(relative, 0.0, stacked.mean(axis=0, dtype=float))
        std = np.where(relative, changes.std(axis=0, dtype=float), stacked.std(axis=0, dtype=float))
        return cls(mean, np.where(std > 1e-6, std, 1.0))


def raw_features(rollout: Rollout, target: TrainingTarget) -> np.ndarray:
    """(T, F) features of a rollout, not normalised."""
    return features(target.feature_groups, rollout.signals(target.features_from))


def wanted_force(rollout: Rollout, target: TrainingTarget) -> np.ndarray:
    """(T, 3) N what the network should give: truth minus the nominal estimate, eq. (12), or truth."""
    if target.nominal is None:
        return rollout.force_true
    return rollout.force_true - rollout.arrays[f"{target.nominal}.force"]


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
        lengths = {len(rollout.force_true) for rollout in rollouts}
        if len(lengths) != 1:
            raise DatasetError(f"rollouts have different lengths {sorted(lengths)}; collect them with one --duration")
        self.rollout_count, self.step_count = len(rollouts), lengths.pop()
        values = np.empty((len(rollouts), history - 1 + self.step_count, len(normalization.mean)), np.float32)
        for row, rollout in zip(values, rollouts, strict=True):
            row[history - 1 :] = (raw_features(rollout, target) - normalization.mean) / normalization.std
            row[: history - 1] = row[history - 1]  # missing steps repeat the first one, as the running estimator does
        self._values = torch.from_numpy(values)
        wanted = [wanted_force(rollout, target) for rollout in rollouts]
        learnable = wanted
        if target.gaussian:
            learnable = [force - rollout_bias(rollout, force) for force, rollout in zip(wanted, rollouts, strict=True)]
        self._wanted = torch.from_numpy(np.stack(wanted).astype(np.float32))
        self._learnable = torch.from_numpy(np.stack(learnable).astype(np.float32))
        self._relative = torch.from_numpy(relative_columns(target.feature_groups, target.relative_groups).astype(np.float32))
        self._offsets = torch.arange(history)

    def windows(self, rollouts: torch.Tensor, steps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Windows that end at `steps` (batch,) of `rollouts` (batch,), and what is wanted of them.

        Returns:
            windows (batch, H, F); learnable force (batch, 3) N, without the rollout's bias where the network states its own
            error; all of the wanted force (batch, 3) N.
        """
        windows = self._values[rollouts[:, None], steps[:, None] + self._offsets]
        windows -= self._relative * windows[:, -1:]
        return (
            windows.clamp_(-NORMALIZED_LIMIT, NORMALIZED_LIMIT),
            self._learnable[rollouts, steps],
            self._wanted[rollouts, steps],
        )

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """`count` random windows from the second half second on."""
        rollouts = torch.randint(self.rollout_count, (count,), generator=generator)
        steps = torch.randint(SETTLE_STEPS // 2, self.step_count, (count,), generator=generator)
        return self.windows(rollouts, steps)
