"""Newest samples of an imitation that observes histories: frames are kept once, histories put together when drawn."""

from typing import Protocol

import numpy as np
import torch


class HistoryEnv(Protocol):
    """What the ring needs of the environment beside its observations.

    Attributes:
        ages: (n,) frames of each robot's history.
        targets: (n, k) float32, what is to be estimated.
    """

    @property
    def ages(self) -> np.ndarray:
        """(n,)."""
        ...

    @property
    def targets(self) -> np.ndarray:
        """(n, k)."""
        ...


class HistoryRing:
    """Frames and labels of the last steps of all robots; takes the place of control.learning.policy.dagger.SampleRing."""

    def __init__(self, env: HistoryEnv, frames: int, capacity: int) -> None:
        """`capacity`: samples."""
        self._env, self._history = env, frames
        count = len(env.ages)
        self._steps = max(2 * frames, capacity // count)
        self._ages = np.zeros((self._steps, count), np.int64)
        self._frames: torch.Tensor | None = None
        self._labels = torch.empty(0)
        self._next, self._filled = 0, 0

    def add(self, observations: torch.Tensor, actions: torch.Tensor) -> None:
        """Append histories (n, o) and actions (n, a), of the environment as it is now; the oldest step gives way."""
        frames = observations.unflatten(1, (self._history, -1))[:, -1]
        labels = torch.cat([actions, torch.from_numpy(self._env.targets)], dim=1)
        if self._frames is None:
            self._frames = torch.zeros(self._steps, *frames.shape)
            self._labels = torch.zeros(self._steps, *labels.shape)
        self._frames[self._next], self._labels[self._next] = frames, labels
        self._ages[self._next] = self._env.ages
        self._next = (self._next + 1) % self._steps
        self._filled = min(self._steps, self._filled + 1)

    def draw(self, size: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Random histories (size, o), zeros before their robot's start, and labels (size, a + k), with replacement."""
        if self._frames is None:
            raise RuntimeError("nothing has been added yet")
        # Of the oldest steps the frames before are gone.
        usable = self._filled if self._filled < self._steps else self._steps - self._history + 1
        back = torch.randint(1, usable + 1, (size,))
        robots = torch.randint(0, self._ages.shape[1], (size,))
        steps = (self._next - back) % self._steps
        ages = torch.from_numpy(self._ages)[steps, robots]
        before = torch.arange(self._history - 1, -1, -1)
        histories = self._frames[(steps[:, None] - before) % self._steps, robots[:, None]]
        histories.masked_fill_((before >= ages[:, None]).unsqueeze(2), 0.0)
        return histories.flatten(1), self._labels[steps, robots]
