"""What the learning algorithms need of an environment: many robots in lockstep, numpy in and out."""

from typing import Protocol

import numpy as np


class VectorStep(Protocol):
    """Outcome of one step of n robots; o, p, h are the sizes of observation, privileged part and reward."""

    @property
    def reward(self) -> np.ndarray:
        """(n, h), one column per value head."""
        ...

    @property
    def done(self) -> np.ndarray:
        """(n,) bool: the next observation begins a new episode."""
        ...

    @property
    def ended(self) -> np.ndarray:
        """(k,) robots that are done only because their time was up."""
        ...

    @property
    def last_observation(self) -> np.ndarray:
        """(k, o) the observation with which their episodes ended."""
        ...

    @property
    def last_privileged(self) -> np.ndarray:
        """(k, p)."""
        ...


class VectorEnv(Protocol):
    """`observation` (n, o) and `privileged` (n, p) are float32 and current after every step."""

    observation: np.ndarray
    privileged: np.ndarray

    def step(self, action: np.ndarray) -> VectorStep:
        """Act (n, a); robots that are done start anew by themselves."""
        ...

    def teacher_action(self) -> np.ndarray:
        """(n, a) what the teacher would do now; at most once per step."""
        ...
